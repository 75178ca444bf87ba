"""Convex obstacles: spheres, capsules, boxes and half-spaces."""

from __future__ import annotations

import numpy as np

from octoplan.model.extensions.obstacles.base import ALONG_BASE, Convex, axes_with, rounded
from octoplan.model.paths import Array
from octoplan.model.support.checks import LARGEST
from octoplan.model.support.errors import InputError
from octoplan.model.support.value import Axes, Direction, Length, Place, Sizes, value


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
    def parameters(self) -> Array:
        """See Convex.parameters: a point in a layer."""
        return rounded(np.array(self.center), np.eye(3), np.zeros(3), self.radius)


@value
class Capsule(Convex):
    """All points within a radius of a line segment.

    Attributes
    ----------
    start, end : (3,)
        End points of the segment, in the base frame [m].
    radius : float
        [m].
    """

    start: Place
    end: Place
    radius: Length
    places = ("start", "end")

    def __post_init__(self) -> None:
        if self.start == self.end:
            raise InputError("Capsule.end", self.end, "a point apart from the start; or a Sphere")

    @property
    def parameters(self) -> Array:
        """See Convex.parameters: a box without width in a layer."""
        a = np.array(self.start)
        b = np.array(self.end)
        half = np.array([np.linalg.norm(b - a) / 2, 0.0, 0.0])
        return rounded((a + b) / 2, axes_with(b - a), half, self.radius)


@value
class Box(Convex):
    """A box.

    Attributes
    ----------
    center : (3,)
        In the base frame [m].
    size : (3,)
        Lengths of the edges [m].
    frame : (3, 3)
        Directions of the edges, by columns; the axes of the base frame unless given.
    """

    center: Place
    size: Sizes
    frame: Axes = ALONG_BASE

    @property
    def parameters(self) -> Array:
        """See Convex.parameters."""
        half = np.array(self.size) / 2
        return rounded(np.array(self.center), np.array(self.frame), half)


@value
class HalfSpace(Convex):
    """All points behind a plane, such as a wall, a floor or a table.

    Attributes
    ----------
    point : (3,)
        A point of the plane, in the base frame [m].
    normal : (3,)
        Normal of the plane, towards the free side; of any length but 0.
    """

    point: Place
    normal: Direction
    places = ("point",)

    @property
    def parameters(self) -> Array:
        """See Convex.parameters: a box of unlimited size, with one face."""
        half = np.array([0.0, LARGEST, LARGEST])
        axes = axes_with(np.array(self.normal))
        return rounded(np.array(self.point), axes, half, is_open=True)
