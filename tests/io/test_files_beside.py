"""Files that a scene names, objects in scene keys, and the files of octoplan new."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from octoplan.model import Arm, InputError, Scene
from octoplan.model.effects import Extension
from octoplan.model.extensions.contact.effects import SelfContact
from octoplan.model.extensions.obstacles import Box, Mesh, Moving, Sphere
from octoplan.planner import plan, sweep
from octoplan.planner.frontends.cli import main
from octoplan.planner.frontends.commands.files import Kind
from octoplan.planner.frontends.io.csv_files import plan_csv
from octoplan.planner.frontends.io.scene_file import fill_defaults, load, question_of, scene_table
from octoplan.planner.frontends.sweeps.definition import load_sweep
from octoplan.planner.targets import TipPosition

ARM = Arm.from_paper("table-2")
TETRAHEDRON = Mesh(
    ((0.2, 0.2, 0.2), (0.21, 0.2, 0.2), (0.2, 0.21, 0.2), (0.2, 0.2, 0.21)),
    ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)),
)
SCENE = """
tensions = [0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
[arm]
preset = "table-2"
[[obstacles]]
type = "mesh"
file = "body.off"
position_mm = [200, 200, 200]
"""
SWEEP = """
scene = "deep/scene.toml"
[sweep]
compute = "settle"
[[sweep.axes]]
key = "arm.E_kPa"
values = [100.0]
"""
BODY = "OFF\n4 4 0\n0 0 0\n{0} 0 0\n0 {0} 0\n0 0 {0}\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


def test_a_mesh_of_a_swept_scene_is_found_from_its_folder_and_identifies_the_sweep(
    tmp_path: Path,
) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "scene.toml").write_text(SCENE)
    (tmp_path / "deep" / "body.off").write_text(BODY.format(10))
    (tmp_path / "sweep.toml").write_text(SWEEP)
    asked = load_sweep(tmp_path / "sweep.toml")
    (found,) = question_of(asked.job.scene).options["obstacles"]
    assert np.array(found.vertices) == pytest.approx(np.array(TETRAHEDRON.vertices))
    assert load(tmp_path / "deep" / "scene.toml").options["obstacles"] == [found]
    (tmp_path / "deep" / "body.off").write_text(BODY.format(11))
    assert load_sweep(tmp_path / "sweep.toml").identity != asked.identity


def test_obstacles_are_given_to_sweeps_as_objects() -> None:
    bodies = [Sphere((0.2, 0.2, 0.2), 0.02), Box((0.3, 0.3, 0.0), (0.01, 0.02, 0.03)), TETRAHEDRON]
    table = fill_defaults(scene_table(ARM, Scene(), obstacles=bodies, clearance_mm=2.0), "scene")
    asked = question_of(table).options
    assert [type(own) for own in asked["obstacles"]] == [Sphere, Box, Mesh]
    assert asked["clearance"] == pytest.approx(2e-3)
    moving = Moving(bodies[0], (0.0, 1.0), ((0.0, 0.0, 0.0), (0.0, 0.1, 0.0)))
    told = {"target": TipPosition((0.2, 0.1, 0.05)), "tension_max": 10.0, "obstacles": [moving]}
    with pytest.raises(InputError, match="Moving obstacles only in a trajectory"):
        sweep(ARM, scene=Scene(Extension()), axes={"arm.nu": [0.5]}, **told)


def test_what_a_sweep_does_not_take_is_refused_before_it_begins(tmp_path: Path) -> None:
    target = TipPosition((0.2, 0.1, 0.05))
    given = {"target": target, "tension_max": 10.0, "axes": {"arm.nu": [0.5]}}
    with pytest.raises(InputError, match="SelfContact"):
        sweep(ARM, tmp_path / "a.nc", scene=Scene(Extension(), SelfContact()), **given)
    assert not list(tmp_path.iterdir())


def test_a_plan_as_csv_is_a_tendon_a_line_with_units() -> None:
    found = plan(ARM, TipPosition((0.2, 0.1, 0.05)), Scene(Extension()), 10.0, progress=False)
    rows = list(csv.DictReader(io.StringIO(plan_csv(found).decode())))
    assert [row["tendon"] for row in rows] == [ARM.tendon_name(j) for j in range(ARM.n_tendons)]
    assert [float(row["tension_N"]) for row in rows] == np.ravel(found.tensions).tolist()
    lengths = [1e-3 * float(row["length_mm"]) for row in rows]
    assert lengths == pytest.approx(np.ravel(found.lengths), rel=1e-12)
    strokes = [1e-3 * float(row["stroke_mm"]) for row in rows]
    assert strokes == pytest.approx(np.ravel(found.strokes), abs=1e-15)
    slack = [row["state"] == "slack" for row in rows]
    assert slack == np.ravel(found.shape.slack).tolist()
    assert {row["section"] for row in rows} == {"1", "2", "3"}


@pytest.mark.parametrize("kind", get_args(Kind))
@pytest.mark.quick("sweep", "calibrate")
def test_a_first_file_runs_as_written(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(tmp_path / "first.toml")
    assert main(["new", file, "--kind", kind]) == 0
    assert f"next: octoplan {kind} {file}" in capsys.readouterr().out
    assert "silicone = true" in (tmp_path / "first.toml").read_text()
    assert main([kind, file]) == 0
    assert main(["new", file, "--kind", kind]) == 2


def test_nothing_is_written_over_nor_half_written(tmp_path: Path) -> None:
    (tmp_path / "arm_shapes.csv").write_text("mine")
    assert main(["new", str(tmp_path / "arm.toml"), "--kind", "calibrate"]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["arm_shapes.csv"]
