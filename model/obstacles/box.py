"""A box with sharp edges."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from model.checks import finite_array, positive, vector
from model.errors import InputError
from model.obstacles.base import Convex, rounded
from model.paths import Array
from model.quantities import Place, Sizes

_ALONG_BASE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
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
    frame: tuple[tuple[float, ...], ...] = _ALONG_BASE

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", vector("Box.center", self.center))
        size = [positive("Box.size", value) for value in vector("Box.size", self.size)]
        object.__setattr__(self, "size", tuple(size))
        frame = finite_array("Box.frame", self.frame, (3, 3))
        if not np.allclose(frame.T @ frame, np.eye(3), atol=1e-9):
            raise InputError("Box.frame", self.frame, "an orthonormal frame")
        object.__setattr__(self, "frame", tuple(tuple(row) for row in frame.tolist()))

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
