"""Convex obstacles by their signed distance: spheres, capsules, boxes and half spaces."""

from __future__ import annotations

from itertools import product

import numpy as np

from model.errors import InputError
from model.obstacles.base import ALONG_BASE, ENDLESS, Convex, axes_with, rounded
from model.paths import Array
from model.quantities import Axes, Direction, Length, Place, Sizes
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
    places = ("start", "end")

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
    frame: Axes = ALONG_BASE

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
    places = ("point",)

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


# Points of an outline around a round body, and along a quarter of its section.
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
