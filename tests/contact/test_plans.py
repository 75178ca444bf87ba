"""Plans for arms in contact."""

import numpy as np
import pytest

from model import Scene, settle
from model.effects import Contact, ExactTendons, Extension, Weight
from model.errors import InputError
from model.obstacles import HalfSpace, Sphere
from planner import plan
from planner.targets import TipPosition
from tests.contact.cases import bar

ARM = bar(0.3, 0.006, 2e7)
FLOOR = HalfSpace((0, 0, -0.03), (0, 0, 1))
SCENE = Scene(Extension(), ExactTendons(), Weight(), Contact(FLOOR))


def test_a_tip_is_brought_to_a_place_on_the_floor_that_carries_the_arm() -> None:
    wanted = settle(ARM, [2.0, 0.0, 0.0, 0.5], SCENE, 1e-9)
    assert wanted.contacts
    p = plan(ARM, TipPosition(tuple(wanted.tip)), SCENE, 30.0, starts=1)
    assert p.reached, str(p.certificate)
    assert p.shape.contacts
    assert p.certificate.complementarity < 1e-8
    assert p.certificate.stability > 0
    assert np.linalg.norm(p.tip - wanted.tip) < 1e-6 * ARM.length
    assert p.effort < np.hypot(2.0, 0.5) + 1e-6
    assert "Reached" in p.outcome
    assert "complementarity" in str(p.certificate)


def test_what_is_not_stated_with_contact_is_refused() -> None:
    target = TipPosition((0.25, 0.05, 0.0))
    with pytest.raises(InputError, match="norm"):
        plan(ARM, target, SCENE, 30.0, norm="inf")
    with pytest.raises(InputError, match="obstacles"):
        plan(ARM, target, SCENE, 30.0, obstacles=[Sphere((0.2, 0.1, 0.1), 0.02)])
