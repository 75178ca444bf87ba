"""Arms whose contact has closed forms, and distances from obstacles by NumPy alone."""

from __future__ import annotations

import numpy as np

from octoplan.model import Anchorage, Arm, Material
from octoplan.model.extensions.obstacles import Box, Capsule, HalfSpace, Sphere
from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.paths import Linear
from tests.oracles import Array


def bar(length: float, radius: float, E: float, density: float = 1000.0) -> Arm:
    """Return a straight bar with four tendons at half its radius."""
    ends = (Anchorage(length, Linear(radius / 2, radius / 2)),)
    material = Material(E=E, nu=0.5, density=density)
    return Arm(length, Linear(radius, radius), ends, material)


def stiffness(radius: float, E: float) -> float:
    """Return E J [N m2]."""
    return E * np.pi * radius**4 / 4


def distance(body: Obstacle, x: Array) -> Array:
    """Return the signed distance (N,) of points (N, 3)."""
    if isinstance(body, Sphere):
        return np.asarray(np.linalg.norm(x - body.center, axis=1) - body.radius)
    if isinstance(body, HalfSpace):
        n = np.array(body.normal) / np.linalg.norm(body.normal)
        return np.asarray((x - np.array(body.point)) @ n)
    if isinstance(body, Capsule):
        a, b = np.array(body.start), np.array(body.end)
        share = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        return np.asarray(np.linalg.norm(x - a - share[:, None] * (b - a), axis=1) - body.radius)
    assert isinstance(body, Box)
    q = np.abs((x - np.array(body.center)) @ np.array(body.frame)) - np.array(body.size) / 2
    return np.asarray(np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0))
