"""Stiffness of a hold against differences of settled shapes and against a cantilever."""

import numpy as np
import pytest

from octoplan.model import Scene, settle
from octoplan.model.effects import ExactTendons, Extension, TipLoad
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.contact.hold_stiffness import hold_stiffness
from octoplan.model.extensions.obstacles import Capsule, HalfSpace, Sphere
from octoplan.model.support.errors import InputError
from tests.contact.cases import bar, stiffness
from tests.oracles import Array

LENGTH, RADIUS, E = 0.1, 0.004, 2e5
ARM = bar(LENGTH, RADIUS, E)
BENT = [0.0, 0.5, 0.0, 0.0]
STATICS = Extension(), ExactTendons()


def around(displacement: Array) -> Scene:
    """Return the scene with a cylinder below the base, around which the arm bends."""
    x, y, z = np.array([0.0, 0.0, -0.041]) + displacement
    return Scene(*STATICS, Contact(Capsule((x, y - 0.1, z), (x, y + 0.1, z), 0.036)))


def force(displacement: Array) -> Array:
    shape = settle(ARM, BENT, around(displacement), 1e-8)
    return np.sum([touch.force for touch in shape.contacts], axis=0)


def test_sliding_stiffness_is_the_difference_of_contact_forces() -> None:
    shape = settle(ARM, BENT, around(np.zeros(3)), 1e-8)
    found = hold_stiffness(shape, shape.contacts[0].obstacle)
    step = 1e-6 * np.eye(3)[[0, 2]]
    expected = np.array([(force(d) - force(-d)) / 2e-6 for d in step]).T
    np.testing.assert_allclose(found[:, [0, 2]], expected, atol=1e-4 * np.abs(expected).max())


def test_a_tip_that_sticks_is_as_stiff_as_a_cantilever() -> None:
    """E A / L along a straight bar and 3 E J / L^3 across, for a light touch."""
    floor = HalfSpace((0, 0, -RADIUS - 1e-9), (0, 0, 1))
    press = TipLoad(force=(0, 0, -1e-6))
    smooth, rough = (Scene(*STATICS, press, Contact(floor, friction=mu)) for mu in (0.0, 0.3))
    none = np.zeros(4)
    arm = bar(LENGTH, RADIUS, E)
    shape = settle(arm, none, rough, 1e-6, near=settle(arm, none, smooth, 1e-6))
    across = 3 * stiffness(RADIUS, E) / LENGTH**3
    expected = [E * np.pi * RADIUS**2 / LENGTH, across, across]
    found = hold_stiffness(shape, floor)
    np.testing.assert_allclose(np.diag(found), expected, rtol=1e-3)


def test_stiffness_of_an_obstacle_that_is_not_touched_is_refused() -> None:
    shape = settle(ARM, BENT, around(np.zeros(3)), 1e-4)
    with pytest.raises(InputError, match="only obstacle that the arm touches"):
        hold_stiffness(shape, Sphere((0.0, 0.0, -1.0), 0.1))
