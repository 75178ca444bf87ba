"""Signed distances of obstacles against closed forms in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from model.obstacles import Box, Capsule, HalfSpace, Obstacle, Sphere

START, END, RADIUS = np.array([0.1, -0.05, 0.0]), np.array([0.2, 0.08, -0.1]), 0.02
FRAME = np.linalg.qr(np.array([[1.0, 2, 0], [0, 1, 3], [2, 0, 1]]))[0]
CENTER, SIZE = np.array([0.1, 0.05, -0.02]), np.array([0.06, 0.1, 0.03])
POINTS = np.random.default_rng(3).uniform(-0.3, 0.4, (400, 3))


def to_segment(points: np.ndarray) -> np.ndarray:
    along = END - START
    share = np.clip((points - START) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(points - START - share[:, None] * along, axis=1) - RADIUS


def to_box(points: np.ndarray) -> np.ndarray:
    beyond = np.abs((points - CENTER) @ FRAME) - SIZE / 2
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return outside + np.minimum(beyond.max(axis=1), 0.0)


@pytest.mark.parametrize(
    ("obstacle", "wanted"),
    [
        (Sphere(tuple(START), RADIUS), np.linalg.norm(POINTS - START, axis=1) - RADIUS),
        (Capsule(tuple(START), tuple(END), RADIUS), to_segment(POINTS)),
        (
            HalfSpace(tuple(START), (1.0, 2.0, 2.0)),
            (POINTS - START) @ np.array([1.0, 2.0, 2.0]) / 3,
        ),
        (Box(tuple(CENTER), tuple(SIZE), tuple(map(tuple, FRAME.tolist()))), to_box(POINTS)),
    ],
    ids=["sphere", "capsule", "half-space", "box"],
)
def test_distances_are_those_of_closed_forms(obstacle: Obstacle, wanted: np.ndarray) -> None:
    np.testing.assert_allclose(obstacle.distance(POINTS), wanted, rtol=0, atol=1e-12)
