"""Curvatures along an obstacle: the reason that a part of the arm does not lie along it."""

from __future__ import annotations

from contextlib import suppress
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects, label

from octoplan.model.arm import Arm
from octoplan.model.effects import Extension
from octoplan.model.extensions.obstacles.base import Convex, Obstacle
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.errors import OctoplanError
from octoplan.planner.limits import TendonLimits, natural_tensions

# Number of places at which a part is evaluated.
LOOKS = 201
# Step of differences [m], and tolerance of gaps over the arm's length.
_STEP = 1e-6
# Tensions without a limit count as this multiple of the tensions that bend the arm by 1 rad.
_STRONG = 20.0


class ObstaclePart(Protocol):
    """A part of the arm along an obstacle; see Wrap."""

    @property
    def obstacle(self) -> Convex:
        """The obstacle."""

    @property
    def tolerance(self) -> float:
        """The largest gap over the arm's radius."""

    def part(self, arm: Arm) -> tuple[float, float]:
        """Return the arc lengths at which the part begins and ends [m]."""


def curvature_remark(wrap: ObstaclePart, shape: Shape, limits: TendonLimits) -> str:
    """Return the place of the largest gap, the curvatures there, and the part that is close.

    An obstacle is too tight if all of the part needs more curvature than the limits allow, and the
    tolerance does not suffice for the difference.
    """
    arm, (start, end) = shape.arm, wrap.part(shape.arm)
    s = np.linspace(max(start, 1e-3 * arm.length), end, LOOKS)
    radius = arm.outer_radius(s)[0]
    gaps, near = wrap.obstacle.distance(shape.position(s)) - radius, wrap.tolerance * radius
    if (gaps - near).max() <= _STEP * arm.length:
        return ""
    needed = curvature_along(wrap, shape, s)
    most, is_most = attainable_curvature(arm, shape.scene, limits, s)
    # An arc that is flatter by c on a length l leaves what it lies along by c l^2 / 8.
    short = float((curvature_along(wrap, shape, s, wrap.tolerance) - most).min())
    tight = is_most and short * (end - start) ** 2 / 8 > near.max()
    k = int(np.argmax(needed - most if tight else gaps - near))
    place, asks = f"at {1e3 * s[k]:.4g} mm", f"asks for {needed[k]:.3g} /m"
    allow = f"the limits allow {'' if is_most else 'at least '}{most[k]:.3g} /m"
    if tight:
        where = f"{place}, in the direction of the shape found"
        said = f"The obstacle is too tight for the arm {where}: it {asks}, {allow}"
    else:
        cause = "no shape along the whole part was found, though its curvature may be within them"
        where = f"{place}, where the gap is {1e3 * gaps[k]:.3g} mm"
        said = f"The obstacle {asks}, {allow} there, {where}: {cause}"
    along = (gaps >= -_STEP * arm.length) & (gaps <= near)
    return f"{said}. {_part_along(wrap, shape, s, along)}"


def _part_along(wrap: ObstaclePart, shape: Shape, s: Array, near: NDArray[np.bool_]) -> str:
    """Return a sentence about the longest part that lies along the obstacle in a shape."""
    parts = [s[part] for (part,) in find_objects(label(near)[0])]
    longest = max(parts, key=len, default=s[:0])
    if longest.size < 2:
        return "In that shape no part of it lies along the obstacle."
    first, last = longest[[0, -1]]
    turns = turned(shape, wrap.obstacle, np.linspace(first, last, LOOKS))[-1]
    where = f"{1e3 * first:.4g} to {1e3 * last:.4g} mm"
    size = f"a length of {1e3 * (last - first):.3g} mm or {turns:.2g} turns"
    return f"In that shape the part from {where} lies along the obstacle, {size}."


def turned(shape: Shape, obstacle: Obstacle, s: Array) -> Array:
    """Return the turns around an obstacle from the first arc length to each of (n,) [m].

    The rotation of the obstacle's normal along the arm, over 2 pi.
    """
    normals = obstacle.gradient(shape.position(s))
    half = np.linalg.norm(np.diff(normals, axis=0), axis=1) / 2
    return np.append(0.0, np.cumsum(np.arcsin(np.minimum(half, 1.0)) / np.pi))


def curvature_along(wrap: ObstaclePart, shape: Shape, s: Array, gap: float = 0.0) -> Array:
    """Return the curvature of a midline that lies along the obstacle (k,) [1/m].

    The curvature t . H t of the surface at the distance of the midline, in the direction t of the
    arm's tangent, with the Hessian H of the distance. `gap` is the gap over the arm's radius.
    """
    arm, body = shape.arm, wrap.obstacle
    points, radius = shape.position(s), arm.outer_radius(s)[0]
    normals = body.gradient(points)
    near = points + ((1 + gap) * radius - body.distance(points))[:, None] * normals
    t = shape.frame(s)[:, :, 0].copy()
    t -= (t * normals).sum(axis=1)[:, None] * normals
    t /= np.maximum(np.linalg.norm(t, axis=1), 1e-12)[:, None]
    ends = [body.gradient(near + sign * _STEP * t) for sign in (1, -1)]
    return np.asarray(((ends[0] - ends[1]) * t).sum(axis=1) / (2 * _STEP))


def attainable_curvature(
    arm: Arm, scene: Scene, limits: TendonLimits, s: Array
) -> tuple[Array, bool]:
    """Return a curvature (k,) [1/m] that tendons within limits give a free arm at s.

    All tendons of one side pull as hard as they may, the others as little: of all sides the best.
    Then whether limits of single tensions are all that bounds it: of tendons without limit no more
    is looked at than 20 times what bends the arm by 1 rad, of those with a sum a part for each. So
    strong a pull may leave no shape: a weaker one may bend the arm more than others do.
    """
    strong = _STRONG * natural_tensions(arm)
    lower, upper = np.array(limits.lower), np.minimum(np.array(limits.upper), strong)
    spare = np.inf if limits.total is None else max(limits.total - lower.sum(), 0.0)
    free = Scene(Extension()) if scene.has(Extension) else Scene()
    curvatures = [np.zeros(s.size)]
    # Sides change where a direction is across a tendon's: one between any two of these is tried.
    phi = np.array([tendon_angle for _, tendon_angle in arm.tendons])
    across = np.unique(np.round(np.append(phi, phi + np.pi) - np.pi / 2, 9) % (2 * np.pi))
    towards = across + np.diff(across, append=across[0] + 2 * np.pi) / 2
    sides = np.unique(np.cos(phi - towards[:, None]) > 0, axis=0)
    for side in sides:
        more = np.where(side, upper - lower, 0.0)
        T = lower + more * min(1.0, spare / max(more.sum(), 1e-300))
        with suppress(OctoplanError):
            strains = settle(arm, T, free, 1e-4).strain(s)
            curvatures.append(np.hypot(strains[:, 1], strains[:, 2]))
    is_most = limits.total is None and bool((np.array(limits.upper) <= strong).all())
    return np.max(curvatures, axis=0), is_most and len(curvatures) > len(sides)
