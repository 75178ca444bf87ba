"""Tracking: each step is as good as a plan from scratch, within limits, and stays on its branch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest

from octoplan.model import Arm, InputError, Scene, settle
from octoplan.model.effects import Extension, Weight
from octoplan.model.extensions.contact import Contact
from octoplan.model.extensions.obstacles import Sphere
from octoplan.model.paths import Array
from octoplan.model.support.errors import SingularError
from octoplan.planner import Limits, Plan, Tracker, load_plan, plan
from octoplan.planner.extensions.base_joints.joints import BaseJoints
from octoplan.planner.extensions.base_joints.placement import JointPlacement
from octoplan.planner.extensions.tracking.quadratic import Linearisation
from octoplan.planner.extensions.tracking.tracker import ITERATIONS, LARGEST_CHANGE
from octoplan.planner.limits import natural_tensions
from octoplan.planner.planning_problem import Environment
from octoplan.planner.targets import (
    BendingPlane,
    MinimumStiffness,
    Target,
    TipPointing,
    TipPosition,
)
from octoplan.planner.targets.base import Terms, View

ARM = Arm.from_paper("table-2")
L = ARM.length
PAPER = Scene(Extension())
SILICONE = Scene.silicone(Weight())
UPRIGHT = Scene(Extension(), Weight(g=(-9.81 * 0.22, 0.0, 0.0)))
PULLS = np.array([0, 0.6, 0.9, 0, 0, 0.4, 0.4, 0, 0.6, 0, 0, 0.5])


@cache
def begin(scene: Scene) -> np.ndarray:
    """Return a place within reach."""
    return settle(ARM, PULLS, scene).tip


START = begin(PAPER)


def circle(scene: Scene, count: int, last: int | None = None) -> list[TipPosition]:
    """Return targets on a circle with a radius of 4 % of the arm's length."""
    angle = np.linspace(0.0, 2 * np.pi, count)[1:last]
    offset = np.column_stack([0 * angle, np.cos(angle) - 1, np.sin(angle)])
    return [TipPosition(begin(scene) + 0.04 * L * each) for each in offset]


def moved(x: float, y: float, z: float) -> TipPosition:
    return TipPosition(START + np.array([x, y, z]))


@cache
def start(scene: Scene, **options: Any) -> Plan:
    return plan(ARM, TipPosition(begin(scene)), scene, **options or {"tension_max": 20.0})


def difference(T: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(T - other).max() / np.abs(other).max())


def check_equal_to_plans(scene: Scene, targets: list[TipPosition], every: int) -> None:
    tracker = Tracker(start(scene))
    for i, target in enumerate(targets):
        step = tracker.step(target)
        assert step.reached, step.outcome
        assert step.optimal
        assert step.iterations <= ITERATIONS
        assert np.linalg.norm(step.shape.tip - np.array(target.position)) < 1e-6 * L
        if i % every == every - 1:
            afresh = plan(ARM, target, scene, 20.0)
            effort = np.linalg.norm(step.tensions)
            assert effort == pytest.approx(afresh.effort, rel=1e-4)
            assert difference(step.tensions, afresh.tensions) < 1e-4


@pytest.mark.parametrize("scene", [Scene(), PAPER, SILICONE], ids=["bending", "paper", "silicone"])
def test_steps_equal_plans_from_scratch(scene: Scene) -> None:
    check_equal_to_plans(scene, circle(scene, 300, 5), 4)


@pytest.mark.slow
@pytest.mark.parametrize("scene", [Scene(), PAPER, SILICONE], ids=["bending", "paper", "silicone"])
def test_steps_equal_plans_along_300_targets(scene: Scene) -> None:
    check_equal_to_plans(scene, circle(scene, 300), 23)


def test_a_step_keeps_the_rates_of_tensions() -> None:
    tracker = Tracker(start(PAPER), rate=100.0, rate_max=4.0)
    target = moved(-0.01, 0.02, 0.01)
    before = tracker.tensions
    for _ in range(40):
        step = tracker.step(target)
        assert np.abs(step.tensions - before).max() <= 0.04 * (1 + 1e-9)
        before = step.tensions
        if step.optimal:
            break
        if not step.reached:
            assert "at its largest rate, 0.04 N in a step" in step.held_back
            assert step.held_back in step.outcome
    assert step.reached
    assert not step.held_back
    assert difference(tracker.tensions, plan(ARM, target, PAPER, 20.0).tensions) < 1e-4


def test_a_step_keeps_the_rates_of_strokes() -> None:
    tracker = Tracker(start(PAPER), rate=100.0, stroke_rate_max=0.1)
    target = moved(-0.01, 0.02, 0.01)
    before = tracker.shape.tendon_lengths
    for _ in range(20):
        step = tracker.step(target)
        assert np.abs(step.shape.tendon_lengths - before).max() <= 1e-3 * (1 + 1e-8)
        before = step.shape.tendon_lengths
        if step.reached:
            break
        assert "rate" in step.held_back
    assert step.reached


