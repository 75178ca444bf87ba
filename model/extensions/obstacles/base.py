"""What an obstacle is: a body, by its signed distance and the exact derivatives of that.

Sphere, capsule, box and half-space are convex, and one thing with different numbers: a box that may
have no size along some of its axes, in a layer of constant thickness. So there is one statement of
the distance, in CasADi's symbols: programs differentiate it, and NumPy arrays are put through it.

With y the point in the box's axes, h half its size and q = |y| - h, the distance is

    |max(q, 0)| + min(max(q), 0) - layer,

exact outside and inside of a box; of a half-space q_1 = y_1 - h_1 and the other sizes are beyond
all bounds. It is convex and 1-Lipschitz, as the distance from any convex body is. Source: Quilez,
"Distance functions", https://iquilezles.org/articles/distfunctions (box and round box).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from octoplan.model.paths import Array
from octoplan.model.rotations import norm
from octoplan.model.support.checks import SUCH, kind, numbers
from octoplan.model.support.errors import InputError
from octoplan.model.support.machine.functions import BatchFunction, cached

# Center (3,), axes (3, 3) column by column, half sizes (3,), layer, 1 for a half-space else 0.
SIZE = 17
# The axes of the base frame.
ALONG_BASE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Obstacle(ABC):
    """A body that an arm keeps clear of; frozen values are its kinds."""

    @property
    @abstractmethod
    def is_convex(self) -> bool:
        """Whether it is convex, so that its distance is nowhere below a tangent plane's."""

    @abstractmethod
    def at(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances (N,) [m] and their gradients (N, 3) at points (N, 3) [m]."""

    @abstractmethod
    def nearest_part(self, point: Array) -> Array:
        """Return the numbers (17,) of a convex body to keep a point (3,) clear of in its place.

        It is as near to a point outside as the body, and no part of the body near that is outside
        of it.
        """

    @abstractmethod
    def translated(self, by: tuple[float, ...]) -> Obstacle:
        """Return the obstacle after a translation (3,) [m]."""

    def distance(self, points: Any) -> Array:
        """Return signed distances (...) of points (..., 3) [m], below 0 inside."""
        result = _points(points)
        return self.at(result.reshape(-1, 3))[0].reshape(result.shape[:-1])

    def gradient(self, points: Any) -> Array:
        """Return the derivatives (..., 3) of the signed distance at points (..., 3) [m]."""
        result = _points(points)
        return self.at(result.reshape(-1, 3))[1].reshape(result.shape)


class Convex(Obstacle):
    """An obstacle that is a box in a layer; see the formula above.

    Attributes
    ----------
    places : tuple of str
        The fields that are points of it: a translation moves these.
    """

    places: ClassVar[tuple[str, ...]] = ("center",)
    is_convex = True

    @property
    @abstractmethod
    def numbers(self) -> Array:
        """The body as numbers (17,): center, axes column by column, half sizes, layer, open."""

    def at(self, points: Array) -> tuple[Array, Array]:
        """See Obstacle.at."""
        return pair_distances(self.numbers[None], points)

    def nearest_part(self, point: Array) -> Array:
        """See Obstacle.nearest_part: itself."""
        return self.numbers

    def translated(self, by: tuple[float, ...]) -> Obstacle:
        """See Obstacle.translated."""
        points = {name: np.add(getattr(self, name), by) for name in self.places}
        return replace(self, **points)  # type: ignore[type-var]


SUCH[Obstacle] = "an obstacle such as a Sphere"
SUCH[Convex] = "a convex obstacle such as Capsule(start, end, radius); a Mesh is none"


def numbers_of(obstacles: Sequence[Convex]) -> Array:
    """Return the numbers (M, 17) of convex obstacles."""
    return np.array([obstacle.numbers for obstacle in obstacles]).reshape(-1, SIZE)


def distances(bodies: Array, points: Array) -> tuple[Array, Array]:
    """Return signed distances (N, M) [m] and their gradients (N, M, 3) at points (N, 3) [m].

    From bodies by their numbers (M, 17).
    """
    m = len(bodies)
    result, gradient = pair_distances(bodies, np.repeat(points, m, axis=0))
    return result.reshape(-1, m), gradient.reshape(-1, m, 3)


def distances_from(obstacles: Sequence[Obstacle], points: Array) -> tuple[Array, Array]:
    """Return signed distances (..., M) [m] from M obstacles, and their gradients (..., M, 3).

    Of points (..., M, 3) [m], one for each obstacle; of (..., 1, 3) all obstacles have the same.
    """
    each = np.broadcast_to(points, (*points.shape[:-2], len(obstacles), 3))
    result, gradients = np.zeros(each.shape[:-1]), np.zeros(each.shape)
    for i, obstacle in enumerate(obstacles):
        d, g = obstacle.at(each[..., i, :].reshape(-1, 3))
        result[..., i], gradients[..., i, :] = (
            d.reshape(each.shape[:-2]),
            g.reshape(points[..., 0, :].shape),
        )
    return result, gradients


def pair_distances(bodies: Array, points: Array) -> tuple[Array, Array]:
    """Return signed distances (N,) [m] and gradients (N, 3), each of a point (N, 3) and a body.

    Fewer bodies are taken again and again.
    """
    distance, gradient = cached(BatchFunction, signed_distance())(points, bodies)
    return distance.ravel(), gradient


@lru_cache(maxsize=1)
def signed_distance() -> ca.Function:
    """Return point (3,), numbers (17,) of a body -> signed distance, its gradient (3,)."""
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", SIZE)
    y = ca.reshape(p[3:12], 3, 3).T @ (x - p[:3])
    size = ca.vertcat(*map(norm, ca.vertsplit(y)))
    first = (1 - p[16]) * size[0] + p[16] * y[0]
    q = ca.vertcat(first, size[1:]) - p[12:15]
    outside = norm(ca.fmax(q, 0))
    d = outside + ca.fmin(ca.mmax(q), 0) - p[15]
    results = [d, ca.densify(ca.gradient(d, x))]
    return ca.Function("distance", [x, p], results, {"cse": True})


def check_obstacles(obstacles: Any) -> tuple[Obstacle, ...]:
    """Return obstacles as a tuple; a single one may stand for itself. InputError for others."""
    result = (obstacles,) if isinstance(obstacles, Obstacle) else obstacles
    if not isinstance(result, Sequence):
        raise InputError("obstacles", obstacles, "a list of obstacles")
    allowed = (
        "an obstacle such as Sphere(center=(x, y, z), radius=r); what is Moving only in a "
        "trajectory, as all else has no time"
    )
    return tuple(kind(f"obstacles[{i}]", each, Obstacle, allowed) for i, each in enumerate(result))


def rounded(
    center: Array, axes: Array, half: Array, layer: float = 0.0, is_open: bool = False
) -> Array:
    """Return the numbers (17,) of a box in a layer; see Convex.numbers."""
    return np.concatenate([center, axes.T.ravel(), half, [layer, float(is_open)]])


def axes_with(direction: Array) -> Array:
    """Return a right-handed orthonormal frame (3, 3) whose first column is a direction."""
    t = direction / np.linalg.norm(direction)
    n = np.cross(t, np.eye(3)[np.argmin(np.abs(t))])
    n /= np.linalg.norm(n)
    return np.column_stack([t, n, np.cross(t, n)])


def _points(points: Any) -> Array:
    result = numbers("points", points, "points (..., 3) in m")
    if result.ndim == 0 or result.shape[-1] != 3:
        raise InputError("points", f"shape {result.shape}", "shape (..., 3)")
    return result
