"""Optimality is reported beside the verdict of a hold."""

import numpy as np
import pytest

from octoplan.planner import plan
from octoplan.planner.extensions.contact import Hold
from octoplan.planner.extensions.contact.plan import ContactPlan
from octoplan.planner.limits import Limits
from tests.contact.test_holds import ARM, FRICTION, ROD, SCENE, wrench
from tests.core.planner.cases import changed

ASIDE = np.radians(10)


@pytest.fixture(scope="module")
def held() -> ContactPlan:
    p = plan(ARM, Hold(ROD, wrench(ASIDE), FRICTION), SCENE, 50.0, starts=1)
    assert isinstance(p, ContactPlan)
    return p


def test_the_least_effort_of_a_hold_is_reported_as_optimal(held: ContactPlan) -> None:
    assert held.reached
    assert held.certificate.optimal
    assert held.outcome.startswith("Held: every target met")
    assert f"effort {held.effort:.4g} N, locally optimal;" in held.outcome


def test_a_hold_with_needless_effort_is_reached_and_names_the_saving(held: ContactPlan) -> None:
    """Antagonists pull with 0.3 N in addition; the saving is measured by a plan from there."""
    tense = plan(
        ARM, held.targets, SCENE, 50.0, limits=Limits(tension_min=(0.0, 0.3, 0.0, 0.3)), near=held
    )
    assert tense.certificate.optimal, tense.outcome
    loose = changed(tense, limits=held.problem.limits)
    assert loose.reached, loose.outcome
    assert not loose.certificate.optimal
    assert loose.certificate.saving is not None
    assert 0.0 < loose.certificate.saving < 1.5 * (tense.effort - held.effort)
    assert "N, not proven optimal (a descent direction saves" in loose.outcome
