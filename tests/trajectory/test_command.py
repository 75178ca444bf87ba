"""octoplan trajectory: waypoints of a scene file, as text, JSON, CSV and figure."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest

from planner.cli import main
from planner.io.schemas import schema_of

FILE = """
[arm]
preset = "table-4"
[effects]
extension = true
[limits]
tension_max = 20
[motion]
rate_max = 5
[[waypoints]]
type = "tip-position"
position_mm = [320, 80, -100]
[[waypoints]]
type = "tip-position"
position_mm = [300, 120, -120]
"""


def test_the_command_prints_what_its_schema_says_and_writes_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(FILE)
    out = tmp_path / "out"
    assert main(["trajectory", str(scene), "--json", "--out", str(out)]) == 0
    record = json.loads(capsys.readouterr().out)
    jsonschema.validate(record, schema_of("trajectory"))
    assert record["certified"]
    assert record["reached"] == [True, True]
    assert (out / "trajectory.csv").read_text().startswith("t_s,T_11_N")
    assert (out / "trajectory.png").stat().st_size > 10_000


def test_a_file_asks_for_a_quasi_static_motion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(FILE.replace("rate_max = 5", "quasi_static = true"))
    assert main(["trajectory", str(scene), "--json"]) == 0
    certificate = json.loads(capsys.readouterr().out)["certificate"]
    assert certificate["tip_acceleration"] == pytest.approx(1.0, abs=2e-2)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("[motion]\nrate_max = 5\n", "", "motion: missing"),
        ("rate_max = 5", "rate_max = -5", "motion.rate_max"),
        ("rate_max = 5", "times_s = [1.0]", "times"),
        ("rate_max = 5", "tip_acceleration_max_m_s2 = 0", "tip_acceleration_max_m_s2"),
        ("[limits]\ntension_max = 20\n", "", "limits: missing"),
        ("[[waypoints]]", "[[waypoint]]", "waypoints"),
    ],
)
def test_what_is_wrong_in_the_file_is_told_with_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, told: str
) -> None:
    assert old in FILE
    scene = tmp_path / "scene.toml"
    scene.write_text(FILE.replace(old, new))
    assert main(["trajectory", str(scene)]) == 2
    assert told in capsys.readouterr().err
