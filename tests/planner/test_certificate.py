"""The certificate finds out every plan that is spoilt."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from model import Arm
from planner import plan
from planner.targets import TipPosition
from tests.planner.cases import PAPER, moderate, paper_tip

ARM = Arm.from_paper("table-4")
PLAN = plan(ARM, TipPosition(paper_tip(ARM, moderate())), PAPER, 20.0)


def test_a_good_plan_passes_by_an_integrator_that_did_not_make_it() -> None:
    certificate = PLAN.certificate
    assert certificate.passed
    assert certificate.scheme == "rk8"
    # The check is a hundred times as accurate as what it has to judge.
    assert certificate.tolerance == 1e-6
    assert certificate.error <= 1e-8
    assert certificate.residual < 1e-8
    assert certificate.kkt < 1e-8


@pytest.mark.parametrize("j", range(12))
def test_a_tension_changed_by_a_thousandth_fails(j: int) -> None:
    T = PLAN.tensions.ravel().copy()
    T[j] += 1e-3 * max(T[j], 0.05)
    spoilt = replace(PLAN, tensions=T.reshape(3, 4))
    assert not spoilt.certificate.passed
    assert not spoilt.reached
    assert "Not certified" in spoilt.outcome


def test_a_tension_above_its_maximum_fails() -> None:
    from planner import Limits

    tight = replace(PLAN, limits=Limits.of(ARM, PLAN.tensions.max() * 0.999))
    assert any("limit" in failure for failure in tight.certificate.failures)


def test_a_plan_that_meets_its_target_with_needless_effort_fails_as_not_optimal() -> None:
    wasteful = plan(ARM, PLAN.targets, PAPER, 20.0, tension_min=0.05)
    assert wasteful.certificate.passed
    loosened = replace(wasteful, limits=PLAN.limits)
    assert loosened.certificate.residual <= wasteful.accuracy / 10
    assert any("optimality" in failure for failure in loosened.certificate.failures)


def test_multipliers_of_the_wrong_sign_fail() -> None:
    flipped = replace(PLAN, lam_x=tuple(-v for v in PLAN.lam_x))
    assert not flipped.certificate.passed


def test_tensions_that_crush_the_arm_fail_with_the_reason() -> None:
    crushed = replace(PLAN, tensions=np.full((3, 4), 19.0))
    assert not crushed.certificate.passed
    assert "crushed" in crushed.outcome


def test_a_plan_travels_by_pickle_and_stays_equal() -> None:
    copy = pickle.loads(pickle.dumps(PLAN))
    assert copy == PLAN
    assert copy.certificate == PLAN.certificate
    assert copy != replace(PLAN, tensions=PLAN.tensions * 1.1)


def test_the_same_question_gives_the_same_digits() -> None:
    again = plan(ARM, PLAN.targets, PAPER, 20.0)
    assert np.array_equal(again.tensions, PLAN.tensions)
