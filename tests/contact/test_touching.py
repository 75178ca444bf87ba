"""An arm that touches something, and one that leans on a rod by lengths or with shear."""

from dataclasses import replace

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, PointLoad, Shear, TipLoad, Weight
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Box, Capsule, HalfSpace, Sphere
from octoplan.model.extensions.obstacles.base import Obstacle
from tests.contact.cases import bar, distance, stiffness
from tests.contact.queries import Query, imbalance
from tests.lengths.cases import check_complementary
from tests.oracles import Rod, RodSection, linear

# Without friction, the contact force on a round bar passes through the midline: a dead load there
# has the same effect. Arms with these dead loads know no obstacle.
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


def test_silicone_that_widens_to_its_tip_enters_nothing_on_either_side_of_a_touch() -> None:
    """The contact force leans; stretch and radius jump: the wider side was inside by 25 nm."""
    ends = (Anchorage(0.3, Linear(0.003, 0.0015)),)
    arm = replace(ARM, radius=Linear(0.006, 0.012), sections=ends)
    T = np.array([0.0, 1.0, 0.0, 0.0])
    shape = settle(arm, T, Scene.silicone(Contact(ROD)), 1e-4)
    (touch,) = shape.contacts
    assert 0.5 < touch.s / arm.length < 0.9
    sides = touch.s + 1e-9 * arm.length * np.array([-1, 1])
    radius = arm.outer_radius(sides)[0] / np.sqrt(1 + shape.strain(sides)[:, 3])
    gaps = ROD.distance(shape.position(sides)) - radius
    assert gaps.min() > -1e-9 * arm.length


@pytest.mark.slow
def test_a_part_that_lies_off_the_point_where_it_began_is_found() -> None:
    """The contact was dropped, and started again at one of its ends, without end."""
    scene = Scene(Extension(), ExactTendons(), Weight(), Contact(ROD))
    shape = settle(ARM, [0, 0.2, 0, 0], scene, 1e-9)
    ends = [min(own.s for own in shape.contacts), max(own.s for own in shape.contacts)]
    assert np.diff(ends) > 0.02 * ARM.length
    lies, s = np.linspace(*ends, 101), np.linspace(0, ARM.length, 1001)
    assert np.abs(ROD.distance(shape.position(lies)) - 0.006).max() < 1e-9 * ARM.length
    assert (ROD.distance(shape.position(s)) - 0.006).min() > -1e-9 * ARM.length
    assert all(own.force[2] > 0 for own in shape.contacts)
    middle = shape.strain(np.mean(ends))
    # In the contact zone the axis is bent by the rod's surface and the arm's radius.
    assert np.linalg.norm(middle[:3]) == pytest.approx(1 / 0.056, rel=2e-2)


@pytest.mark.slow
def test_an_arm_that_no_edge_holds_in_its_plane_falls_aside_onto_a_second_one() -> None:
    """The equilibrium in the plane of the pull is unstable; none was found, after half a minute."""
    box = Box((0.18, 0, -0.05), (0.04, 0.2, 0.04))
    scene = Scene(Extension(), ExactTendons(), Contact(box))
    shape = settle(ARM, [0, 1.2, 0, 0], scene, 1e-8)
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


BY_LENGTHS = Scene(Extension(), ExactTendons(), Contact(ROD))


@pytest.fixture(scope="module")
def arm() -> Arm:
    return bar(0.3, 0.006, 2e5)


@pytest.mark.slow
def test_lengths_of_a_leaning_arm_give_it_back(arm: Arm) -> None:
    T = np.array([0.0, 0.3, 0.1, 0.0])
    given = settle(arm, T, BY_LENGTHS, 1e-8)
    assert given.contacts
    lengths = given.tendon_lengths + 1e-3 * (T == 0)
    back = settle(arm, scene=BY_LENGTHS, accuracy=1e-8, lengths=lengths)
    check_complementary(back)
    assert back.tensions == pytest.approx(T, abs=1e-5)
    assert back.tip == pytest.approx(given.tip, abs=1e-7 * arm.length)
    wanted = np.sum([touch.force for touch in given.contacts], axis=0)
    assert np.sum([touch.force for touch in back.contacts], axis=0) == pytest.approx(
        wanted, abs=1e-5
    )