def test_far_targets_keep_the_rates_of_strokes() -> None:
    tracker = Tracker(start(PAPER), rate=1.0, stroke_rate_max=0.01)
    before = tracker.shape.tendon_lengths
    for _ in range(4):
        step = tracker.step(TipPosition((1e3, 0.0, 0.0)))
        assert np.abs(step.shape.tendon_lengths - before).max() <= 0.01 * (1 + 1.1e-9)
        before = step.shape.tendon_lengths


def test_a_step_without_linearisation_keeps_the_shape(monkeypatch: pytest.MonkeyPatch) -> None:
    def buckles(*_: object) -> None:
        raise SingularError("the arm buckles")

    tracker = Tracker(start(PAPER))
    before = tracker.tensions
    monkeypatch.setattr(Linearisation, "at", buckles)
    step = tracker.step(moved(0.0, 0.01, 0.0))
    assert np.array_equal(step.tensions, before)
    assert not step.reached
    assert "the branch of equilibria" in step.held_back


def test_a_target_out_of_reach_ends_at_the_nearest_shape() -> None:
    tracker = Tracker(start(PAPER))
    beyond = TipPosition((1.0, 0.4, 0.0))
    for _ in range(20):
        step = tracker.step(beyond)
        assert not step.reached
        assert "Not reached" in step.outcome
    nearest = plan(ARM, beyond, PAPER, 20.0)
    miss = np.linalg.norm(step.shape.tip - np.array(beyond.position))
    assert miss == pytest.approx(np.linalg.norm(nearest.tip - np.array(beyond.position)), rel=1e-6)
    assert step.residuals["tip position"] == pytest.approx(miss)
    assert step.residual == pytest.approx(miss / ARM.length)
    # The arm returns to its target.
    for _ in range(20):
        step = tracker.step(TipPosition(START))
        if step.reached:
            break
    assert step.reached


def test_a_limit_of_tensions_holds_the_arm_back_and_is_named() -> None:
    limited = start(PAPER, tension_max=1.05 * start(PAPER).tensions.max())
    tracker = Tracker(limited)
    target = moved(-0.08, 0.06, -0.06)
    for _ in range(10):
        step = tracker.step(target)
    assert not step.reached
    assert "at its maximum of" in step.held_back
    assert step.tension_reserve.min() == pytest.approx(0.0, abs=1e-6)
    assert np.isinf(step.pull_reserve)
    assert step.stroke_reserve is None


def test_total_pull_and_strokes_stay_within_limits() -> None:
    total = 1.02 * float(start(PAPER).tensions.sum())
    stroke = 1.02 * float(start(PAPER).strokes.max())
    target = TipPosition(1.2 * START * [0.2, 1.0, 1.0])
    for limits in (Limits(20.0, total_pull=total), Limits(20.0, stroke_max=stroke)):
        tracker = Tracker(start(PAPER, limits=limits))
        for _ in range(8):
            step = tracker.step(target)
        assert not step.reached
        name = "the total pull" if limits.total_pull else "the stroke of T_"
        assert name in step.held_back
        assert step.pull_reserve > -1e-9
        if step.stroke_reserve is not None:
            assert step.stroke_reserve.min() > -1e-6 * L
            assert step.stroke_reserve.max() > 0


def test_a_branch_of_optima_that_ends_is_left_in_small_steps_that_say_so() -> None:
    """An arm held out nearly straight falls to the other side, see tests/warm_start."""
    arm = Arm.from_paper("table-4")
    target = TipPosition((0.44, -0.01, 0.0))
    tracker = Tracker(plan(arm, TipPosition((0.44, 0.01, 0.0)), PAPER, 20.0))
    largest = LARGEST_CHANGE * natural_tensions(arm)
    before = tracker.tensions
    for _ in range(6):
        step = tracker.step(target)
        change = np.abs(step.tensions - before).ravel()
        assert np.all(change <= largest * (1 + 1e-9))
        if np.linalg.norm(change) > 0.25 * np.linalg.norm(before):
            assert "tensions change by" in step.outcome
            assert step.jump > 0.25
        before = step.tensions
    assert step.reached
    assert np.linalg.norm(before) == pytest.approx(plan(arm, target, PAPER, 20.0).effort, rel=1e-4)


def test_the_arm_stays_on_its_stable_branch_at_the_margin() -> None:
    first = plan(ARM, TipPosition((0.75 * L, 0.4 * L, 0)), UPRIGHT, 20.0, stability_margin=0.34)
    tracker = Tracker(first)
    shape = tracker.shape
    said = list[str]()
    for y in np.linspace(0.44, 0.62, 4):
        step = tracker.step(TipPosition(((0.9 - (y - 0.1) / 2) * L, y * L, 0.0)))
        assert step.stability > 0.34 - 2e-3
        # Continuation of equilibria in small steps of the tensions leads to the same shape.
        along = settle(ARM, step.tensions, UPRIGHT, near=shape)
        assert np.linalg.norm(along.tip - step.shape.tip) < 1e-5 * L
        shape = step.shape
        said.append(step.held_back)
    assert any("the stability at its margin of 0.34" in each for each in said)


