"""Limits and norms have their documented effect; out of reach, plans return the nearest shape."""

import pickle
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, InputError, Scene, settle
from octoplan.planner import plan
from octoplan.planner.limits import Limits
from octoplan.planner.targets import BendingPlane, TipPosition
from tests.core.planner.cases import PAPER, moderate, paper_tip

ARM = Arm.from_paper("table-4")
TARGET = TipPosition(paper_tip(ARM, moderate()))


def test_each_norm_is_least_in_its_own_measure() -> None:
    plans = {norm: plan(ARM, TARGET, PAPER, 20.0, norm=norm).tensions for norm in ("2", "1", "inf")}
    measures = {"2": np.linalg.norm, "1": np.sum, "inf": np.max}
    for norm, measure in measures.items():
        least = measure(plans[norm])
        assert all(least <= measure(T) * (1 + 1e-7) for T in plans.values())
    assert plans["1"].sum() < 0.999 * plans["inf"].sum()


def test_a_total_pull_may_be_the_sum_of_the_minima() -> None:
    """Due to rounding 12 times 0.1 is above 1.2: the limit was refused, "must be 1.2 N"."""
    held = plan(ARM, TARGET, PAPER, 20.0, limits=Limits(tension_min=0.1, total_pull=1.2))
    assert held.tensions == pytest.approx(np.full((3, 4), 0.1), abs=1e-8)


def test_a_total_pull_is_kept_and_costs_effort() -> None:
    free = plan(ARM, TARGET, PAPER, 20.0)
    limit = 0.5 * (free.tensions.sum() + plan(ARM, TARGET, PAPER, 20.0, norm="1").tensions.sum())
    held = plan(ARM, TARGET, PAPER, 20.0, limits=Limits(total_pull=limit))
    assert held.certificate.passed
    assert held.tensions.sum() <= limit * (1 + 1e-9)
    assert held.effort > free.effort


def test_minima_are_kept_and_so_are_tendons_that_are_fixed() -> None:
    low, high = np.full((3, 4), 0.01), np.full((3, 4), 20.0)
    low[1, 1] = high[1, 1] = 0.3
    found = plan(ARM, TARGET, PAPER, high, limits=Limits(tension_min=low))
    assert found.certificate.passed
    assert found.tensions[1, 1] == 0.3
    assert found.tensions.min() >= 0.01


def test_tendons_with_a_maximum_of_zero_stay_slack() -> None:
    high = np.zeros((3, 4))
    high[1] = high[2] = 20.0
    found = plan(ARM, TARGET, PAPER, high)
    assert found.certificate.passed
    assert not found.tensions[0].any()


@pytest.mark.quick("most0", "most1")
@pytest.mark.parametrize(
    "most", [(), (1e308,), ([np.inf] * 12,), ([[20.0, np.inf, 1e9, 1e25]] * 3,)]
)
def test_maxima_of_any_size_that_never_hold_do_not_matter(most: tuple[Any, ...]) -> None:
    free = plan(ARM, TARGET, PAPER, 20.0)
    assert plan(ARM, TARGET, PAPER, *most).effort == pytest.approx(free.effort)


@pytest.mark.parametrize("most", [1e-9, 1e-100, 5e-324, 0.0])
def test_maxima_that_do_nothing_hold_everything_back(most: float) -> None:
    found = plan(ARM, TARGET, PAPER, most)
    assert not found.reached and found.tensions.max() <= most
    assert ("at its maximum" if most else "Not reached") in found.outcome


@pytest.mark.slow
def test_starts_are_counted_and_their_agreement_too() -> None:
    found = plan(ARM, TARGET, PAPER, 20.0)
    assert 1 <= found.solution.n_equal_optima <= len(found.solution.starts) <= 8
    for count in (1, 8, 11):
        assert len(plan(ARM, TARGET, PAPER, 20.0, starts=count).solution.starts) == count


def test_a_tension_limit_that_holds_is_named() -> None:
    free = plan(ARM, TipPosition((0.25, 0.3, 0.0)), PAPER, 20.0)
    assert free.certificate.passed
    held = plan(ARM, TipPosition((0.25, 0.3, 0.0)), PAPER, 0.2)
    assert not held.certificate.passed
    assert "at its maximum of 0.2 N" in held.outcome
    assert held.certificate.bounds == 0


@pytest.mark.quick("1")
@pytest.mark.parametrize("seed", range(4))
def test_the_nearest_point_is_no_farther_than_any_of_many_drawn(seed: int) -> None:
    rng = np.random.default_rng(seed)
    point = rng.normal(size=3)
    point *= 0.6 / np.linalg.norm(point)
    found = plan(ARM, TipPosition(tuple(point)), PAPER, 5.0)
    gap = np.linalg.norm(found.shape.tip - point)
    for _ in range(60):
        T = rng.uniform(size=(3, 4)) * (rng.uniform(size=(3, 4)) < 0.4) * [[0.2], [3], [5]]
        drawn = settle(ARM, T, PAPER, 1e-5).tip
        assert np.linalg.norm(drawn - point) > gap - 1e-6


def test_too_much_bend_keeps_the_plane_and_bends_as_far_as_it_goes() -> None:
    found = plan(ARM, BendingPlane(0.0, np.pi, 3), PAPER, 5.0)
    assert not found.reached
    assert found.certificate.equality["bending plane"] < 1e-6
    assert found.tensions[2].tolist() == pytest.approx([0, 5, 0, 0])


@pytest.mark.slow
def test_a_bare_arm_bends_where_an_arm_with_extension_would_be_crushed() -> None:
    arm = Arm.from_paper("table-2")
    target = BendingPlane(np.radians(20), np.pi, 3)
    assert plan(arm, target, Scene()).reached
    crushed = plan(arm, target, PAPER)
    assert not crushed.reached
    assert crushed.shape.strain(0.093)[3] > -1


def test_a_minimum_that_holds_is_named() -> None:
    straight = plan(
        ARM, TipPosition((ARM.length, 0.0, 0.0)), PAPER, 20.0, limits=Limits(tension_min=0.1)
    )
    assert not straight.reached
    assert "at its minimum of 0.1 N" in straight.outcome and "out of reach" not in straight.outcome


def test_limits_are_values_that_pickle() -> None:
    rows = np.array([[1.0, 2.0], [3.0, np.inf]])
    limits = Limits(tension_max=rows, stroke_min=[-0.01, -0.02])
    assert limits == Limits(((1.0, 2.0), (3.0, np.inf)), stroke_min=(-0.01, -0.02))
    assert pickle.loads(pickle.dumps(limits)) == limits
    assert len({limits, Limits(rows.tolist(), stroke_min=(-0.01, -0.02))}) == 1


def test_the_largest_tension_may_be_among_the_limits() -> None:
    alone = plan(ARM, TARGET, PAPER, limits=Limits(tension_max=20.0))
    assert np.array_equal(alone.tensions, plan(ARM, TARGET, PAPER, 20.0).tensions)


def test_a_largest_tension_that_is_given_twice_is_refused() -> None:
    with pytest.raises(InputError, match=r"limits.tension_max = 20.0: must be omitted if"):
        plan(ARM, TARGET, PAPER, 20.0, limits=Limits(tension_max=20.0))
    with pytest.raises(InputError, match=r"limits = .*: must be Limits"):
        plan(ARM, TARGET, PAPER, limits={"tension_max": 20.0})  # type: ignore[arg-type]
