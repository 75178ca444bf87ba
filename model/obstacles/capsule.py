"""A rod with round ends."""

from __future__ import annotations

import numpy as np

from model.errors import InputError
from model.obstacles.base import Convex, axes_with, rounded
from model.obstacles.outlines import swept
from model.paths import Array
from model.quantities import Length, Place
from model.value import value


@value
class Capsule(Convex):
    """All points within a radius of a line segment.

    Attributes
    ----------
    start, end : (3,)
        Of the segment, in the base frame [m].
    radius : float
        [m].
    """

    start: Place
    end: Place
    radius: Length

    def __post_init__(self) -> None:
        if self.start == self.end:
            raise InputError("Capsule.end", self.end, "a point apart from the start; or a Sphere")

    @property
    def numbers(self) -> Array:
        """See Convex.numbers: a box of no width in a layer."""
        a, b = np.array(self.start), np.array(self.end)
        half = np.array([np.linalg.norm(b - a) / 2, 0.0, 0.0])
        return rounded((a + b) / 2, axes_with(b - a), half, self.radius)

    @property
    def outline(self) -> tuple[Array, Array]:
        """See Obstacle.outline."""
        return swept(np.array(self.start), np.array(self.end), self.radius)
