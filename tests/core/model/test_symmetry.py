"""Shapes turn, mirror and end as arms do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from octoplan.model import Arm, Scene, Shape, settle
from octoplan.model.arm import conical
from octoplan.model.effects import Extension
from tests.core.model.cases import arm_of, mild_tensions, paper_tensions, random_rod
from tests.oracles import Array

PAPER = Scene(Extension())
QUICK = settings(max_examples=8, deadline=None, derandomize=True)
FLIP = np.diag([1.0, -1.0, 1.0])


def settled(name: str, scene: Scene = PAPER, seed: int = 4) -> Shape:
    return settle(Arm.from_paper(name), paper_tensions(np.random.default_rng(seed), name), scene)


@QUICK
@given(st.integers(0, 10**6))
def test_turning_and_moving_the_base_turns_and_moves_the_arm(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-1, 1, 3)
    before = settled("table-2", PAPER, seed)
    arm = before.arm
    frame = tuple(map(tuple, turn @ np.array(arm.base_frame)))
    after = settle(
        replace(arm, base_frame=frame, base_position=tuple(shift)), before.tensions, PAPER
    )
    assert np.abs(after.tip - shift - turn @ before.tip).max() <= 1e-14
    assert np.abs(after.tip_frame - turn @ before.tip_frame).max() <= 1e-14
    assert np.allclose(after.tendon_lengths, before.tendon_lengths, rtol=1e-14, atol=0)


@pytest.mark.parametrize("scene", [Scene(), PAPER, Scene.as_printed()])
@pytest.mark.parametrize("name", ["table-2", "table-4"])
def test_exchanging_opposite_tendons_mirrors_the_shape(name: str, scene: Scene) -> None:
    before = settled(name, scene)
    swapped = before.tensions.reshape(3, 4)[:, [2, 1, 0, 3]]
    after = settle(before.arm, swapped, scene)
    assert np.abs(after.tip - FLIP @ before.tip).max() <= 1e-12
    assert np.abs(after.tip_frame - FLIP @ before.tip_frame @ FLIP).max() <= 1e-12
    assert abs(before.tip[1]) > 1e-3


@pytest.mark.parametrize("scene", [Scene(), PAPER, Scene.as_printed()])
def test_beyond_the_outermost_anchorage_the_arm_is_straight(scene: Scene) -> None:
    arm = conical(0.4, (0.01, 0.005), [(0.25, 4e-3, 4e-3), (0.1, 4e-3, 4e-3)])
    shape = settle(arm, [0.3, 0.1, 0, 0, 0, 0, 0.5, 0], scene)
    s = np.linspace(0.26, 0.4, 8)
    end, frame = shape.position(0.25), shape.frame(0.25)
    assert np.all(shape.strain(s) == 0)
    assert np.any(shape.strain(0.25) != 0)
    straight = end + (s - 0.25)[:, None] * frame[:, 0]
    assert np.abs(shape.position(s) - straight).max() <= 1e-13
    assert np.abs(shape.frame(s) - frame).max() <= 1e-13


@pytest.mark.parametrize("scene", [Scene(), PAPER, Scene.as_printed()])
def test_a_slack_arm_is_straight_and_as_long_as_it_is(scene: Scene) -> None:
    arm = Arm.from_paper("table-4")
    shape = settle(arm, np.zeros(12), scene)
    s: Array = np.linspace(0, 0.45, 10)
    assert np.abs(shape.position(s) - s[:, None] * [1, 0, 0]).max() <= 1e-15
    assert np.all(shape.strain(s) == 0)
    jacobian = [(b - a) / at for at, a, b in ((0.45, 7.5e-3, 1e-3), (0.315, 0, 0), (0.135, 0, 0))]
    lengths = np.repeat([0.45, 0.315, 0.135] * np.sqrt(1 + np.square(jacobian)), 4)
    assert np.allclose(shape.tendon_lengths, lengths, rtol=1e-14, atol=0)


def test_a_cylinder_pulled_by_one_parallel_tendon_is_an_arc() -> None:
    R, y, pull, L = 0.01, 5e-3, 0.8, 0.3
    arm = conical(L, (R, R), [(L, y, y)])
    shape = settle(arm, [pull, 0, 0, 0], PAPER, accuracy=1e-10)
    k = y * pull / (110e3 * np.pi * R**4 / 4 + y**2 * pull)
    stretch = 1 - pull * (1 - k * y) / (110e3 * np.pi * R**2)
    angle = k * stretch * L
    wanted = np.array([np.sin(angle), -(1 - np.cos(angle)), 0]) / k
    assert np.abs(shape.tip - wanted).max() <= 1e-14
    assert np.isclose(shape.tendon_lengths[0], stretch * L * (1 - k * y), rtol=1e-14)


def turned(arm: Arm, phi: float) -> Arm:
    """Return the arm with all tendons turned by phi about the midline."""
    sections = (replace(x, angles=tuple(a + phi for a in x.angles)) for x in arm.sections)
    return replace(arm, sections=tuple(sections))


@QUICK
@given(st.floats(-7, 7), st.integers(0, 10**6))
def test_turning_all_tendons_turns_the_shape_about_the_base_tangent(phi: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rod = random_rod(rng)
    arm, T = arm_of(rod), mild_tensions(rng, rod)
    s = np.linspace(0, arm.length, 5)
    before, after = settle(arm, T, PAPER), settle(turned(arm, phi), T, PAPER)
    frame = np.array(arm.base_frame)
    turn = Rotation.from_rotvec(phi * frame[:, 0]).as_matrix()
    roll = frame.T @ turn @ frame
    base = np.array(arm.base_position)
    wanted = base + (before.position(s) - base) @ turn.T
    assert np.abs(after.position(s) - wanted).max() <= 1e-12
    assert np.abs(after.frame(s) - turn @ before.frame(s) @ roll.T).max() <= 1e-12
