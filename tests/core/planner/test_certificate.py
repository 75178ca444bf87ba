"""The certificate finds out every plan that is spoilt."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from octoplan.model import Arm, OctoplanError, Shape, settle
from octoplan.planner import plan
from octoplan.planner.certificate import COMPLEMENTARITY, Check, Optimality, certify
from octoplan.planner.extensions.contact.checks import COMPLEMENTARY
from octoplan.planner.limits import Limits, TendonLimits
from octoplan.planner.targets import TipPosition
from tests.core.planner.cases import PAPER, changed, moderate, paper_tip

ARM = Arm.from_paper("table-4")
PLAN = plan(ARM, TipPosition(paper_tip(ARM, moderate())), PAPER, 20.0)


def test_a_good_plan_passes_by_an_integrator_that_did_not_make_it() -> None:
    certificate = PLAN.certificate
    assert certificate.passed
    assert certificate.scheme == "rk8"
    # The check is a hundred times as accurate as the plan, with a margin.
    assert certificate.tolerance == 1e-6
    assert certificate.error <= 1e-8
    assert certificate.residual < 4e-7
    assert certificate.kkt < 4e-7


@pytest.mark.quick("0", "5", "10")
@pytest.mark.parametrize("j", range(12))
def test_a_tension_changed_by_a_thousandth_fails(j: int) -> None:
    T = PLAN.tensions.ravel().copy()
    T[j] += 1e-3 * max(T[j], 0.05)
    spoilt = changed(PLAN, tensions=T.reshape(3, 4))
    assert not spoilt.certificate.passed
    assert not spoilt.reached
    assert "Not certified" in spoilt.outcome


@pytest.mark.parametrize(
    "limits",
    [
        TendonLimits.of(ARM, PLAN.tensions.max() * 0.999),
        TendonLimits.of(ARM, 20.0, PLAN.tensions.ravel() + 1e-9),
        TendonLimits.of(ARM, 20.0, total=PLAN.tensions.sum() * 0.999),
    ],
    ids=["above a maximum", "below a minimum", "above the total"],
)
def test_tensions_outside_of_their_limits_fail(limits: TendonLimits) -> None:
    tight = changed(PLAN, limits=limits)
    assert any("tension limit violated" in failure for failure in tight.certificate.failures)


def test_needless_effort_is_reported_beside_the_verdict() -> None:
    wasteful = plan(ARM, PLAN.targets, PAPER, 20.0, limits=Limits(tension_min=0.05))
    assert wasteful.certificate.passed
    loosened = changed(wasteful, limits=PLAN.problem.limits)
    assert loosened.certificate.residual <= wasteful.problem.accuracy / 10
    assert loosened.reached
    assert not loosened.certificate.optimal
    assert "N, not proven optimal (optimality residual" in loosened.outcome
    assert "N, locally optimal;" in wasteful.outcome


def test_multipliers_of_the_wrong_sign_prove_no_optimality() -> None:
    flipped = changed(PLAN, lam_x=tuple(-v for v in PLAN.solution.lam_x))
    assert PLAN.certificate.optimal
    assert not flipped.certificate.optimal


def test_tensions_that_crush_the_arm_fail_with_the_reason() -> None:
    crushed = changed(PLAN, tensions=np.full((3, 4), 19.0))
    assert not crushed.certificate.passed
    assert "crushed" in crushed.outcome


def test_a_plan_travels_by_pickle_and_stays_equal() -> None:
    copy = pickle.loads(pickle.dumps(PLAN))
    assert copy == PLAN
    assert copy.certificate == PLAN.certificate
    assert copy.certificate.gaps == PLAN.certificate.gaps
    assert copy != changed(PLAN, tensions=PLAN.tensions * 1.1)


SOUND = replace(PLAN.certificate, clearances={}, load_factor=None)
EACH_CHECK = {
    "target residual": lambda v: {"equality": {"tip position": v * 1e-6}},
    "inequality": lambda v: {"inequality": {"least stiffness": -v * 1e-6}},
    "stroke": lambda v: {"strokes": v * 1e-6},
    "optimality": lambda v: {"kkt": v * 1e-6, "soft_residual": {"tip position": 1.0}},
    "integrators": lambda v: {"agreement": v * 1e-6},
    "complementarity": lambda v: {"checks": {COMPLEMENTARITY: Check(v * 1e-8, COMPLEMENTARY)}},
    "stability below its margin": lambda v: {
        "stability_margin": 0.1,
        "stability": 0.1 - v * 1e-4,
    },
}


@pytest.mark.parametrize("name", EACH_CHECK)
def test_each_check_fails_just_above_its_tolerance_and_passes_just_below(name: str) -> None:
    assert SOUND.passed
    assert replace(SOUND, **EACH_CHECK[name](0.99)).passed
    failed = replace(SOUND, **EACH_CHECK[name](1.01))
    assert not failed.passed
    (failure,) = failed.failures
    assert name in failure


def test_a_limit_may_not_be_passed_by_any_amount() -> None:
    assert not replace(SOUND, bounds=1e-15).passed
    assert not replace(SOUND, inequality={"least stiffness": -1e-5}).attained
    assert replace(SOUND, stability=0.0).passed
    assert not replace(SOUND, stability=-1e-12).passed
    near = replace(SOUND, gaps_asked={"a ball": 0.0019}, least_gaps={"a ball": 0.002})
    assert not near.passed


@pytest.mark.parametrize(
    ("load_factor", "why"),
    [
        (1.02, "it yields at 1.02 times its loads"),
        (np.inf, "its stability is 0.05, though it bears at least 3 times its loads"),
        (None, "its stability is 0.05"),
    ],
)
def test_a_shape_on_the_brink_is_warned_of(load_factor: float | None, why: str) -> None:
    """In contact, the certificate has no load factor, and the sentence was incomplete."""
    brink = replace(SOUND, stability=0.05, load_factor=load_factor)
    assert f"it stands on the brink: {why}" in brink.warnings


def test_tensions_that_settle_to_no_shape_are_settled_once() -> None:
    """Equilibria were solved twice, which is slow for an arm that yields under its loads."""
    asked = list[str]()

    def settled() -> Shape:
        asked.append("a shape")
        raise OctoplanError("no shape")

    def conditions() -> Optimality:
        asked.append("optimality")
        return Optimality(0.0)

    found = certify(PLAN.problem, PLAN.tensions.ravel(), settled, conditions)
    assert found.problem == "no shape"
    assert asked == ["a shape"]


def test_the_tip_of_a_shape_is_held_against_that_of_the_check() -> None:
    tensions = 2 * PLAN.tensions
    rough, sharp = (settle(ARM, tensions, PAPER, own) for own in (1e-2, 1e-11))
    found = certify(PLAN.problem, tensions.ravel(), lambda: rough, lambda: Optimality(0.0))
    apart = np.linalg.norm(rough.tip - sharp.tip) / ARM.length
    assert apart > 1e-6
    assert found.agreement == pytest.approx(apart, rel=1e-2)
