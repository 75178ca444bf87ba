"""An arm that leans on obstacles: complementarity, stiffness, stability, load path."""

from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, NeoHookean, TipLoad
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Box, Capsule, HalfSpace, Sphere
from octoplan.model.stiffness import stiffness
from tests.contact.cases import bar, distance

ARM = Arm.from_paper("table-4")
TENSIONS = np.array([[0, 0, 0.5, 0], [4, 0, 0, 0], [0, 3, 0, 0]])
ROD = Capsule((0.1, -0.05, -0.06), (0.1, 0.05, -0.06), 0.02)
SCENES = {
    "paper": Scene(Extension(), Contact(ROD)),
    "exact": Scene(Extension(), ExactTendons(), Contact(ROD)),
    "silicone": Scene(Extension(), ExactTendons(), NeoHookean(), Contact(ROD)),
}


@pytest.mark.quick("silicone")
@pytest.mark.parametrize("name", SCENES)
def test_gap_and_force_are_complementary(name: str) -> None:
    shape = settle(ARM, TENSIONS, SCENES[name])
    s = np.linspace(0, ARM.length, 1501)
    radius = 0.015 + (0.002 - 0.015) * s / ARM.length
    if name == "silicone":
        radius = radius / np.sqrt(1 + shape.strain(s)[:, 3])
    gaps = distance(ROD, shape.position(s)) - radius
    assert gaps.min() > -1e-8
    assert gaps.min() < 1e-5
    assert shape.contacts
    for touch in shape.contacts:
        out = shape.position(touch.s) - touch.point
        assert abs(touch.gap) < 1e-12
        assert touch.force @ out > 0
        assert np.linalg.norm(np.cross(touch.force, out)) < 1e-12
        assert ROD.distance(touch.point) == pytest.approx(0, abs=1e-12)


def test_a_scene_whose_obstacles_are_far_off_is_one_without() -> None:
    arm, _, T = LEANING["a bar"]
    far = Scene(Extension(), ExactTendons(), Contact(Sphere((3.0, 0, 0), 0.1)))
    alone = settle(arm, T, Scene(Extension(), ExactTendons()), 1e-8)
    shape = settle(arm, T, far, 1e-8)
    assert shape.tip == pytest.approx(alone.tip, abs=1e-8)
    assert shape.contacts == ()


LEANING = {
    "a bar": (
        bar(0.3, 0.006, 2e5),
        Capsule((0.2, -0.1, -0.07), (0.2, 0.1, -0.07), 0.05),
        [0, 0.3, 0, 0],
    ),
    "three sections": (ARM, ROD, TENSIONS),
}


@pytest.mark.quick("a bar")
@pytest.mark.parametrize(("arm", "rod", "T"), LEANING.values(), ids=LEANING)
def test_compliance_of_the_held_arm_is_the_derivative_of_where_it_settles(
    arm: Arm, rod: Capsule, T: Any
) -> None:
    free = Scene(Extension(), ExactTendons())
    found = stiffness(arm, T, free + Contact(rod), accuracy=1e-6)
    own = found.compliance[:3, :3]
    assert found.shape.contacts
    assert own == pytest.approx(own.T, abs=1e-4)
    push, tips = 5e-5 / own[2, 2], []
    for sign in (1, -1):
        load = TipLoad(force=(0, 0, sign * push))
        tips.append(settle(arm, T, free + Contact(rod) + load, 1e-9).tip)
    moved = (tips[0] - tips[1]) / (2 * push)
    assert found.compliance[:3, 2] == pytest.approx(moved, rel=1e-4, abs=1e-4)
    assert np.trace(own) < np.trace(stiffness(arm, T, free).compliance[:3, :3])


@pytest.mark.slow
def test_what_it_leans_on_may_be_many_and_of_all_kinds() -> None:
    bodies = [
        HalfSpace((0, 0, -0.09), (0, 0, 1)),
        Box((0.2, 0.1, 0.0), (0.1, 0.05, 0.2)),
        Sphere((0.16, -0.06, -0.05), 0.02),
    ]
    scene = Scene(Extension(), ExactTendons(), *(Contact(body) for body in bodies))
    shape = settle(ARM, TENSIONS, scene)
    s = np.linspace(0, ARM.length, 1501)
    radius = 0.015 + (0.002 - 0.015) * s / ARM.length
    for body in bodies:
        assert (body.distance(shape.position(s)) - radius).min() > -1e-8
    assert shape.contacts
    assert shape.stability > 0


def test_an_arm_lies_in_the_groove_between_two_obstacles() -> None:
    """Places at one arc length were no places: none was found, after 40 s."""
    arm, pull = Arm.from_paper("table-2"), np.eye(12)[1]
    balls = [Sphere((0.2, sign * 0.02, -0.06), 0.04) for sign in (1, -1)]
    scene = Scene(Extension(), ExactTendons(), *map(Contact, balls))
    first, second = settle(arm, pull, scene, 1e-6).contacts
    assert first.s == pytest.approx(second.s, abs=1e-9)
    assert first.force * [1, -1, 1] == pytest.approx(second.force, abs=1e-7)
    assert abs(first.force[1]) > 1e-3
