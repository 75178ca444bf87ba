"""The exported inverse: follows a moving tip target as Python does, within the limits."""

from __future__ import annotations

import ctypes
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from octoplan.model import Arm, InputError, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, TipLoad
from octoplan.model.extensions.obstacles import Sphere
from octoplan.model.forward import explicit_map
from octoplan.planner import plan
from octoplan.planner.frontends.c_code.export import export_plan
from octoplan.planner.frontends.cli import main
from octoplan.planner.limits import Limits
from octoplan.planner.targets import TipPose, TipPosition
from tests.export.cases import (
    CURVED,
    NO_DOUBLE,
    SECTION_52,
    SHORT,
    STRICT,
    TABLE_4,
    Library,
)
from tests.oracles import Array

PAPER = Scene(Extension())
LOADED = Scene(TipLoad((0.0, 0.0, 1e-4)))
OK, CRUSHED, OUT_OF_REACH = 0, 1, 2
START = np.array([0, 0, 0.2, 0, 0, 0.4, 0, 0, 0, 0, 1.0, 0])


class Report(ctypes.Structure):
    """The report of `arm_plan` about its search."""

    _fields_ = [
        ("residual", ctypes.c_double),
        ("slope", ctypes.c_double),
        ("iterations", ctypes.c_int),
    ]


class Inverse(Library):
    """An exported inverse, called through ctypes."""

    def __init__(self, folder: Path, p: Any, accuracy: float) -> None:
        self.shape = export_plan(p, folder, accuracy).shape
        super().__init__(folder, "arm", p.arm.n_tendons, self.shape.s.size, "double")

    def plan(self, target: Any, tensions: Any) -> tuple[int, Array, Report]:
        """Return the code, tensions (n_tendons,) and the report."""
        T, report = self._given(tensions).copy(), Report()
        given = (self._pointer(self._given(target)), self._pointer(T), ctypes.byref(report))
        return self._function("plan")(*given), T, report

    def hessian(self, tensions: Any, weight: Any) -> Array:
        """Return the second derivatives of weight . tip (n_tendons, n_tendons)."""
        found = np.zeros((self._tendons, self._tendons))
        assert self._call("hessian", tensions, self._given(weight), found) == OK
        return found


def planned(arm: Arm, T: Any, scene: Scene = PAPER, upper: Any = 20.0, **options: Any) -> Any:
    """Return the plan for the tip that tensions settle in."""
    return plan(arm, TipPosition(tuple(settle(arm, T, scene).tip)), scene, upper, **options)


@pytest.fixture(scope="module")
def first() -> Any:
    """The plan of table 4 that the inverse begins from, with maxima that matter."""
    return planned(TABLE_4, START, upper=2.0)


@pytest.fixture(scope="module")
def inverse(first: Any, tmp_path_factory: pytest.TempPathFactory) -> Inverse:
    return Inverse(tmp_path_factory.mktemp("inverse"), first, 1e-6)


@pytest.mark.slow
def test_second_derivatives_are_those_of_the_map(inverse: Inverse) -> None:
    function = explicit_map(TABLE_4, PAPER, inverse.shape.refinement).function
    T, weight = ca.MX.sym("T", 12), np.array([0.3, -1.0, 0.7])
    tip = function(T)[0][4:, -1]
    exact = ca.Function("exact", [T], [ca.hessian(ca.dot(weight, tip), T)[0]])
    for scale in (1.0, 0.3):
        wanted = np.array(exact(scale * START))
        off = np.abs(inverse.hessian(scale * START, weight) - wanted).max()
        assert off <= 1e-12 * np.abs(wanted).max()


def test_a_path_is_followed_as_python_follows_it(inverse: Inverse, first: Any) -> None:
    place, T, near = np.array(first.targets[0].position), np.ravel(first.tensions), first
    rng, way = np.random.default_rng(5), np.zeros(3)
    for i in range(40):
        way = 0.8 * way + 0.6 * rng.normal(size=3)
        place = place + 2e-3 * way / max(1.0, float(np.linalg.norm(way)))
        code, T, report = inverse.plan(place, T)
        assert code == OK
        assert np.all((T >= 0) & (T <= 2.0))
        assert report.residual <= 1e-9 * TABLE_4.length
        assert report.iterations <= 6
        if i % 8 == 7:
            near = plan(TABLE_4, TipPosition(tuple(place)), PAPER, 2.0, near=near)
            tip = settle(TABLE_4, T, PAPER, 1e-9).tip
            assert np.linalg.norm(tip - near.tip) <= 1e-6 * TABLE_4.length
            assert np.abs(T - np.ravel(near.tensions)).max() <= 1e-4 * near.effort


def test_what_is_out_of_reach_is_approached_and_left_again(inverse: Inverse, first: Any) -> None:
    home = np.array(first.targets[0].position)
    far = plan(TABLE_4, TipPosition((0.1, 0.43, 0.1)), PAPER, 2.0)
    assert far.mode != "exact"
    T = np.ravel(far.tensions)
    code, T, report = inverse.plan(far.targets[0].position, T)
    assert code == OUT_OF_REACH
    assert np.all((T >= 0) & (T <= 2.0))
    tip = settle(TABLE_4, T, PAPER, 1e-9).tip
    wanted = float(np.linalg.norm(far.tip - far.targets[0].position))
    assert np.linalg.norm(tip - far.targets[0].position) == pytest.approx(wanted, rel=1e-4)
    assert report.residual == pytest.approx(wanted, rel=1e-4)
    for share in np.linspace(0, 1, 20):
        code, T, report = inverse.plan(far.tip + share * (home - far.tip), T)
    assert code == OK
    assert report.residual <= 1e-9 * TABLE_4.length


