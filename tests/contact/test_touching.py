"""An arm that touches something is one on which the forces of contact are put as loads."""

import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import Contact, ExactTendons, Extension, PointLoad, Weight
from model.obstacles import Box, Capsule, Obstacle, Sphere
from tests.contact.bodies import distance
from tests.contact.cases import bar
from tests.contact.checks import imbalance
from tests.contact.queries import Query
from tests.oracles import Rod, RodSection, linear

# Without friction on a round bar the force's line meets the midline: a dead load there does the
# same, whatever presses. Of the arms that settle so none knows an obstacle.
ARM = bar(0.3, 0.006, 2e5)
ROD = Capsule((0.2, -0.1, -0.07), (0.2, 0.1, -0.07), 0.05)
LOADS = {
    "by tendons": (0.4, (Extension(), ExactTendons())),
    "hanging": (0.4, (Extension(), ExactTendons(), Weight((0.0, 0.0, -0.05)))),
    "bending only": (0.4, ()),
}


@pytest.mark.parametrize(("pull", "effects"), LOADS.values(), ids=LOADS)
def test_forces_of_contact_put_as_point_loads_hold_the_arm_where_it_is(
    pull: float, effects: tuple
) -> None:
    T = np.array([0.0, pull, 0.0, 0.0])
    shape = settle(ARM, T, Scene(*effects, Contact(ROD)), 1e-9)
    assert len(shape.contacts) == 1
    pressed = [PointLoad(own.s, tuple(own.force)) for own in shape.contacts]
    same = settle(ARM, T, Scene(*effects, *pressed), 1e-9)
    s = np.linspace(0, ARM.length, 7)
    assert np.abs(shape.position(s) - same.position(s)).max() < 1e-8 * ARM.length
    free = settle(ARM, T, Scene(*effects), 1e-9)
    assert np.abs(shape.tip - free.tip).max() > 1e-2 * ARM.length


@pytest.mark.parametrize("obstacle", [ROD, Sphere((0.2, 0.01, -0.07), 0.05)], ids=["rod", "ball"])
def test_what_is_touched_is_not_entered_and_pushes_outwards(obstacle: Obstacle) -> None:
    arm: Arm = ARM
    shape = settle(arm, [0, 0.3, 0, 0], Scene(Extension(), ExactTendons(), Contact(obstacle)))
    s = np.linspace(0, arm.length, 601)
    assert (obstacle.distance(shape.position(s)) - 0.006).min() > -1e-6 * arm.length
    assert shape.contacts
    for own in shape.contacts:
        x = shape.position(own.s)
        assert obstacle.distance(x[None])[0] - 0.006 == pytest.approx(0, abs=1e-6 * arm.length)
        outwards = obstacle.gradient(x[None])[0]
        assert own.force == pytest.approx(np.linalg.norm(own.force) * outwards, rel=1e-5, abs=1e-7)


def test_a_part_that_lies_off_the_point_where_it_began_is_found() -> None:
    """It was given up, and begun again at one of its ends, for as long as it pulled there."""
    scene = Scene(Extension(), ExactTendons(), Weight(), Contact(ROD))
    shape = settle(ARM, [0, 0.2, 0, 0], scene, 1e-9)
    ends = [min(own.s for own in shape.contacts), max(own.s for own in shape.contacts)]
    assert np.diff(ends) > 0.02 * ARM.length
    lies, s = np.linspace(*ends, 101), np.linspace(0, ARM.length, 1001)
    assert np.abs(ROD.distance(shape.position(lies)) - 0.006).max() < 1e-9 * ARM.length
    assert (ROD.distance(shape.position(s)) - 0.006).min() > -1e-9 * ARM.length
    assert all(own.force[2] > 0 for own in shape.contacts)
    middle = shape.strain(np.mean(ends))
    # The body's axis is bent as the rod's surface and its own radius bend it, where it lies.
    assert np.linalg.norm(middle[:3]) == pytest.approx(1 / 0.056, rel=2e-2)


@pytest.mark.parametrize("accuracy", [1e-6, 1e-8])
def test_an_arm_that_no_edge_holds_in_its_plane_falls_aside_onto_a_second_one(
    accuracy: float,
) -> None:
    """The equilibrium in the plane of the pull is unstable; none was found, after half a minute."""
    box = Box((0.18, 0, -0.05), (0.04, 0.2, 0.04))
    scene = Scene(Extension(), ExactTendons(), Contact(box))
    shape = settle(ARM, [0, 1.2, 0, 0], scene, accuracy)
    assert [np.linalg.norm(own.force) for own in shape.contacts] == pytest.approx(
        [0.03417317, 0.00256589], rel=1e-5
    )
    for own, edge in zip(shape.contacts, (-0.03, -0.07), strict=True):
        assert own.point[[0, 2]] == pytest.approx([0.2, edge], abs=1e-9)
        assert np.cross(own.force, shape.position(own.s) - own.point) == pytest.approx(
            np.zeros(3), abs=1e-9
        )
    assert abs(shape.tip[1]) > 0.1 * ARM.length
    assert shape.stability > 0.1
    s = np.linspace(0, ARM.length, 2001)
    assert (distance(box, shape.position(s)) - 0.006).min() > -1e-8 * ARM.length
    angles = tuple(phi for _, phi in ARM.tendons)
    section = RodSection(0.3, linear(0.003, 0.003, 0.3), angles)
    rod = Rod(0.3, linear(0.006, 0.006, 0.3), (section,), 2e5, 0.5)
    asked = Query(ARM, scene, np.ravel(shape.tensions), (box,), rod, np.zeros(3), rubber=False)
    assert imbalance(asked, shape) < 1e-5
