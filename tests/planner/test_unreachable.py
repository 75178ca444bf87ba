"""What cannot be reached gives the nearest shape, how far off it is, and what holds it."""

import numpy as np
import pytest

from model import Arm, Scene, settle
from planner import plan
from planner.targets import BendingPlane, Fetch, TipPose, TipPosition
from tests.planner.cases import PAPER

ARM = Arm.from_paper("table-4")


def test_a_point_beyond_the_arm_gives_the_straight_way_towards_it() -> None:
    found = plan(ARM, TipPosition((0.5, 0.0, 0.0)), PAPER, 20.0)
    assert not found.certificate.passed
    assert found.mode == "nearest"
    assert found.outcome.startswith("Not reached")
    assert "50 mm" in found.outcome
    assert found.tensions.max() < 1e-3


def test_a_tension_limit_that_holds_is_named() -> None:
    free = plan(ARM, TipPosition((0.25, 0.3, 0.0)), PAPER, 20.0)
    assert free.certificate.passed
    held = plan(ARM, TipPosition((0.25, 0.3, 0.0)), PAPER, 0.2)
    assert not held.certificate.passed
    assert "at its maximum of 0.2 N" in held.outcome
    assert held.certificate.bounds == 0


@pytest.mark.quick("1")
@pytest.mark.parametrize("seed", range(4))
def test_the_nearest_point_is_no_farther_than_any_of_many_drawn(seed: int) -> None:
    rng = np.random.default_rng(seed)
    point = rng.normal(size=3)
    point *= 0.6 / np.linalg.norm(point)
    found = plan(ARM, TipPosition(tuple(point)), PAPER, 5.0)
    gap = np.linalg.norm(found.shape.tip - point)
    for _ in range(60):
        T = rng.uniform(size=(3, 4)) * (rng.uniform(size=(3, 4)) < 0.4) * [[0.2], [3], [5]]
        drawn = settle(ARM, T, PAPER, 1e-5).tip
        assert np.linalg.norm(drawn - point) > gap - 1e-6


def test_too_much_bend_keeps_the_plane_and_bends_as_far_as_it_goes() -> None:
    found = plan(ARM, BendingPlane(0.0, np.pi, 3), PAPER, 5.0)
    assert not found.reached
    assert found.certificate.equality["bending plane"] < 1e-6
    assert found.tensions[2].tolist() == pytest.approx([0, 5, 0, 0])


def test_a_pose_that_cannot_be_had_is_no_exception() -> None:
    found = plan(ARM, TipPose((0.46, 0.0, 0.0), -np.eye(3)[:, [0, 2, 1]]), PAPER, 5.0)
    assert not found.certificate.passed
    assert found.outcome


@pytest.mark.slow
def test_bends_that_cannot_be_had_are_said_to_lack() -> None:
    found = plan(ARM, Fetch.reach((0.1, 0.1, 0.0), np.radians(60)), PAPER, 0.05)
    assert not found.certificate.passed
    assert "least bend" in found.outcome


def test_a_bare_arm_bends_where_an_arm_with_extension_would_be_crushed() -> None:
    arm = Arm.from_paper("table-2")
    target = BendingPlane(np.radians(20), np.pi, 3)
    assert plan(arm, target, Scene()).reached
    crushed = plan(arm, target, PAPER)
    assert not crushed.reached
    assert crushed.shape.strain(0.093)[3] > -1