@pytest.mark.parametrize(
    ("target", "tensions"),
    [((np.nan, 0.1, 0.1), START), ((0.2, 0.1, 0.1), np.full(12, np.nan))],
)
def test_what_is_no_number_is_told_and_changes_nothing(
    inverse: Inverse, target: Any, tensions: Array
) -> None:
    code, T, _ = inverse.plan(target, tensions)
    assert code == CRUSHED
    assert np.array_equal(T, np.asarray(tensions), equal_nan=True)


def test_only_the_headers_names_are_seen_and_nothing_but_arithmetic_is_called(
    inverse: Inverse,
) -> None:
    nm = shutil.which("nm") or pytest.skip("nm is not installed")
    shown = subprocess.run([nm, "-D", inverse.path], capture_output=True, text=True, check=True)
    names = [line.split()[-2:] for line in shown.stdout.splitlines()]
    given = {name for kind, name in names if kind in "TRDB"}
    functions = {"tip", "nodes", "jacobian", "hessian", "plan"}
    tables = {"s", "tension_min", "tension_max", "first_target", "first_tension"}
    assert given == {f"arm_{name}" for name in functions | tables}
    asked = {name.split("@")[0] for kind, name in names if kind == "U"}
    assert asked <= {"sin", "cos", "sincos", "sqrt", "memcpy", "memset", "memmove"}


CASES = {
    "short tendons": (SHORT, PAPER, [0.6, 0.0, 0.2, 1.0, 0.0], "double", 1e-6),
    "single precision": (TABLE_4, PAPER, START, "float", 1e-4),
    "bending alone": (TABLE_4, Scene(), START, "double", 1e-6),
    "exact tendons": (SECTION_52, Scene(Extension(), ExactTendons()), None, "double", 1e-6),
}


@pytest.mark.quick("single precision")
@pytest.mark.parametrize("name", CASES)
def test_other_arms_and_numbers_agree_with_their_test_vectors(name: str, tmp_path: Path) -> None:
    arm, scene, T, precision, accuracy = CASES[name]
    given = [0.3, 0.2, 0.0, 0.0] if T is None else T
    export_plan(planned(arm, given, scene), tmp_path, accuracy, precision)  # type: ignore[arg-type]
    make = shutil.which("make") or pytest.skip("make is not installed")
    flags = f"CFLAGS=-O0 {' '.join([*STRICT, *NO_DOUBLE * (precision == 'float')])}"
    done = subprocess.run(
        [make, "-C", tmp_path, "check", flags], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count(": agrees\n") > 6
    assert "DISAGREES" not in done.stdout


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: planned(TABLE_4, START, limits=Limits(total_pull=40.0)), "total_pull"),
        (lambda: planned(TABLE_4, START, norm="1"), "norm"),
        (
            lambda: plan(TABLE_4, TipPosition((0.1, 0.44, 0.1)), PAPER, 2.0, starts=1),
            "target",
        ),
        (lambda: planned(TABLE_4, START, obstacles=[Sphere((1.0, 1.0, 1.0), 0.1)]), "obstacles"),
        (
            lambda: planned(SECTION_52, [0.1, 0, 0, 0], LOADED, starts=1),
            "scene",
        ),
        (lambda: planned(CURVED, [0.6, 0.0, 0.2, 1.0, 0.0]), "scene"),
        (
            lambda: plan(
                TABLE_4,
                TipPose(
                    tuple(settle(TABLE_4, START, PAPER).tip),
                    tuple(map(tuple, settle(TABLE_4, START, PAPER).tip_frame)),
                ),
                PAPER,
                20.0,
                starts=1,
            ),
            "target",
        ),
    ],
    ids=["total", "norm", "far", "obstacles", "loads", "curved", "pose"],
)
def test_what_has_no_inverse_is_refused_by_name(make: Any, field: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        export_plan(make(), tmp_path / "out")
    assert caught.value.field == field
    assert list(tmp_path.iterdir()) == []


SCENE = """
[arm]
preset = "table-4"
[effects]
extension = true
[target]
type = "tip-position"
position_mm = [250, 60, -90]
"""


def test_the_command_writes_the_inverse_of_a_scene(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "reach.toml"
    scene.write_text(SCENE)
    command = ["export", str(scene), "--what", "plan", "--to", str(tmp_path / "c")]
    assert main(command) == 2
    assert "[limits]" in capsys.readouterr().err
    assert not (tmp_path / "c").exists()
    scene.write_text(SCENE + "[limits]\ntension_max = 5.0\n")
    assert main([*command, "--precision", "float", "--accuracy", "1e-4", "--json"]) == 0
    names = {Path(file).name for file in json.loads(capsys.readouterr().out)["files"]}
    assert names == {
        *("reach.h", "reach.c", "test_vector.h", "main.c", "Makefile"),
        *("reach_plan.h", "reach_plan.c", "plan_vector.h", "plan_main.c"),
    }
    assert {path.name for path in (tmp_path / "c").iterdir()} == names
