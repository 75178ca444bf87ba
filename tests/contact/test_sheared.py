"""An arm that shears leans on parts without forces at their ends: NumPy, and a closed form."""

import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import Contact, ExactTendons, Extension, Shear, TipLoad
from model.obstacles import Capsule
from tests.contact.bodies import distance
from tests.contact.cases import bar, stiffness

ARM = Arm.from_paper("table-4")
ROD = Capsule((0.2, -0.15, -0.05), (0.2, 0.15, -0.05), 0.02)
T = np.array([0, 0, 0, 0, 0, 0, 0, 0, 0.3, 3, 0, 0])
SCENE = Scene(Extension(), ExactTendons(), Contact(ROD), Shear())


def test_an_arm_that_shears_passes_through_nothing_where_it_leans() -> None:
    """A force at a point bent it by an angle there: it was inside by 4e-6 of its length."""
    shape = settle(ARM, T, SCENE)
    touches = shape.contacts
    assert len(touches) > 2
    first, last = touches[0].s, touches[-1].s
    s = np.concatenate([np.linspace(0, ARM.length, 2001), np.linspace(first, last, 101)])
    gap = distance(ROD, shape.position(s)) - ARM.outer_radius(s)[0]
    assert gap.min() > -1e-8 * ARM.length
    assert np.abs(gap[-101:]).max() < 1e-8 * ARM.length
    forces = np.array([touch.force for touch in touches])
    outwards = np.array([shape.position(touch.s) - touch.point for touch in touches])
    assert ((forces * outwards).sum(axis=1) > 0).all()


def test_what_presses_makes_up_for_the_angle_by_the_obstacle_s_curvature() -> None:
    """A tip load f over a fulcrum: w'' = p / GA + M / EJ = 1 / r, M = f (L - s), so P / p long."""
    L, R, E, f, r = 0.3, 0.006, 2e7, 0.01, 0.05
    rod = Capsule((0.2, -0.1, -r - R - 1e-6), (0.2, 0.1, -r - R - 1e-6), r)
    arm, effects = bar(L, R, E), (Extension(), ExactTendons(), Shear(), TipLoad(force=(0, 0, -f)))
    shape = settle(arm, np.zeros(4), Scene(*effects, Contact(rod)))
    first, *_, last = shape.contacts
    P = sum(float(touch.force[2]) for touch in shape.contacts)
    GA, EJ = arm.material.G * np.pi * R**2, stiffness(R, E)
    pressure = GA * (1 / (r + R) - f * (L - first.s) / EJ)
    assert last.s - first.s == pytest.approx(P / pressure, rel=1e-3)
