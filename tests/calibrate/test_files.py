"""Calibrations are saved, loaded and asked for by files."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import pytest

from octoplan.model.support.errors import FileError
from octoplan.planner import Unknown, calibrate, load_calibration
from octoplan.planner.frontends.cli import main
from octoplan.planner.frontends.io.fit_files import load_asked
from tests.calibrate.cases import HANGING, MARKERS, PULLS, small_arm, synthetic

SCENE = """
[arm]
length_mm = 200.0
radius_mm = [10.0, 9.0]
E_kPa = 90.0
nu = 0.45
density = 1100.0
sections = [{ at_mm = 200.0, offset_mm = [6.0, 5.0], angles_deg = [0.0, 120.0, 240.0] }]
base_frame = { tangent = [0.0, 0.0, -1.0], normal = [0.0, 1.0, 0.0] }
[effects]
extension = true
exact_tendons = true
weight = {}
"""
FILE = """
scene = "scene.toml"
measured = "shapes.csv"
std_mm = 0.5
points = [
  { name = "M1", s_mm = 100.0, offset_mm = [0.0, 0.0, 20.0] },
  { name = "M2", s_mm = 190.0, offset_mm = [0.0, 15.0, 0.0] },
]
[[unknowns]]
key = "arm.E_kPa"
lower = 50.0
upper = 300.0
"""
COLUMNS = ["name", "T_11_N", "T_12_N", "T_13_N"]
COLUMNS += [f"{name}_{x}_mm" for name in ("M1", "M2") for x in "xyz"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "calibration.toml").write_text(FILE)
    lines = [",".join(COLUMNS)]
    for shape in synthetic(small_arm(), HANGING, 1e-5, 0):
        places = [1e3 * x for point in shape.points for x in point.place or ()]
        lines.append(",".join(map(str, [shape.name, *shape.tensions, *places])))
    (tmp_path / "shapes.csv").write_text("\n".join(lines))
    return tmp_path


def test_a_saved_calibration_loads_equal(tmp_path: Path) -> None:
    shapes = synthetic(small_arm(), HANGING, 1e-4, 0)
    unknowns = [Unknown("arm.E_kPa", 50, 300), Unknown("arm.density", 500, 2000, (1100, 50))]
    found = calibrate(small_arm(), HANGING, shapes, unknowns)
    path = found.save(tmp_path / "found.json")
    again = load_calibration(path)
    assert again == found == pickle.loads(pickle.dumps(found))
    assert again.outcome == found.outcome
    assert again.std == pytest.approx(found.std)
    assert found.plot() is not None


def test_the_command_line_calibrates(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder / "out"
    assert main(["calibrate", str(folder / "calibration.toml"), "--out", str(out)]) == 0
    told = capsys.readouterr().out
    assert "4 shapes, 24 numbers, 1 unknown:" in told
    assert "arm.E_kPa  120" in told
    record = json.loads((out / "calibration.json").read_text())
    assert record["values"][0]["value"] == pytest.approx(120.0, rel=1e-3)
    assert record["scene"]["arm"]["E_kPa"] == record["values"][0]["value"]
    assert (out / "calibration.png").exists()
    assert (
        pytest.approx(120e3, rel=1e-3) == load_calibration(out / "calibration.json").arm.material.E
    )


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("shape 1,", "shape 1,x", "line 3: T_11_N = 'x0.0'"),
        ("M2_z_mm", "M3_z_mm", "line 1 = 'M3_z_mm': must be a column"),
        ("T_11_N,", "", "missing column T_11_N"),
    ],
)
def test_rows_that_are_wrong_are_told(folder: Path, old: str, new: str, told: str) -> None:
    shapes = folder / "shapes.csv"
    shapes.write_text(shapes.read_text().replace(old, new, 1))
    with pytest.raises(FileError, match=told.replace("[", r"\[")):
        load_asked(folder / "calibration.toml")


def test_a_marker_that_is_no_number_is_told_by_its_row(folder: Path) -> None:
    shapes = folder / "shapes.csv"
    lines = shapes.read_text().splitlines()
    lines[4] = ",".join([*lines[4].split(",")[:-1], "low"])
    shapes.write_text("\n".join(lines))
    with pytest.raises(FileError, match="line 5: M2_z_mm = 'low'"):
        load_asked(folder / "calibration.toml")


def test_shapes_by_encoders_have_noise_of_their_own(folder: Path) -> None:
    """Lengths replace tensions in rows without tensions, and complement tensions elsewhere."""
    shapes, path = folder / "shapes.csv", folder / "calibration.toml"
    header, *rows = shapes.read_text().splitlines()
    rows = [f"{row},200,199,198" for row in rows]
    name, _, _, _, *others = rows[1].split(",")
    rows[1] = ",".join([name, "", "", "", *others])
    header += "".join(f",length_T_1{j}_mm" for j in (1, 2, 3))
    shapes.write_text("\n".join([header, *rows]))
    path.write_text("length_std_mm = 0.2\ntension_std = 0.05\n" + path.read_text())
    first, second, *_ = load_asked(path)["measured"]
    assert first.tendon_residuals == [("lengths", j) for j in range(3)]
    assert second.by_length
    assert second.lengths == (0.2, 0.199, 0.198)
    assert (first.std, first.length_std, first.tension_std) == (5e-4, 2e-4, 0.05)


def test_a_marker_that_was_not_seen_is_left_out(folder: Path) -> None:
    shapes = folder / "shapes.csv"
    lines = shapes.read_text().splitlines()
    lines[4] = ",".join([*lines[4].split(",")[:-3], "", "", ""])
    shapes.write_text("\n".join(lines))
    asked = load_asked(folder / "calibration.toml")
    assert [shape.size for shape in asked["measured"]] == [6, 6, 6, 3]
    assert len(asked["measured"]) == len(PULLS)
    assert [point.s for point in asked["measured"][0].points] == pytest.approx(
        [s for s, _ in MARKERS]
    )


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("arm.E_kPa", "arm.F_kPa", "arm.F_kPa"),
        ("lower", "least", "least"),
        ("scene.toml", "other.toml", "other.toml: no such file"),
        ("[[unknowns]]", "[[unknown]]", "unknowns: missing"),
    ],
)
def test_files_that_are_wrong_are_told(
    folder: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, told: str
) -> None:
    path = folder / "calibration.toml"
    path.write_text(path.read_text().replace(old, new, 1))
    assert main(["calibrate", str(path)]) == 2
    assert told in capsys.readouterr().err
