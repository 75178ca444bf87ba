"""A ball."""

from __future__ import annotations

import numpy as np

from model.obstacles.base import Convex, rounded
from model.obstacles.outlines import swept
from model.paths import Array
from model.quantities import Length, Place
from model.value import value


@value
class Sphere(Convex):
    """A ball.

    Attributes
    ----------
    center : (3,)
        In the base frame [m].
    radius : float
        [m].
    """

    center: Place
    radius: Length

    @property
    def numbers(self) -> Array:
        """See Convex.numbers: a point in a layer."""
        return rounded(np.array(self.center), np.eye(3), np.zeros(3), self.radius)

    @property
    def outline(self) -> tuple[Array, Array]:
        """See Obstacle.outline."""
        center = np.array(self.center)
        return swept(center, center, self.radius)
