"""octoplan export: its files, what it says, and exit codes."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from planner.cli import main
from planner.commands.export import c_name
from tests.export.cases import gcc

SCENES = Path(__file__).parents[2] / "studies" / "scenes"


def test_a_scene_is_exported_and_its_makefile_checks_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    to = tmp_path / "new" / "folder"
    scene = str(SCENES / "figure_15.toml")
    assert main(["export", scene, "--to", str(to), "--accuracy", "1e-3"]) == 0
    told = capsys.readouterr()
    assert told.err == ""
    assert "17 nodes" in told.out
    names = {"figure_15.h", "figure_15.c", "test_vector.h", "main.c", "Makefile"}
    assert {path.name for path in to.iterdir()} == names
    gcc()
    make = shutil.which("make")
    if make is None:
        pytest.skip("make is not installed")
    done = subprocess.run([make, "-C", to], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_json_tells_files_and_sizes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = str(SCENES / "figure_15.toml")
    command = ["export", scene, "--to", str(tmp_path), "--precision", "float", "--json"]
    assert main([*command, "--accuracy", "1e-2"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert all(Path(file).is_file() for file in told["files"])
    assert told["error"] <= 1e-2
    header = (tmp_path / "figure_15.h").read_text()
    assert f"({told['static_bytes'] // 4} * sizeof(figure_15_real))" in header
    assert f"#define FIGURE_15_NODES {told['nodes']} " in header
    assert "typedef float figure_15_real;" in header


@pytest.mark.parametrize(
    ("scene", "options", "told"),
    [
        ("payload_in_water", [], "no explicit map"),
        ("fetch_3d", [], "tensions: missing; needed is tensions = [["),
        ("figure_15", ["--precision", "half"], '"half" for --precision. Choose from: "double"'),
        ("figure_15", ["--accuracy", "2"], '"2.0" for --accuracy. Allowed is a number from'),
        ("no_such_scene", [], "no such file"),
    ],
)
def test_bad_input_returns_2_and_writes_nothing(
    scene: str,
    options: list[str],
    told: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = str(SCENES / f"{scene}.toml")
    assert main(["export", path, "--to", str(tmp_path / "out"), *options]) == 2
    assert told in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_names_for_c_are_made_from_file_names() -> None:
    names = {
        "fetch-3d.toml": "fetch_3d",
        "3d.toml": "arm_3d",
        "dir/b\u00e4r.v2.toml": "b_r_v2",
        "_x.toml": "x",
        "sc (1).toml": "sc_1",
        "a__b.toml": "a_b",
        "().toml": "arm",
        "main.toml": "arm_main",
        "Hess.toml": "arm_Hess",
    }
    assert {name: c_name(Path(name)) for name in names} == names
