"""A box with sharp edges."""

from __future__ import annotations

from itertools import product

import numpy as np

from model.obstacles.base import Convex, rounded
from model.paths import Array
from model.quantities import Axes, Place, Sizes
from model.value import value

_ALONG_BASE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@value
class Box(Convex):
    """A box.

    Attributes
    ----------
    center : (3,)
        In the base frame [m].
    size : (3,)
        Lengths of its edges [m].
    frame : (3, 3)
        Columns are the directions of the edges; those of the coordinates unless given.
    """

    center: Place
    size: Sizes
    frame: Axes = _ALONG_BASE

    @property
    def numbers(self) -> Array:
        """See Convex.numbers."""
        half = np.array(self.size) / 2
        return rounded(np.array(self.center), np.array(self.frame), half)

    @property
    def outline(self) -> tuple[Array, Array]:
        """See Obstacle.outline."""
        signs = np.array(list(product((-1, 1), repeat=3)))
        corners = np.array(self.center) + signs * np.array(self.size) / 2 @ np.array(self.frame).T
        sides = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
        triangles = [half for a, b, c, d in sides for half in ((a, b, c), (a, c, d))]
        return corners, np.array(triangles)
