"""octoplan export: files, output, exit codes, and refusals."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import InputError, Scene
from octoplan.model.effects import ExactTendons, Extension, Shear, TipLoad, Weight
from octoplan.model.extensions.friction import Friction
from octoplan.planner import export
from octoplan.planner.frontends.cli import main
from octoplan.planner.frontends.commands.scenes import c_name
from tests.export.cases import BENT, CURVED, SECTION_52, TABLE_4, gcc

SCENES = Path(__file__).parents[2] / "studies" / "scenes"


@pytest.mark.slow
def test_a_scene_is_exported_and_its_makefile_checks_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    to = tmp_path / "new" / "folder"
    scene = str(SCENES / "figure_15.toml")
    assert main(["export", scene, "--to", str(to), "--accuracy", "1e-3"]) == 0
    told = capsys.readouterr()
    assert told.err == ""
    assert "19 nodes" in told.out
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
        ("fetch_3d", [], "tensions: missing: must be tensions = [["),
        ("figure_15", ["--precision", "half"], '"half" for --precision. Choose from: "double"'),
        ("figure_15", ["--accuracy", "2"], '"2.0" for --accuracy. Must be <= 0.1'),
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


FILES = {"arm.h", "arm.c", "test_vector.h", "main.c", "Makefile"}


@pytest.mark.parametrize(
    "effect", [Weight(), TipLoad(force=(0.0, 0.0, -0.001)), Shear(), Friction(0.1)]
)
def test_scenes_that_are_solved_for_have_no_map_to_export(effect: Any, tmp_path: Path) -> None:
    to = tmp_path / "out"
    with pytest.raises(InputError, match="no explicit map to export"):
        export(SECTION_52, Scene(Extension(), effect), to, [0.1, 0, 0, 0])
    assert not to.exists()


def test_newton_s_method_along_curved_tendons_is_not_exported_in_single_precision(
    tmp_path: Path,
) -> None:
    with pytest.raises(InputError, match="precision = 'float'"):
        export(CURVED, Scene(ExactTendons()), tmp_path, [0.1, 0, 0, 0, 0], precision="float")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"precision": "half"}, "precision"),
        ({"precision": 8}, "precision"),
        ({"precision": np.zeros(2)}, "precision"),
        ({"name": "3d"}, "name"),
        ({"name": "a b"}, "name"),
        ({"name": "b\u00e4r"}, "name"),
        ({"name": "Main"}, "name"),
        ({"name": "test_vector"}, "name"),
        ({"name": "casadi"}, "name"),
        ({"name": None}, "name"),
        ({"accuracy": 0.5}, "accuracy"),
        ({"accuracy": 1e-7, "precision": "float"}, "accuracy"),
        ({"tensions": [1.0]}, "tensions"),
        ({"scene": "paper"}, "scene"),
        ({"arm": "table-4"}, "arm"),
    ],
)
def test_what_is_not_allowed_is_named(options: dict[str, Any], field: str, tmp_path: Path) -> None:
    given = {"arm": TABLE_4, "scene": Scene(), "tensions": BENT, "to": tmp_path / "out", **options}
    with pytest.raises(InputError) as caught:
        export(**given)
    assert caught.value.field == field
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match=r"in this folder: .*(file exists|not a directory)"):
        export(TABLE_4, Scene(), tmp_path / "file", BENT, 1e-3)
    with pytest.raises(InputError, match=r"in this folder: .*(file exists|not a directory)"):
        export(TABLE_4, Scene(), tmp_path / "file" / "below", BENT, 1e-3)
    assert (tmp_path / "file").read_text() == "mine"


def test_an_export_replaces_the_one_before_and_leaves_other_files(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    export(TABLE_4, Scene(), tmp_path, BENT, 1e-3)
    before = (tmp_path / "arm.h").read_text()
    found = export(TABLE_4, Scene(), tmp_path, BENT, 1e-6)
    assert {path.name for path in found.files} == FILES
    assert {path.name for path in tmp_path.iterdir()} == FILES | {"mine.txt"}
    assert (tmp_path / "arm.h").read_text() != before
