"""Plans along a path: each starts at the last plan, and is as good as a plan from scratch."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, OctoplanError, Scene, settle
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, Weight
from octoplan.planner import Plan, plan, plan_many
from octoplan.planner.frontends.many import FailedPlan
from octoplan.planner.targets import Bend, BendingPlane, Fetch, Target, TipPosition

ARM, PAPER = Arm.from_paper("table-4"), Scene(Extension())
FIRST = np.array([0, 0, 0.2, 0, 1, 0, 0, 0, 0, 2, 0, 0.0])
LAST = np.array([0, 0.1, 0.3, 0, 1.5, 0, 0, 0.6, 0, 1.2, 1, 0.0])


@cache
def path(count: int) -> tuple[TipPosition, ...]:
    shares = np.linspace(0, 1, count)
    return tuple(TipPosition(settle(ARM, FIRST + u * (LAST - FIRST), PAPER).tip) for u in shares)


@cache
def followed(count: int, accuracy: float = 1e-6) -> tuple[Plan, ...]:
    return tuple(plan_many(ARM, path(count), PAPER, 20.0, accuracy=accuracy))


@pytest.mark.slow
def test_a_followed_plan_is_the_optimum_that_a_search_finds() -> None:
    for target, found in zip(path(4), followed(4, 1e-8), strict=True):
        afresh = plan(ARM, target, PAPER, 20.0, accuracy=1e-8)
        assert found.effort == pytest.approx(afresh.effort, rel=1e-6)


@pytest.mark.slow
def test_plans_along_a_path_need_no_search_and_tendons_go_slack_on_the_way() -> None:
    along = followed(12)
    assert all(found.reached for found in along)
    assert len(along[0].solution.starts) > 1
    assert [len(found.solution.starts) for found in along[1:]] == [1] * 11
    assert len({tuple(np.ravel(found.tensions) == 0) for found in along}) > 1


def exact_fetch() -> Fetch:
    bends = ((60, 90), (40, -90), (90, 90))
    return Fetch(*(Bend(*np.radians(bend).tolist()) for bend in bends))


@pytest.mark.quick("tip", "plane, whose other tendons are held")
@pytest.mark.parametrize(
    ("target", "scene"),
    [
        (TipPosition((0.3, 0.15, 0.05)), PAPER),
        (BendingPlane(0.5, 1.2, 2), PAPER),
        (exact_fetch(), Scene(Extension(), ExactTendons())),
    ],
    ids=["tip", "plane, whose other tendons are held", "fetch, exact tendons"],
)
def test_co_contraction_follows_the_plan_and_keeps_to_its_way(target: Target, scene: Scene) -> None:
    first = plan(ARM, target, scene, 20.0)
    levels = [first, *(first.co_contract(level) for level in (0.01, 0.05, 0.1))]
    for found, least in zip(levels[1:], (0.01, 0.05, 0.1), strict=True):
        assert found.certificate.passed, found.outcome
        assert len(found.solution.starts) == 1
        assert found.tensions.min() == least
    middles = np.array([found.shape.position(0.5 * ARM.length) for found in levels])
    assert np.linalg.norm(np.diff(middles, axis=0), axis=1).max() < 0.15 * ARM.length
    efforts = [found.effort for found in levels]
    assert efforts == sorted(efforts)


def test_a_target_beyond_the_axis_makes_the_plan_leave_its_branch_and_it_says_so() -> None:
    """Used to jump without a word: an arm held out nearly straight falls to the other side."""
    above = plan(ARM, TipPosition((0.44, 0.01, 0.0)), PAPER, 20.0)
    below = plan(ARM, TipPosition((0.44, -0.01, 0.0)), PAPER, 20.0, near=above)
    assert below.reached
    assert 0.25 < below.solution.jump < 2
    assert (
        f"left the branch of the plan before: tensions jump by {100 * below.solution.jump:.0f} %"
        in (below.outcome)
    )


def test_a_plan_that_is_stopped_while_it_follows_is_the_one_before() -> None:
    near = followed(12)[0]
    stopped = plan(ARM, path(12)[-1], PAPER, 20.0, near=near, time_limit=1e-9)
    assert stopped.solution.stopped
    assert np.array_equal(stopped.tensions, near.tensions)
    assert "time limit" in stopped.outcome


def test_a_plan_with_other_maxima_is_searched_for_afresh() -> None:
    near = followed(12)[0]
    assert len(plan(ARM, path(12)[0], PAPER, 15.0, near=near).solution.starts) > 1


@pytest.mark.slow
def test_a_target_beyond_reach_is_searched_for_afresh() -> None:
    near = followed(12)[0]
    beyond = plan(ARM, TipPosition((0.0, 0.9, 0.0)), PAPER, 20.0, near=near)
    assert beyond.mode == "nearest"
    assert not beyond.reached
    back = plan(ARM, path(12)[1], PAPER, 20.0, near=beyond)
    assert back.reached


def test_another_kind_of_target_is_searched_for_afresh() -> None:
    bend = BendingPlane(angle=0.3, bend=1.0, section=1)
    found = plan(ARM, bend, PAPER, 20.0, near=followed(12)[0])
    assert found.effort == pytest.approx(plan(ARM, bend, PAPER, 20.0).effort, rel=1e-9)
    assert found.reached


def test_a_finer_accuracy_than_before_is_met() -> None:
    rough = plan(ARM, path(12)[0], PAPER, 20.0, accuracy=1e-3)
    fine = plan(ARM, path(12)[1], PAPER, 20.0, accuracy=1e-9, near=rough)
    assert fine.reached
    assert rough.certificate.residual > 1e-9 >= fine.certificate.residual


@pytest.mark.slow
def test_loaded_arms_are_followed() -> None:
    water = Scene(Extension(), Weight(), Buoyancy(1000.0))
    tips = [TipPosition(settle(ARM, FIRST + u * (LAST - FIRST), water).tip) for u in (0.3, 0.4)]
    first, second = plan_many(ARM, tips, water, 20.0)
    assert second.reached
    assert len(second.solution.starts) == 1
    assert second.effort == pytest.approx(plan(ARM, tips[1], water, 20.0).effort, rel=1e-6)
    assert first.reached


@pytest.mark.quick("0.1", "1e-11")
@pytest.mark.parametrize("accuracy", [1e-1, 1e-3, 1e-9, 1e-11])
def test_plans_are_as_accurate_as_asked(accuracy: float) -> None:
    found = plan(ARM, path(12)[5], PAPER, 20.0, accuracy=accuracy)
    assert found.reached
    tip = settle(ARM, found.tensions, PAPER, 1e-12).tip
    assert np.linalg.norm(tip - np.array(path(12)[5].position)) <= accuracy * ARM.length


@pytest.mark.slow
def test_a_long_step_on_one_branch_is_no_jump() -> None:
    near = plan(ARM, path(12)[0], PAPER, 20.0)
    far = plan(ARM, path(12)[-1], PAPER, 20.0, near=near)
    assert far.solution.jump == 0
    assert "branch" not in far.outcome


def test_without_a_path_every_plan_is_searched_for() -> None:
    alone = plan_many(ARM, path(12)[:2], PAPER, 20.0, path=False)
    assert min(len(found.solution.starts) for found in alone) > 1


def test_no_targets_give_no_plans() -> None:
    assert plan_many(ARM, [], PAPER) == []


PLANES = [BendingPlane(2.0, 0.9), BendingPlane(2.0, 1.0, section=7), BendingPlane(2.0, 1.1)]


def test_a_bad_target_does_not_lose_the_others() -> None:
    found = plan_many(ARM, PLANES, PAPER, 20.0, accuracy=1e-5, errors="nan")
    assert [p.reached for p in found] == [True, False, True]
    lost = found[1]
    assert isinstance(lost, FailedPlan)
    assert lost.reason.startswith("targets[1]: section = 7")
    assert lost.outcome == f"Not certified: {lost.reason}."
    assert np.isnan(np.array([p.tip for p in found])).any(axis=1).tolist() == [False, True, False]
    assert np.shape([p.tensions for p in found]) == (3, 3, 4)
    assert np.isnan(lost.lengths).all() and np.isnan(lost.strokes).all() and np.isnan(lost.effort)
    assert lost.reason in repr(lost)
    with pytest.raises(OctoplanError, match="section = 7"):
        _ = lost.shape
    with pytest.raises(OctoplanError, match="section = 7"):
        lost.plot()


def test_an_unforeseen_error_is_that_of_its_target(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(arm: Arm, target: BendingPlane, *more: Any, **others: Any) -> Plan:
        if target.bend == 1.0:
            raise ZeroDivisionError("division by zero")
        return plan(arm, target, *more, **others)

    monkeypatch.setattr("octoplan.planner.frontends.many.plan", fails)
    planes = [BendingPlane(2.0, bend) for bend in (0.9, 1.0)]
    found = plan_many(ARM, planes, PAPER, 20.0, accuracy=1e-5, errors="nan")
    assert [p.reached for p in found] == [True, False]
    assert isinstance(found[1], FailedPlan)
    assert found[1].reason == "ZeroDivisionError: division by zero"
    with pytest.raises(ZeroDivisionError) as raised:
        plan_many(ARM, planes, PAPER, 20.0, accuracy=1e-5)
    assert raised.value.__notes__ == ["the failed target is targets[1]"]


def test_a_plan_of_another_norm_is_not_followed() -> None:
    """The optimum of the other norm was returned."""
    (target,) = path(1)
    near = plan(ARM, target, PAPER, 20.0)
    found = plan(ARM, target, PAPER, 20.0, norm="inf", near=near)
    assert found.problem.options.norm == "inf"
    assert found.tensions.max() < 0.99 * near.tensions.max()
