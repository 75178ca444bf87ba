"""All that is behind a plane."""

from __future__ import annotations

import numpy as np

from model.obstacles.base import ENDLESS, Convex, axes_with, rounded
from model.paths import Array
from model.quantities import Direction, Place
from model.value import value

# How far from the point a figure shows the plane [m].
_SHOWN = 0.15


@value
class HalfSpace(Convex):
    """All that is behind a plane: a wall, a floor, a table.

    Attributes
    ----------
    point : (3,)
        On the plane, in the base frame [m].
    normal : (3,)
        Out of the body, towards the free side; of any length but 0.
    """

    point: Place
    normal: Direction

    @property
    def numbers(self) -> Array:
        """See Convex.numbers: a box without end, but for one side."""
        half = np.array([0.0, ENDLESS, ENDLESS])
        axes = axes_with(np.array(self.normal))
        return rounded(np.array(self.point), axes, half, is_open=True)

    @property
    def outline(self) -> tuple[Array, Array]:
        """See Obstacle.outline: a square of the plane."""
        axes = axes_with(np.array(self.normal))
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * _SHOWN
        return np.array(self.point) + corners @ axes[:, 1:].T, np.array([(0, 1, 2), (0, 2, 3)])
