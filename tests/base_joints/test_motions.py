"""Motions with base joints: targets met by an arm moved by hand, rates kept, refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from octoplan.model import Scene, settle
from octoplan.model.effects import Extension, Weight
from octoplan.planner import BaseJoints, Limits, Trajectory, plan, trajectory
from octoplan.planner.frontends.io.csv_files import motion_csv
from octoplan.planner.targets import TipPosition
from tests.base_joints.test_plans import BALL, CATHETER, PAPER, moved
from tests.refusals import Refused, check_refusal

JOINTS = BaseJoints((0.0, 0.05), (-np.pi, np.pi), insertion_rate=0.01, rotation_rate=1.0)
PLACES = [(0.1, 0.02, 0.03), (0.11, 0.0, 0.03), (0.12, -0.01, 0.03)]
TARGETS = [TipPosition(place) for place in PLACES]


def check_motion(motion: Trajectory, scene: Scene) -> None:
    """Check targets by shapes of arms moved by hand, and all rates at many instants."""
    assert motion.certificate.passed, motion.outcome
    for stop, place in zip(motion.stops, PLACES, strict=True):
        arm = moved(CATHETER, *motion.base[stop])
        tip = settle(arm, motion.tensions[stop], scene, 1e-8).tip
        assert np.linalg.norm(tip - place) < 1e-6 * CATHETER.length
    t = np.linspace(0.0, motion.duration, 1001)
    values = np.column_stack([motion.at(t), motion.base_at(t)])
    rates = np.abs(np.diff(values, axis=0)) / np.diff(t)[:, None]
    assert np.all(rates.max(axis=0) <= np.array([0.1, 0.01, 1.0]) * (1 + 1e-6))


@pytest.fixture(scope="module")
def quickest() -> Trajectory:
    return trajectory(CATHETER, TARGETS, PAPER, 20.0, rate_max=0.1, base=JOINTS)


def test_motions_move_the_base_within_its_rates(quickest: Trajectory) -> None:
    check_motion(quickest, PAPER)
    np.testing.assert_array_equal(quickest.base[0], 0.0)
    steps = np.abs(np.diff(quickest.base, axis=0)) / [0.01, 1.0]
    tension_steps = np.abs(np.diff(quickest.flat, axis=0)) / 0.1
    # One rate is at its limit on each way: the motion takes the least time.
    slowest = np.hstack([steps, tension_steps]).max(axis=1)
    np.testing.assert_allclose(slowest, np.diff(quickest.times), rtol=1e-3)
    header, *rows = motion_csv(quickest).decode().splitlines()
    assert header.endswith("insertion_m,rotation_rad") and len(rows) == 4
    half = quickest.shape(quickest.duration / 2)
    np.testing.assert_allclose(
        half.arm.base_position,
        moved(CATHETER, *quickest.base_at(quickest.duration / 2)).base_position,
    )


@pytest.mark.slow
def test_motions_under_weight_start_at_the_base_of_a_plan() -> None:
    scene = Scene(Extension(), Weight())
    start = plan(CATHETER, TipPosition((0.1, 0.0, -0.02)), scene, 20.0, base=JOINTS)
    motion = trajectory(CATHETER, TARGETS, scene, 20.0, rate_max=0.1, base=JOINTS, start=start)
    check_motion(motion, scene)
    np.testing.assert_allclose(motion.base[0], start.base)
    timed = trajectory(CATHETER, TARGETS, scene, 20.0, times=[5, 8, 12], base=JOINTS, start=start)
    assert timed.certificate.passed and timed.duration == 12.0


def _refused(**options: object) -> object:
    arguments = {"rate_max": 0.1, "base": JOINTS} | options
    return trajectory(CATHETER, TARGETS, PAPER, 20.0, **arguments)  # type: ignore[arg-type]


FREE = BaseJoints(insertion=(0.0, 0.05))
REFUSED: Refused = {
    "no rate": (lambda: _refused(base=FREE), "base", "insertion_rate"),
    "obstacles": (lambda: _refused(obstacles=[BALL]), "obstacles", "base joints"),
    "stroke rate": (lambda: _refused(stroke_rate_max=0.1), "stroke_rate_max", "base joints"),
    "strokes": (lambda: _refused(limits=Limits(stroke_max=0.1)), "stroke_max", "base joints"),
    "accelerations": (lambda: _refused(quasi_static=True), "tip_acceleration_max", "base joints"),
    "start outside": (
        lambda: _refused(
            start=plan(
                CATHETER,
                TipPosition((0.08, 0.0, 0.0)),
                PAPER,
                base=BaseJoints(insertion=(-0.1, 0.0)),
                certify=False,
            )
        ),
        "start",
        "base joints from",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_unsuitable_motions_of_the_base_are_refused(case: str) -> None:
    check_refusal(*REFUSED[case])


def test_motions_with_a_fixed_base_have_zero_joint_values(tmp_path: Path) -> None:
    target = [TipPosition(tuple(settle(CATHETER, [0.1], PAPER).tip))]
    motion = trajectory(CATHETER, target, PAPER, 20.0, rate_max=0.1)
    np.testing.assert_array_equal(motion.base, 0.0)
    assert "insertion" not in motion_csv(motion).decode()
