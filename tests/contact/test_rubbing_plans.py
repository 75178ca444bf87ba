"""Plans of an arm with contact friction, from the plan that the arm moves from."""

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, Weight
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Capsule, HalfSpace
from octoplan.model.support.errors import TimeLimitError
from octoplan.planner import plan, trajectory
from octoplan.planner.targets import TipPosition
from tests.contact.cases import bar

ARM = bar(0.3, 0.006, 2e7)
FLOOR = HalfSpace((0, 0, -0.03), (0, 0, 1))
ROD = Capsule((0.2, -0.15, -0.05), (0.2, 0.15, -0.05), 0.02)
MU, BEFORE, AFTER = 0.3, [1.0, 0.0, 0.0, 0.5], [2.0, 0.0, 0.0, 0.5]
RUBBING = Scene(Extension(), ExactTendons(), Contact(ROD, friction=MU))
PLACE = TipPosition((0.29, 0.0, -0.024))


def on_floor(mu: float) -> Scene:
    return Scene(Extension(), ExactTendons(), Weight(), Contact(FLOOR, friction=mu))


@pytest.mark.slow
def test_a_plan_from_another_slips_to_a_place_against_friction_with_least_effort() -> None:
    before = plan(ARM, TipPosition(tuple(settle(ARM, BEFORE, on_floor(0.0)).tip)), on_floor(0.0))
    known = settle(ARM, AFTER, on_floor(MU), 1e-8, near=before.shape)
    goal = TipPosition(tuple(known.tip))
    found = plan(ARM, goal, on_floor(MU), 30.0, near=before)
    assert found.reached, str(found.certificate)
    assert np.linalg.norm(found.tip - known.tip) < 1e-6 * ARM.length
    assert found.effort < np.linalg.norm(AFTER) * (1 + 1e-5)
    assert found.effort > 1.1 * plan(ARM, goal, on_floor(0.0), 30.0, near=before).effort
    (touch,) = found.shape.contacts
    N = touch.force - touch.friction
    assert np.linalg.norm(touch.friction) == pytest.approx(MU * np.linalg.norm(N), rel=1e-8)
    assert touch.friction @ touch.slip < 0


@pytest.mark.slow
def test_a_motion_slips_to_a_place_against_friction_and_is_certified_on_its_way() -> None:
    before = plan(ARM, TipPosition(tuple(settle(ARM, BEFORE, on_floor(0.0)).tip)), on_floor(0.0))
    known = settle(ARM, AFTER, on_floor(MU), 1e-8, near=before.shape)
    goal = TipPosition(tuple(known.tip))
    found = trajectory(ARM, [goal], on_floor(MU), 30.0, rate_max=2.0, start=before)
    assert found.certificate.passed, str(found.certificate)
    assert found.certificate.jumps == ()
    assert "period" in found.outcome
    assert found.flat[0] == pytest.approx(np.ravel(before.tensions), abs=1e-12)
    assert np.linalg.norm(found.flat[-1]) < np.linalg.norm(AFTER) * (1 + 1e-5)
    assert np.linalg.norm(found.shapes[-1].tip - known.tip) < 1e-6 * ARM.length
    (touch,) = found.shapes[-1].contacts
    assert touch.friction @ touch.slip < 0


@pytest.mark.slow
def test_a_motion_from_rest_by_twelve_tendons_leans_and_slips_to_its_place() -> None:
    """The target was reported as out of reach, or the search did not end."""
    arm = Arm.from_paper("table-4")
    T = np.zeros((3, 4))
    T[2, :2] = 0.3, 3.0
    known = settle(arm, T, RUBBING, near=settle(arm, 0 * T, RUBBING))
    assert known.contacts
    most, goal = 2 * T + 0.01, TipPosition(tuple(known.tip))
    found = trajectory(arm, [goal], RUBBING, most, rate_max=5.0, accuracy=1e-5)
    assert found.certificate.passed, str(found.certificate)
    assert found.shapes[-1].contacts
    assert np.linalg.norm(found.shapes[-1].tip - known.tip) < 1e-5 * arm.length
    assert np.linalg.norm(found.flat[-1]) < np.linalg.norm(T)


def test_a_motion_that_takes_longer_than_it_may_says_so() -> None:
    with pytest.raises(TimeLimitError, match="time limit"):
        trajectory(ARM, [PLACE], on_floor(0.0), 30.0, rate_max=2.0, time_limit=1e-3)
    with pytest.raises(TimeLimitError, match="time limit"):
        trajectory(ARM, [PLACE], Scene(Extension()), 30.0, rate_max=2.0, time_limit=1e-3)


def test_a_plan_that_ends_before_it_begins_to_slip_is_checked_where_the_arm_is() -> None:
    """The load path was empty: the certificate raised "not enough values to unpack"."""
    stopped = plan(ARM, TipPosition((0.2, 0.1, 0.1)), RUBBING, 30.0, time_limit=1e-9)
    assert stopped.solution.stopped
    assert stopped.outcome.startswith("Stopped at the time limit")
    assert not stopped.tensions.any()
