"""Targets of every kind are met, and the meeting is measured here, not by the planner."""

import numpy as np
import pytest

from model import Arm, settle
from planner import plan
from planner.targets import Backbone, BendingPlane, Fetch, TipPose, TipPosition
from tests.planner.cases import PAPER, barrel_arm, bend_and_plane, figure_15, moderate, paper_tip

ARM = Arm.from_paper("table-4")


@pytest.mark.parametrize("tensions", [moderate(), figure_15()], ids=["moderate", "figure 15"])
def test_the_tip_of_a_settled_shape_is_reached_with_no_more_effort(tensions: np.ndarray) -> None:
    point = paper_tip(ARM, tensions)
    found = plan(ARM, TipPosition(point), PAPER, 20.0)
    again = settle(ARM, found.tensions, PAPER, 1e-10, scheme="gauss6")
    assert found.certificate.passed
    assert np.linalg.norm(again.tip - point) < 1e-6 * ARM.length
    assert found.effort <= np.linalg.norm(tensions) * (1 + 1e-9)


@pytest.mark.quick("moderate")
@pytest.mark.parametrize("tensions", [moderate(), figure_15()], ids=["moderate", "figure 15"])
def test_a_pose_is_reached_in_place_and_turn(tensions: np.ndarray) -> None:
    shape = settle(ARM, tensions, PAPER, 1e-9)
    found = plan(ARM, TipPose(shape.tip, shape.tip_frame), PAPER, 20.0)
    assert found.certificate.passed
    assert np.linalg.norm(found.shape.tip - shape.tip) < 1e-6 * ARM.length
    assert np.abs(found.shape.tip_frame - shape.tip_frame).max() < 1e-6


@pytest.mark.quick("1-30", "2-150", "3-90")
@pytest.mark.parametrize(
    ("section", "bend"),
    # Section 3 cannot bend by 150 degrees in all planes: with extension it is crushed first.
    [(1, 30), (1, 90), (1, 150), (2, 30), (2, 90), (2, 150), (3, 30), (3, 90)],
)
def test_a_plane_and_bend_are_hit_by_neighbouring_tendons(section: int, bend: int) -> None:
    arm = Arm.from_paper("table-2")
    for angle in np.radians([-160, -45, 0, 20, 101]):
        found = plan(arm, BendingPlane(angle, np.radians(bend), section), PAPER, 60.0)
        assert found.certificate.passed, found.outcome
        measured_bend, plane = bend_and_plane(arm, found.shape)
        assert np.degrees(abs(measured_bend - np.radians(bend))) < 1e-4
        assert np.degrees(abs(np.angle(np.exp(1j * (plane - angle))))) < 1e-4
        own = found.tensions[section - 1]
        assert found.tensions.sum() == own.sum()
        assert own[0] * own[2] == 0
        assert own[1] * own[3] == 0


def test_three_prescribed_bends_are_made_between_the_anchorages() -> None:
    bends = np.radians([[60, 90], [50, -90], [70, 30]])
    found = plan(ARM, Fetch(*bends), PAPER, 20.0)
    assert found.certificate.passed
    frames = found.shape.frame(np.array([0, 0.135, 0.315, 0.45]))
    for (angle, plane), start, end in zip(bends, frames[:-1], frames[1:], strict=True):
        t, n, b = start.T @ end[:, 0]
        assert np.isclose(t, np.cos(angle), atol=1e-6)
        assert np.isclose(b, np.sin(angle) * np.cos(plane), atol=1e-6)
        assert np.isclose(n, -np.sin(angle) * np.sin(plane), atol=1e-6)


@pytest.mark.quick("in a plane")
@pytest.mark.parametrize("plane", [None, np.radians(90)], ids=["in space", "in a plane"])
def test_a_fetch_reaches_the_mouth_through_three_bends(plane: float | None) -> None:
    mouth = (0.05, 0.05, 0.0)
    found = plan(ARM, Fetch.reach(mouth, np.radians(40), plane), PAPER, 13.0)
    assert found.certificate.passed
    assert np.linalg.norm(found.shape.tip - mouth) < 1e-6 * ARM.length
    tangents = found.shape.frame(np.array([0, 0.135, 0.315, 0.45]))[:, :, 0]
    bends = np.arccos(np.sum(tangents[:-1] * tangents[1:], axis=1))
    assert bends.min() > np.radians(40) - 1e-6
    if plane is not None:
        assert np.abs(found.shape.position(np.array([0.135, 0.315, 0.45]))[:, 2]).max() < 1e-9


def test_a_backbone_that_the_arm_can_take_is_followed() -> None:
    s = np.linspace(0.1, 1.0, 8) * ARM.length
    shape = settle(ARM, moderate(), PAPER, 1e-9)
    found = plan(ARM, Backbone(shape.position(s), s=tuple(s)), PAPER, 20.0)
    assert found.certificate.passed
    assert np.abs(found.shape.position(s) - shape.position(s)).max() < 1e-5 * ARM.length


def test_weights_move_a_backbone_towards_the_points_that_weigh_more() -> None:
    points = ((0.1, 0.05, 0.0), (0.2, 0.15, 0.0), (0.3, -0.1, 0.0), (0.2, 0.0, 0.2))
    s = (0.1, 0.2, 0.3, 0.45)
    gaps = []
    for weight in (1.0, 50.0):
        target = Backbone(points, s, (1.0, 1.0, 1.0, weight))
        gaps.append(np.linalg.norm(plan(ARM, target, PAPER, 20.0, starts=3).shape.tip - points[-1]))
    assert gaps[1] < gaps[0]


def test_targets_combine() -> None:
    shape = settle(ARM, moderate(), PAPER, 1e-9)
    through = Backbone((tuple(shape.position(0.2)),), (0.2,))
    found = plan(ARM, [TipPosition(tuple(shape.tip)), through], PAPER, 20.0)
    assert found.certificate.passed
    assert np.linalg.norm(found.shape.tip - shape.tip) < 1e-6 * ARM.length
    assert np.linalg.norm(found.shape.position(0.2) - shape.position(0.2)) < 1e-6 * ARM.length


@pytest.mark.slow
def test_an_arm_of_five_sections_of_three_tendons_on_a_barrel_is_planned_and_certified() -> None:
    arm = barrel_arm()
    rng = np.random.default_rng(2)
    point = settle(arm, rng.uniform(0, 1.5, arm.n_tendons), PAPER, 1e-9).tip
    for target in (TipPosition(tuple(point)), Fetch.reach((0.1, 0.1, 0.05), np.radians(20))):
        found = plan(arm, target, PAPER, 10.0)
        assert found.certificate.passed, found.outcome
    assert found.tensions.shape == (5, 3)
