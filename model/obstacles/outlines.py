"""Surfaces of round bodies as triangles, for figures."""

from __future__ import annotations

import numpy as np

from model.obstacles.base import axes_with
from model.paths import Array

_AROUND, _ALONG = 24, 7


def swept(start: Array, end: Array, radius: float) -> tuple[Array, Array]:
    """Return points (N, 3) and triangles (M, 3) of a ball swept from start to end (3,) [m]."""
    length = np.linalg.norm(end - start)
    axes = axes_with(end - start) if length > 0 else np.eye(3)
    half = np.linspace(0.0, np.pi / 2, _ALONG)
    along = np.concatenate([-radius * np.cos(half), length + radius * np.sin(half)])
    across = radius * np.concatenate([np.sin(half), np.cos(half)])
    phi = np.arange(_AROUND) * 2 * np.pi / _AROUND
    ring = axes[:, 1:] @ np.array([np.cos(phi), np.sin(phi)])
    axis = start + along[:, None] * axes[:, 0]
    points = (axis[:, None] + across[:, None, None] * ring.T).reshape(-1, 3)
    i, j = np.divmod(np.arange(_AROUND * (along.size - 1)), _AROUND)
    here, beside = i * _AROUND + j, i * _AROUND + (j + 1) % _AROUND
    triangles = [(here, beside, beside + _AROUND), (here, beside + _AROUND, here + _AROUND)]
    return points, np.concatenate([np.column_stack(three) for three in triangles])
