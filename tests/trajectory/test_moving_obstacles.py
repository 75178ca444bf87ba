"""Motions among moving obstacles: clear of the obstacles at each instant."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, InputError, Scene, settle
from octoplan.model.effects import Extension
from octoplan.model.extensions.obstacles import Moving, Sphere
from octoplan.planner import Trajectory, plan, trajectory
from octoplan.planner.frontends.io.scene_file import load
from octoplan.planner.targets import TipPosition

ARM, SCENE = Arm.from_paper("table-4"), Scene(Extension())
TARGETS = [TipPosition((0.32, 0.08, -0.1)), TipPosition((0.3, 0.12, -0.12))]
TIMES = [1.0, 2.0]


def _sees(tr: Trajectory, obstacle: Moving, count: int) -> float:
    """Return the least distance at many instants from the obstacle at these instants."""
    s = np.linspace(0.0, ARM.length, 300)
    R = ARM.radius.evaluate(s, ARM.length)[0]
    gaps = []
    for t in np.linspace(0.0, tr.duration, count):
        x = settle(ARM, np.ravel(tr.at(t)), SCENE, 1e-6).position(s)
        gaps.append(float((obstacle.obstacle.distance(x - obstacle.displacement(t)) - R).min()))
    return min(gaps)


@pytest.fixture(scope="module")
def free() -> Trajectory:
    return trajectory(ARM, TARGETS, SCENE, 20.0, rate_max=5.0, times=TIMES)


def _crossing(free: Trajectory) -> Moving:
    """Return a ball that passes in front of the arm half way to the second target."""
    place = free.shape(1.5).position(0.7 * ARM.length)
    aside = np.array([0.0, 0.0, 0.15])
    ball = Sphere(tuple(place + np.array([0.0, 0.012, 0.0])), 0.015)
    return Moving(ball, (0.5, 2.5), (tuple(-aside), tuple(aside)))


@pytest.mark.slow
def test_a_motion_keeps_clear_of_a_ball_that_passes(free: Trajectory) -> None:
    ball = _crossing(free)
    assert _sees(free, ball, 61) < 0
    tr = trajectory(
        ARM, TARGETS, SCENE, 20.0, rate_max=5.0, times=TIMES, obstacles=[ball], clearance=0.001
    )
    assert tr.certificate.passed, tr.outcome
    assert _sees(tr, ball, 121) >= 0.001 + tr.certificate.clearance - 1e-6
    np.testing.assert_allclose(tr.times[list(tr.stops)], TIMES)


@pytest.mark.slow
def test_a_motion_of_limited_accelerations_keeps_clear_of_a_ball_that_passes() -> None:
    limits = {"stroke_rate_max": 0.05, "stroke_acceleration_max": 0.2}
    free = trajectory(ARM, TARGETS, SCENE, 20.0, **limits)  # type: ignore[arg-type]
    when = 0.4 * free.duration
    ball = Sphere(tuple(free.shape(when).position(0.78 * ARM.length)), 0.015)
    moving = Moving(ball, (0, when, free.duration), ((0, 0.02, 0.02), (0, 0, 0), (0, -0.02, -0.02)))
    assert _sees(free, moving, 31) < 0
    given: dict[str, Any] = {**limits, "obstacles": [moving], "clearance": 0.001}
    tr = trajectory(ARM, TARGETS, SCENE, 20.0, **given)
    assert tr.certificate.passed, tr.outcome
    assert tr.certificate.stroke_acceleration <= 1 + 1e-3
    assert _sees(tr, moving, 121) >= 0.001 - 1e-6


def test_a_ball_that_is_elsewhere_at_the_time_changes_nothing(free: Trajectory) -> None:
    ball = _crossing(free)
    late = Moving(ball.obstacle, (3.5, 5.5), ball.path)
    given = {"times": TIMES, "obstacles": [late]}
    tr = trajectory(ARM, TARGETS, SCENE, 20.0, rate_max=5.0, **given)  # type: ignore[arg-type]
    assert tr.certificate.passed, tr.outcome
    # Both are solved to ipopt's tolerance.
    np.testing.assert_allclose(tr.flat, free.flat, atol=1e-7)
    assert pickle.loads(pickle.dumps(late)) == late


def test_what_moves_is_read_from_scene_files_and_is_none_of_plans(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    text = """
[arm]
preset = "table-4"
[limits]
tension_max = 20
[motion]
times_s = [2.0]
[[waypoints]]
type = "tip-position"
position_mm = [320, 80, -100]
[[obstacles]]
type = "sphere"
center_mm = [250, 0, 100]
radius_mm = 20
path_s_mm = [[0, 0, 0, 0], [2, 0, 50, 0]]
"""
    scene.write_text(text)
    found = load(scene).options["obstacles"][0]
    assert found == Moving(Sphere((0.25, 0.0, 0.1), 0.02), (0, 2), ((0, 0, 0), (0, 0.05, 0)))
    np.testing.assert_allclose(found.displacement([0.5, 3.0]), [(0, 0.0125, 0), (0, 0.05, 0)])
    assert found.at(1.0).distance((0.25, 0.025, 0.1)) == pytest.approx(-0.02)
    with pytest.raises(InputError, match=r"obstacles\[0\].*trajectory"):
        plan(ARM, TARGETS[0], SCENE, 20.0, obstacles=[found])
