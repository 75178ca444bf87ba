"""Arguments of NumPy's types, and generators, do what Python's numbers and lists do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, InputError, Scene, Shape, settle
from octoplan.model.effects import Extension, TipLoad
from octoplan.model.support.machine.compiled import checked_compile
from octoplan.planner import Plan, plan
from octoplan.planner.extensions.tracking.tracker import Tracker
from octoplan.planner.frontends.bodies.files import save_mesh
from octoplan.planner.frontends.bodies.links import ros_messages, urdf
from octoplan.planner.frontends.effect_ablation import switch_effects
from octoplan.planner.frontends.io.csv_files import shape_csv
from octoplan.planner.frontends.io.scene_file import scene_table
from octoplan.planner.frontends.many import plan_many
from octoplan.planner.frontends.sweeps.definition import sweep_of
from octoplan.planner.frontends.sweeps.sweep import check_jobs
from octoplan.planner.targets import TipPosition

ARM = Arm.from_paper("table-4")
SCENE = Scene(Extension())
T = np.array([[0, 0.3, 0, 0], [0, 0, 3, 0], [0, 0, 0, 5.0]])
GOAL = TipPosition((0.2, 0.15, -0.2))
GIVEN = {"arm": ARM, "target": GOAL, "scene": SCENE, "tension_max": 20.0}


@pytest.fixture(scope="module")
def shape() -> Shape:
    return settle(ARM, T, SCENE, 1e-4)


@pytest.fixture(scope="module")
def planned() -> Plan:
    return plan(ARM, GOAL, SCENE, 20.0)


def test_plan_accepts_numpy_options(planned: Plan) -> None:
    options: dict[str, Any] = {
        "starts": np.int64(1),
        "certify": np.False_,
        "compile": np.False_,
        "progress": np.False_,
        "self_clearance": np.False_,
        "clearance": np.int64(0),
    }
    found = plan(**GIVEN, **options)
    assert found.tensions == pytest.approx(planned.tensions, abs=1e-5)


def test_other_calls_accept_numpy_integers(shape: Shape) -> None:
    three = np.int64(3)
    assert shape_csv(shape, three) == shape_csv(shape, 3)
    assert urdf(shape, three) == urdf(shape, 3)
    assert ARM.tendons_of(three) == ARM.tendons_of(3)
    check_jobs(np.int64(-1))
    assert TipLoad((0, 0, 1), follower=np.True_).follower is True
    assert checked_compile(np.False_) is False


# The attempt, and the field that the message names.
NOT_WHOLE: dict[str, tuple[Callable[[Shape, Any], object], str]] = {
    "starts": (lambda _, number: plan(**GIVEN, starts=number), "starts"),
    "jobs": (lambda _, number: check_jobs(number), "jobs"),
    "points": (shape_csv, "points"),
    "links": (urdf, "links"),
    "links of messages": (ros_messages, "links"),
    "rings": (lambda shape, number: save_mesh(shape, Path("arm.stl"), along=number), "along"),
    "repeats": (lambda _, number: switch_effects(ARM, T, SCENE, repeats=number), "repeats"),
}


@pytest.mark.parametrize("number", [2.5, True, np.nan, "3", None, np.array([3])], ids=str)
@pytest.mark.parametrize("attempt", NOT_WHOLE)
def test_numbers_that_are_not_whole_are_refused(shape: Shape, attempt: str, number: Any) -> None:
    function, field = NOT_WHOLE[attempt]
    if number is None and field == "starts":
        return
    with pytest.raises(InputError, match=f"{field} = .*: must be a whole number from"):
        function(shape, number)


def test_targets_may_come_from_generators(planned: Plan) -> None:
    several = {"target": (each for each in [GOAL])}
    assert plan(**GIVEN | several).tensions == pytest.approx(planned.tensions, abs=1e-9)
    (found,) = plan_many(ARM, (iter([each]) for each in [GOAL]), SCENE, 20.0)
    assert found.targets == (GOAL,)
    assert Tracker(planned).step(each for each in [GOAL]).reached
    assert scene_table(ARM, SCENE, iter([GOAL])) == scene_table(ARM, SCENE, [GOAL])
    axes = {"arm.E_kPa": [100.0, 120.0]}
    swept = sweep_of(ARM, axes, SCENE, iter([GOAL]), tension_max=20.0).job
    assert swept == sweep_of(ARM, axes, SCENE, [GOAL], tension_max=20.0).job


def test_sweeps_accept_numpy_integers() -> None:
    axes = {"arm.E_kPa": {"distribution": "uniform", "low": 100.0, "high": 120.0}}
    numbers = {"draws": np.int64(4), "seed": np.int64(3)}
    swept = sweep_of(ARM, axes, SCENE, tensions=T, **numbers)
    assert swept.axes[0].values == pytest.approx(
        sweep_of(ARM, axes, SCENE, tensions=T, draws=4, seed=3).axes[0].values
    )


@pytest.mark.parametrize(
    "target",
    [np.array(3), "tip", {"tip": GOAL}, iter([]), None],
    ids=["array", "text", "dict", "empty iterator", "None"],
)
def test_other_objects_are_no_targets(target: Any) -> None:
    with pytest.raises(InputError, match="must be a target such as TipPosition"):
        plan(**GIVEN | {"target": target})
