"""Obstacles together: their distances from many points at once, and bounds around a point."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model.obstacles.base import Convex, Obstacle, numbers_of, pair_distances
from model.paths import Array

Counts = NDArray[np.int64]


class Bodies:
    """Obstacles, of which those that are convex by numbers are found in one call."""

    def __init__(self, obstacles: Sequence[Obstacle]) -> None:
        self.obstacles = tuple(obstacles)
        convex = [obstacle for obstacle in self.obstacles if isinstance(obstacle, Convex)]
        self._numbers = numbers_of(convex)
        self._by_numbers = np.array(
            [isinstance(obstacle, Convex) for obstacle in self.obstacles], dtype=bool
        )
        self._convex = np.array([obstacle.is_convex for obstacle in self.obstacles], dtype=bool)

    def __len__(self) -> int:
        return len(self.obstacles)

    def at(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances (..., M) [m] and gradients (..., M, 3) of points (..., M, 3).

        Each body has points of its own, or, of points (..., 1, 3), all have the same.
        """
        M = len(self)
        shape = (*points.shape[:-2], M)
        value = np.broadcast_to(points, (*shape, 3)).reshape(math.prod(shape[:-1]), M, 3)
        d, g = np.zeros(value.shape[:2]), np.zeros(value.shape)
        some = self._by_numbers
        if some.any() and len(value):
            numbers = np.tile(self._numbers, (len(value), 1))
            result, gradient = pair_distances(numbers, value[:, some].reshape(-1, 3))
            d[:, some] = result.reshape(len(value), -1)
            g[:, some] = gradient.reshape(len(value), -1, 3)
        for i in np.flatnonzero(~some):
            d[:, i], g[:, i] = self.obstacles[i].at(value[:, i])
        return d.reshape(shape), g.reshape((*shape, 3))

    def of(self, which: Counts, points: Array) -> Array:
        """Return the signed distances (N,) [m] of points (N, 3), each from one body (N,)."""
        values = np.zeros(len(points))
        for i in np.unique(which):
            values[which == i] = self.obstacles[i].at(points[which == i])[0]
        return values

    def change(self, gradients: Array, offsets: Array) -> Array:
        """Return lower bounds (..., M) of how distances change by offsets (..., M, 3) [m].

        From where their gradients (..., M, 3) are: a convex body's distance is nowhere below a
        tangent plane's; that of others falls no faster than a point goes.
        """
        along = np.einsum("...i,...i->...", gradients, offsets)
        return np.asarray(np.where(self._convex, along, -np.linalg.norm(offsets, axis=-1)))
