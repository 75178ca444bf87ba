"""A bending plane refers to the tip or to the anchorage of its section; under loads they differ."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from octoplan.model import Arm, InputError, Scene, Shape
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, Weight
from octoplan.planner import load_plan, plan
from octoplan.planner.frontends.live.handles import goal_of, handle_of
from octoplan.planner.plan_result import Plan
from octoplan.planner.targets import BendingPlane
from tests.core.planner.cases import PAPER

ARM = Arm.from_paper("table-4")
WATER = Scene(Extension(), ExactTendons(), Weight(), Buoyancy())
ANGLE, BEND = np.radians(120), np.radians(50)


def integrated(shape: Shape, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Return position and frame at s = end by integrating the strains with scipy."""

    def slope(s: float, y: np.ndarray) -> np.ndarray:
        tau, xi, k, q = shape.strain(min(max(s, 0.0), shape.arm.length))
        t, n, b = y[3:].reshape(3, 3)
        rates = (k * n - xi * b, tau * b - k * t, xi * t - tau * n)
        return (1 + q) * np.concatenate([t, *rates])

    frame = np.array(shape.arm.base_frame).T
    y = np.concatenate([shape.arm.base_position, frame.ravel()])
    ends = sorted({0.0, *(section.at for section in shape.arm.sections if section.at <= end), end})
    for a, b in pairwise(ends):
        inside = (a + 1e-9 * end, b)
        y = solve_ivp(slope, inside, y, rtol=1e-8, atol=1e-10, method="DOP853").y[:, -1]
    return y[:3], y[3:].reshape(3, 3).T


@cache
def plane_and_bend(shape: Shape, s: float) -> tuple[float, float]:
    """Return the angle of the plane from base to s, and the bend of the tangent in it [rad]."""
    place, frame = integrated(shape, s)
    t, n, b = np.array(shape.arm.base_frame).T
    place = place - np.array(shape.arm.base_position)
    angle = np.arctan2(-place @ n, place @ b)
    e = np.cos(ANGLE) * b - np.sin(ANGLE) * n
    return float(angle), float(np.arctan2(frame[:, 0] @ e, frame[:, 0] @ t))


@pytest.fixture(scope="module")
def plans() -> dict[str, Plan]:
    targets = {at: BendingPlane(ANGLE, BEND, 2, at) for at in ("tip", "anchorage")}
    return {at: plan(ARM, target, WATER, 20.0, starts=1) for at, target in targets.items()}


@pytest.mark.parametrize("at", ["tip", "anchorage"])
def test_the_named_point_bends_in_the_plane(plans: dict[str, Plan], at: str) -> None:
    shape = plans[at].shape
    assert plans[at].reached
    s = ARM.length if at == "tip" else ARM.sections[1].at
    angle, bend = plane_and_bend(shape, s)
    assert angle == pytest.approx(ANGLE, abs=1e-5)
    assert bend == pytest.approx(BEND, abs=1e-5)


def test_under_loads_the_other_point_bends_differently(plans: dict[str, Plan]) -> None:
    for found, s in ((plans["tip"], ARM.sections[1].at), (plans["anchorage"], ARM.length)):
        assert abs(plane_and_bend(found.shape, s)[1] - BEND) > np.radians(1)
    assert plans["tip"].effort != pytest.approx(plans["anchorage"].effort, rel=1e-2)


@pytest.mark.parametrize("at", ["tip", "anchorage"])
def test_the_outcome_says_which_point_bends(plans: dict[str, Plan], at: str) -> None:
    found = plans[at]
    other = {"tip": "anchorage", "anchorage": "tip"}[at]
    assert (
        f"The target is the bend of the {at}: under the loads the tip is bent by " in found.outcome
    )
    assert f'pass at="{other}"' in found.outcome
    bend = np.degrees(plane_and_bend(found.shape, ARM.length)[1])
    assert f"the tip is bent by {bend:.4g} deg" in found.outcome


def test_in_a_plane_without_loads_both_points_have_one_plan() -> None:
    """One tendon bends the arm in a plane; beyond the anchorage the arm is straight."""
    quarter = np.pi / 2
    both = [
        plan(ARM, BendingPlane(quarter, BEND, 2, at), PAPER, 20.0, starts=1)
        for at in ("tip", "anchorage")
    ]
    np.testing.assert_allclose(both[0].tensions, both[1].tensions, atol=1e-6)
    assert "The target is the bend" not in both[0].outcome


def test_a_missed_plane_is_off_by_degrees() -> None:
    """The message had the distance from the plane, such as 0.004 mm."""
    found = plan(ARM, BendingPlane(ANGLE, BEND, 1), WATER, 0.01, starts=1)
    assert not found.reached
    angle, bend = plane_and_bend(found.shape, ARM.length)
    off = abs(np.degrees(np.angle(np.exp(1j * (angle - ANGLE)))))
    assert f"misses the bending plane of the tip by {off:.3g} deg (" in found.outcome
    missed = abs(np.degrees(np.angle(np.exp(1j * (bend - BEND)))))
    assert f"the bend of the tip by {missed:.3g} deg" in found.outcome


def test_the_point_is_kept_in_files(plans: dict[str, Plan], tmp_path) -> None:  # type: ignore[no-untyped-def]
    path = plans["anchorage"].save(tmp_path / "plan.json")
    assert load_plan(path).targets == (BendingPlane(ANGLE, BEND, 2, "anchorage"),)


def test_another_point_is_refused() -> None:
    with pytest.raises(InputError, match=r"BendingPlane\.at = 'base': must be"):
        BendingPlane(ANGLE, BEND, 2, "base")  # type: ignore[arg-type]


def test_the_live_page_measures_the_named_point() -> None:
    tip, anchorage = (BendingPlane(ANGLE, BEND, 2, at) for at in ("tip", "anchorage"))
    assert goal_of(ARM, tip).s == ARM.length
    assert goal_of(ARM, anchorage).s == ARM.sections[1].at
    handle = handle_of(ARM, (anchorage,))
    assert handle.target(handle.start).at == "anchorage"  # type: ignore[union-attr]


def test_two_planes_at_one_point_must_agree() -> None:
    pair = (BendingPlane(ANGLE, BEND, 2), BendingPlane(ANGLE, 2 * BEND, 2))
    with pytest.raises(InputError, match="bending plane and bend of the tip"):
        plan(ARM, pair, PAPER, 20.0)
