"""Kinks of constraints: where they are, and whether a point at one is a local optimum."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from octoplan.planner.extensions.contact.grasp import Grasp
from octoplan.planner.extensions.contact.kinks import Kink, after_step
from octoplan.planner.extensions.contact.optimum import Progress, best_step, conditions
from octoplan.planner.extensions.contact.program import Constraints

# The constraint T0 = 3 + BELOW max(1 - T1, 0) + above max(T1 - 1, 0) has a kink at T1 = 1.
BELOW = 1.0
AT_KINK = (3.0, 1.0)


def constraints(T: tuple[float, float], above: float) -> Constraints:
    """Return the constraint at tensions, linearised on their side of the kink."""
    beyond = T[1] > 1
    value = T[0] - 3 - BELOW * max(1 - T[1], 0) - above * max(T[1] - 1, 0)
    equal = np.array([[value, 1.0, -above if beyond else BELOW]])
    return Constraints(
        point=None,  # type: ignore[arg-type]
        tensions=np.array(T),
        room=np.full((2, 2), 10.0),
        equal=equal,
        unequal=np.array([[1.0, 0.0, 0.0]]),
        grasp=Grasp.joined([]),
        grasp_rates=np.zeros((0, 2)),
        tangential=np.zeros(0),
    )


def least_effort(above: float) -> float:
    """Return T1 of the least effort along the constraint, by a search in one variable."""

    def effort(second: float) -> float:
        first = 3 + BELOW * max(1 - second, 0) + above * max(second - 1, 0)
        return float(np.hypot(first, second))

    return float(minimize_scalar(effort, bounds=(0, 4), options={"xatol": 1e-9}).x)


@pytest.mark.parametrize("here", [0.2, 1.0])
@pytest.mark.parametrize("there", [1.3, 2.0])
def test_two_points_locate_the_kink_between_them(here: float, there: float) -> None:
    kink = Kink.between(constraints((2.5, here), 0.5), constraints((3.1, there), 0.5))
    assert kink is not None
    assert kink.normal == pytest.approx([0, 1], abs=1e-12)
    assert kink.offset == pytest.approx(1 - here, abs=1e-12)
    assert kink.jump[0] == pytest.approx(-0.5 - BELOW, abs=1e-12)


def test_points_on_one_side_have_no_kink_between_them() -> None:
    assert Kink.between(constraints((3.0, 0.2), 0.5), constraints((2.0, 0.5), 0.5)) is None


@pytest.mark.parametrize("above", [-0.2, 0.5])
def test_no_step_from_a_least_effort_at_a_kink_is_a_descent(above: float) -> None:
    assert least_effort(above) == pytest.approx(1.0, abs=1e-6)
    at = constraints(AT_KINK, above)
    kink = Kink.between(at, constraints((3.0, 1.5), above))
    assert kink is not None
    assert conditions(at).residual > 0.1
    assert conditions(at, (kink,)).residual < 1e-8


def test_a_step_beyond_a_kink_that_is_no_optimum_leads_to_the_least_effort() -> None:
    """Clarke's condition is met at the kink: two gradients span the plane."""
    above = -2.0
    least = least_effort(above)
    assert least > 1.5
    at = constraints(AT_KINK, above)
    kink = Kink.between(at, constraints((3.0, 1.5), above))
    assert kink is not None
    assert conditions(at, (kink,)).residual > 0.1
    step = best_step(at, (kink,), np.eye(2), np.full(2, 5.0), 10.0)
    assert at.tensions + step.change == pytest.approx([3 + above * (least - 1), least], abs=1e-5)


def test_a_step_from_one_side_ends_at_the_kink() -> None:
    at = constraints((3.8, 0.2), 0.5)
    kink = Kink.between(at, constraints((3.0, 1.5), 0.5))
    assert kink is not None
    step = best_step(at, (kink,), np.eye(2), np.full(2, 5.0), 10.0)
    assert at.tensions + step.change == pytest.approx(AT_KINK, abs=1e-6)


def test_a_kink_is_seen_from_the_other_side_after_a_step() -> None:
    at, there = constraints((3.0, 0.2), 0.5), constraints((3.0, 1.5), 0.5)
    kink = Kink.between(at, there)
    assert kink is not None
    (turned,) = after_step((kink,), at, there)
    assert turned.normal == pytest.approx([0, -1], abs=1e-12)
    assert turned.offset == pytest.approx(0.5, abs=1e-12)
    assert turned.jump == pytest.approx(kink.jump, abs=1e-12)


def test_attempts_without_progress_are_counted() -> None:
    """A guess from which the constraints cannot be met took a hundred steps."""
    far, near = constraints((1.0, 1.0), 0.5), constraints((1.5, 1.0), 0.5)
    met, heavy = constraints((3.0, 1.0), 0.5), constraints((3.2, 1.4), 0.5)
    progress = Progress.begin(far)
    for at, attempts in ((far, 1), (near, 0), (near, 1), (far, 2), (met, 0), (met, 1), (heavy, 2)):
        progress = progress.after(at)
        assert progress.attempts == attempts