def test_a_rod_makes_a_winch_pull_harder(arm: Arm) -> None:
    """The same stroke requires more tension if the obstacle hinders the bend."""
    free = settle(arm, [0.0, 0.3, 0.0, 0.0], Scene(Extension(), ExactTendons()), 1e-8)
    lengths = free.tendon_lengths + np.array([1e-2, 0.0, 1e-2, 1e-2])
    leaning = settle(arm, scene=BY_LENGTHS, accuracy=1e-8, lengths=lengths)
    assert leaning.contacts
    assert leaning.tensions[1] > 0.3 + 1e-3
    check_complementary(leaning)


TABLE_4 = Arm.from_paper("table-4")
THIN_ROD = Capsule((0.2, -0.15, -0.05), (0.2, 0.15, -0.05), 0.02)
PULLS = np.array([0, 0, 0, 0, 0, 0, 0, 0, 0.3, 3, 0, 0])


@pytest.mark.slow
def test_lengths_of_an_arm_that_touches_two_bodies_give_it_back() -> None:
    """Steps along undetermined lengths reached kilonewtons, and did not end."""
    sphere = Sphere((0.153, -0.006, -0.095), 0.0285)
    plane = HalfSpace((0.224, -0.008, -0.206), (0.306, -0.069, 0.95))
    scene = Scene(Contact(sphere), Contact(plane), TipLoad((7e-4, -1.1e-3, -2.5e-3)))
    T = np.array([0, 0, 0, 0.011, 0, 0, 0.014, 0, 0, 2.77, 0, 0])
    given = settle(TABLE_4, T, scene)
    assert len(given.contacts) == 2
    back = settle(TABLE_4, scene=scene, lengths=given.tendon_lengths)
    check_complementary(back)
    assert back.tip == pytest.approx(given.tip, abs=1e-7 * TABLE_4.length)


SHEARED = Scene(Extension(), ExactTendons(), Contact(THIN_ROD), Shear())


@pytest.mark.slow
def test_an_arm_that_shears_passes_through_nothing_where_it_leans() -> None:
    """A force at a point bent the arm by an angle: the arm was inside by 4e-6 of its length."""
    shape = settle(TABLE_4, PULLS, SHEARED)
    touches = shape.contacts
    assert len(touches) > 2
    first, last = touches[0].s, touches[-1].s
    s = np.concatenate([np.linspace(0, TABLE_4.length, 2001), np.linspace(first, last, 101)])
    gap = distance(THIN_ROD, shape.position(s)) - TABLE_4.outer_radius(s)[0]
    assert gap.min() > -1e-8 * TABLE_4.length
    assert np.abs(gap[-101:]).max() < 1e-8 * TABLE_4.length
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


@pytest.mark.slow
def test_a_shearing_arm_leans_on_a_thin_bead() -> None:
    """The contact zone would be 1e-7 of the length long: the arm touches at a point."""
    arm, free, bent = Arm.from_paper("section-5.2"), Scene(ExactTendons(), Shear()), [0.3, 0, 0, 0]
    s, radius = 0.2, 0.002
    alone = settle(arm, bent, free, 1e-10)
    outer = arm.outer_radius(np.array([s]))[0][0]
    center = alone.position(s) + alone.frame(s)[:, 1] * (outer + radius - 1e-4)
    bead = Sphere(tuple(center.tolist()), radius)
    shape = settle(arm, bent, free + Contact(bead), 1e-10)
    (touch,) = shape.contacts
    places = touch.s + np.linspace(-1e-4, 1e-4, 2001)
    gap = bead.distance(shape.position(places)) - arm.outer_radius(places)[0]
    assert gap.min() > -1e-9 * arm.length
    assert touch.force @ alone.frame(s)[:, 1] < 0
    pushed = settle(arm, bent, free + PointLoad(touch.s, tuple(touch.force.tolist())), 1e-10)
    assert pushed.tip == pytest.approx(shape.tip, abs=1e-10)
