"""Limits of strokes and stability of motions between waypoints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import ExactTendons, TipLoad
from octoplan.model.tendons import rest_lengths
from octoplan.planner import trajectory
from octoplan.planner.extensions.trajectory.time_law import Timed
from octoplan.planner.limits import Limits
from octoplan.planner.targets import TipPosition
from tests.lengths.cases import cylinder

ARM = Arm.from_paper("table-4")


@pytest.mark.slow
def test_strokes_are_within_their_limits_between_waypoints_too() -> None:
    """A winch was 1 mm beyond its limit between two allowed waypoints."""
    first, last = np.zeros(12), np.zeros(12)
    first[[5, 6, 8, 10, 11]] = 1.2, 1.4, 3.0, 2.5, 6.0
    last[[2, 3, 4, 5, 7, 9]] = 0.1, 0.5, 1.3, 0.9, 1.7, 0.8
    silicone = Scene.silicone()
    shapes = [settle(ARM, T, silicone, 1e-8) for T in (first, last)]
    ends = rest_lengths(ARM) - [shape.tendon_lengths for shape in shapes]
    low, high = np.minimum(ends.min(axis=0), 0.0), np.maximum(ends.max(axis=0), 0.0)
    limits = Limits(stroke_min=low - 1e-9, stroke_max=high + 1e-9)
    target = TipPosition(shapes[-1].tip)
    motion = trajectory(ARM, [target], silicone, 20.0, rate_max=2.0, start=first, limits=limits)
    assert motion.certificate.passed, motion.outcome
    times = np.linspace(0.0, motion.duration, 101)
    taken = np.array([motion.shape(t).tendon_lengths for t in times])
    taken = rest_lengths(ARM) - taken
    assert np.all((low - 1e-6 * ARM.length < taken) & (taken < high + 1e-6 * ARM.length))
    law = PPoly(np.array([[0.0], [1.0], [0.0]]), np.array([0.0, 1.0]))
    straight = Timed(np.array([first, last]), (1,), law.x, law, np.zeros(3))
    on_it = first + np.linspace(0.0, 1.0, 101)[:, None] * (last - first)
    taken = rest_lengths(ARM) - [settle(ARM, T, silicone, 1e-8).tendon_lengths for T in on_it]
    beyond = float(np.maximum(low - taken, taken - high).max())
    assert beyond > 1e-3
    told = replace(motion, way=straight).certificate
    assert told.strokes == pytest.approx(beyond, rel=1e-2)
    assert any("strokes" in failure for failure in told.failures)


@pytest.mark.parametrize(("share", "jumps"), [(0.9, ()), (1.1, (1,))])
def test_an_arm_that_snaps_through_under_its_load_is_told_to_jump(
    share: float, jumps: tuple[int, ...]
) -> None:
    """Above Euler's load a column goes from one side to the other by a snap, at equal tensions."""
    arm = cylinder((0.2,))
    EJ = arm.material.E * np.pi * arm.base_radius**4 / 4
    load = share * np.pi**2 * EJ / (2 * arm.length) ** 2
    column = Scene(ExactTendons(), TipLoad((-load, 0.0, 0.0)))
    left, right = np.eye(4)[[0, 2]] * 0.3
    target = TipPosition(settle(arm, right, column).tip)
    motion = trajectory(arm, [target], column, 1.0, rate_max=1.0, start=left)
    assert motion.certificate.jumps == jumps
    assert motion.certificate.passed == (not jumps)
