"""Interface of obstacles: bodies with a signed distance and its exact gradient.

Sphere, capsule, box and half-space are one convex body with different parameters: a box, which may
have zero size along some axes, in a layer of constant thickness. The distance is therefore defined
once, in CasADi symbols: programs differentiate it, and a compiled function evaluates it for NumPy
arrays.

For a point y in the axes of the box, half sizes h and q = |y| - h, the distance is

    |max(q, 0)| + min(max(q), 0) - layer,

which is exact outside and inside of a box. A half-space has q_1 = y_1 - h_1, and unlimited other
sizes. The distance is convex and 1-Lipschitz, as for any convex body. Source: Quilez,
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
from octoplan.model.support.checks import SUCH, kind, numbers, numbers_text
from octoplan.model.support.errors import Described, InputError
from octoplan.model.support.machine.functions import BatchFunction, cached

# Number of parameters of a convex body: center (3,), axes (3, 3) column by column, half sizes (3,),
# layer, and 1 for a half-space, otherwise 0.
SIZE = 17
# The axes of the base frame.
ALONG_BASE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Obstacle(ABC):
    """A body from which an arm keeps clear; subclasses are frozen values."""

    @property
    @abstractmethod
    def is_convex(self) -> bool:
        """Whether the body is convex, so that tangent planes bound the distance from below."""

    @abstractmethod
    def at(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances (N,) [m] and their gradients (N, 3) at points (N, 3) [m]."""

    @abstractmethod
    def nearest_part(self, point: Array) -> Array:
        """Return the parameters (17,) of a convex body that bounds the obstacle near a point.

        Outside of the obstacle, both have the same distance from the point, and the convex body
        contains all of the obstacle near the point.
        """

    @abstractmethod
    def translated(self, by: tuple[float, ...]) -> Obstacle:
        """Return the obstacle translated by a vector (3,) [m]."""

    def distance(self, points: Any) -> Array:
        """Return signed distances (...) at points (..., 3) [m], negative inside."""
        result = _points(points)
        return self.at(result.reshape(-1, 3))[0].reshape(result.shape[:-1])

    def gradient(self, points: Any) -> Array:
        """Return the derivatives (..., 3) of the signed distance at points (..., 3) [m]."""
        result = _points(points)
        return self.at(result.reshape(-1, 3))[1].reshape(result.shape)


class Convex(Obstacle):
    """An obstacle that is a box in a layer; see the formula in the module's docstring.

    Attributes
    ----------
    places : tuple of str
        Names of the fields that a translation changes.
    """

    places: ClassVar[tuple[str, ...]] = ("center",)
    is_convex = True

    @property
    @abstractmethod
    def parameters(self) -> Array:
        """Parameters (17,): center, axes column by column, half sizes, layer, half-space flag."""

    def at(self, points: Array) -> tuple[Array, Array]:
        """See Obstacle.at."""
        return pair_distances(self.parameters[None], points)

    def nearest_part(self, point: Array) -> Array:
        """See Obstacle.nearest_part: the body itself."""
        return self.parameters

    def translated(self, by: tuple[float, ...]) -> Obstacle:
        """See Obstacle.translated."""
        points = {name: np.add(getattr(self, name), by) for name in self.places}
        return replace(self, **points)  # type: ignore[type-var]


SUCH[Obstacle] = "an obstacle such as a Sphere"
SUCH[Convex] = "a convex obstacle such as Capsule(start, end, radius), not a Mesh"


def convex_parameters(obstacles: Sequence[Convex]) -> Array:
    """Return the parameters (M, 17) of convex obstacles."""
    return np.array([obstacle.parameters for obstacle in obstacles]).reshape(-1, SIZE)


def distances(bodies: Array, points: Array) -> tuple[Array, Array]:
    """Return signed distances (N, M) [m] and their gradients (N, M, 3) at points (N, 3) [m].

    Each body is given by its parameters (M, 17).
    """
    m = len(bodies)
    result, gradient = pair_distances(bodies, np.repeat(points, m, axis=0))
    return result.reshape(-1, m), gradient.reshape(-1, m, 3)


def distances_from(obstacles: Sequence[Obstacle], points: Array) -> tuple[Array, Array]:
    """Return signed distances (..., M) [m] from M obstacles, and their gradients (..., M, 3).

    Points (..., M, 3) [m] are one for each obstacle; points (..., 1, 3) are the same for all.
    """
    each = np.broadcast_to(points, (*points.shape[:-2], len(obstacles), 3))
    result = np.zeros(each.shape[:-1])
    gradients = np.zeros(each.shape)
    for i, obstacle in enumerate(obstacles):
        d, g = obstacle.at(each[..., i, :].reshape(-1, 3))
        result[..., i] = d.reshape(each.shape[:-2])
        gradients[..., i, :] = g.reshape(points[..., 0, :].shape)
    return result, gradients


def pair_distances(bodies: Array, points: Array) -> tuple[Array, Array]:
    """Return signed distances (N,) [m] and gradients (N, 3) for pairs of a point and a body.

    Bodies are repeated cyclically if there are fewer bodies than points.
    """
    distance, gradient = cached(BatchFunction, signed_distance())(points, bodies)
    return distance.ravel(), gradient


@lru_cache(maxsize=1)
def signed_distance() -> ca.Function:
    """Return the function point (3,), body parameters (17,) -> signed distance, gradient (3,)."""
    x = ca.SX.sym("x", 3)
    p = ca.SX.sym("p", SIZE)
    y = ca.reshape(p[3:12], 3, 3).T @ (x - p[:3])
    size = ca.vertcat(*map(norm, ca.vertsplit(y)))
    first = (1 - p[16]) * size[0] + p[16] * y[0]
    q = ca.vertcat(first, size[1:]) - p[12:15]
    outside = norm(ca.fmax(q, 0))
    d = outside + ca.fmin(ca.mmax(q), 0) - p[15]
    results = [d, ca.densify(ca.gradient(d, x))]
    return ca.Function("distance", [x, p], results, {"cse": True})


def check_obstacles(obstacles: Any) -> tuple[Obstacle, ...]:
    """Return one or several obstacles as a tuple, or raise InputError."""
    result = (obstacles,) if isinstance(obstacles, Obstacle) else obstacles
    allowed = "an obstacle such as Sphere(center=(x, y, z), radius=r)"
    if not isinstance(result, Sequence) or isinstance(result, str):
        raise InputError("obstacles", obstacles, f"a list of obstacles, each {allowed}")
    allowed += "; Moving obstacles only in a trajectory"
    return tuple(kind(f"obstacles[{i}]", each, Obstacle, allowed) for i, each in enumerate(result))


def rounded(
    center: Array, axes: Array, half: Array, layer: float = 0.0, is_open: bool = False
) -> Array:
    """Return the parameters (17,) of a box in a layer; see Convex.parameters."""
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
        raise InputError(
            "points", Described(numbers_text(result.shape)), "3 coordinates [m], or rows of 3"
        )
    return result