@pytest.mark.parametrize("norm", ["1", "inf"])
def test_other_norms_and_pointing_targets_are_tracked(norm: str) -> None:
    direction = settle(ARM, start(PAPER).tensions, PAPER).tip_frame[:, 0]
    target = TipPointing(START, direction)
    tracker = Tracker(plan(ARM, target, PAPER, 20.0, norm=norm))
    after = TipPointing(START + np.array([0.0, 1e-3, 0.0]), direction)
    for _ in range(4):
        step = tracker.step(after)
    assert step.reached, step.outcome
    afresh = plan(ARM, after, PAPER, 20.0, norm=norm)
    effort = np.linalg.norm(step.tensions.ravel(), float(norm))
    assert effort == pytest.approx(afresh.effort, rel=1e-4)


def test_a_loaded_plan_is_tracked_like_the_plan(tmp_path: Any) -> None:
    loaded = load_plan(start(PAPER).save(tmp_path / "plan.json"))
    target = moved(0.0, 1e-3, 0.0)
    steps = [Tracker(each).step(target) for each in (loaded, start(PAPER))]
    assert difference(steps[0].tensions, steps[1].tensions) < 1e-6
    assert str(steps[0]) == steps[0].outcome


@pytest.mark.slow
def test_compiled_steps_equal_interpreted_steps() -> None:
    target = moved(0.0, 1e-3, 0.0)
    compiled = Tracker(start(SILICONE), compile=True).step(target)
    assert difference(compiled.tensions, Tracker(start(SILICONE)).step(target).tensions) < 1e-9


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"rate_max": 1.0}, r"rate = None: must be the number of steps per second \[Hz\]"),
        ({"rate": 0.0}, "rate = 0.0: must be"),
        ({"rate": 10.0, "rate_max": 0.0}, r"rate_max = 0.0: must be a number above 0"),
        ({"rate": 10.0, "rate_max": [1.0, 2.0]}, "rate_max"),
        ({"rate": 10.0, "stroke_rate_max": -1.0}, "stroke_rate_max = -1.0: must be"),
        ({"compile": "yes"}, "compile = 'yes': must be"),
    ],
)
def test_unsuitable_options_are_refused(options: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=text):
        Tracker(start(PAPER), **options)


def unsuitable_plans() -> dict[str, Any]:
    known = start(PAPER)
    target = TipPosition(START)
    sphere = Sphere((0.0, 0.3, 0.0), 0.02)
    joints = JointPlacement(ARM, BaseJoints(insertion=(0.0, 0.01)))
    changes: dict[str, dict[str, Any]] = {
        "a plan that reaches them": {"targets": (moved(0.0, 0.0, 0.01),)},
        "a plan without them": {"environment": Environment((sphere,))},
        "a plan for other targets": {"targets": (target, MinimumStiffness((0, 1, 0), 1.0))},
        "a plan with a fixed base": {"placement": joints},
        "a plan in free space": {"scene": Scene(Extension(), Contact(sphere))},
    }
    plans = {
        allowed: Plan.of(replace(known.problem, **change), known.solution)
        for allowed, change in changes.items()
    }
    return {"a Plan": "plan.json", **plans}


def test_unsuitable_plans_are_refused() -> None:
    for allowed, given in unsuitable_plans().items():
        with pytest.raises(InputError, match=f"plan = .*: must be {allowed}"):
            Tracker(given)


@dataclass(frozen=True)
class Root(Target):
    """The height of the start, and its distance along x, times the root of a parameter."""

    factor: float

    def parameters(self, arm: Arm) -> Array:
        return np.array([self.factor])

    def terms(self, view: View, p: ca.MX) -> Terms:
        off = (view.tip - ca.DM(START)) / view.arm.length
        return Terms(equality={"height": off[2], "along x": ca.sqrt(p[0]) * off[0]})


def test_steps_to_terms_without_a_value_are_not_reached() -> None:
    tracker = Tracker(plan(ARM, Root(1.0), PAPER, 20.0))
    assert not tracker.step(Root(-1.0)).reached
    assert tracker.step(Root(2.0)).reached


def test_plans_without_limits_are_tracked() -> None:
    """The infinite reserve of an infinite limit was refused as a number of the arm."""
    tracker = Tracker(plan(ARM, TipPosition(START), PAPER))
    step = tracker.step(moved(0.0, 0.0, 1e-3))
    assert step.reached
    assert np.isinf(step.tension_reserve).all()


@pytest.mark.parametrize(
    "target", [TipPointing(START, (1, 0, 0)), (TipPosition(START), BendingPlane(0.5, 1.2, 1))]
)
def test_targets_of_another_kind_are_refused(target: Target) -> None:
    tracker = Tracker(start(PAPER))
    before = tracker.tensions
    with pytest.raises(InputError, match="must be like the targets of the plan: TipPosition"):
        tracker.step(target)
    assert np.array_equal(tracker.tensions, before)
