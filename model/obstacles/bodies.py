"""Obstacles together: their distances from many points at once, and bounds around a point."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from model.obstacles.base import Obstacle
from model.paths import Array


class Bodies:
    """Obstacles, each with points of its own."""

    def __init__(self, obstacles: Sequence[Obstacle]) -> None:
        self.obstacles = tuple(obstacles)
        self._convex = np.array([obstacle.is_convex for obstacle in self.obstacles], dtype=bool)

    def __len__(self) -> int:
        return len(self.obstacles)

    def at(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances (..., M) [m] and gradients (..., M, 3) of points (..., M, 3).

        Of points (..., 1, 3) all bodies have the same.
        """
        each = np.broadcast_to(points, (*points.shape[:-2], len(self), 3))
        d, g = np.zeros(each.shape[:-1]), np.zeros(each.shape)
        for i, body in enumerate(self.obstacles):
            distance, gradient = body.at(each[..., i, :].reshape(-1, 3))
            d[..., i], g[..., i, :] = (
                distance.reshape(d.shape[:-1]),
                gradient.reshape(g[..., 0, :].shape),
            )
        return d, g

    def change(self, gradients: Array, offsets: Array) -> Array:
        """Return lower bounds (..., M) of how distances change by offsets (..., M, 3) [m].

        From where their gradients (..., M, 3) are: a convex body's distance is nowhere below a
        tangent plane's; that of others falls no faster than a point goes.
        """
        along = np.einsum("...i,...i->...", gradients, offsets)
        return np.asarray(np.where(self._convex, along, -np.linalg.norm(offsets, axis=-1)))
