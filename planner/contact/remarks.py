"""What is said of wraps and holds that cannot be had: where curvatures differ, what is left."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from model.arm import Arm
from model.effects import Extension
from model.paths import Array
from model.scene import Scene
from model.settle import settle
from model.shape import Shape
from planner.contact.grasp import left_of, needed_friction
from planner.program.limits import Limits, natural_tensions
from planner.targets.base import Target
from planner.targets.hold import Hold
from planner.targets.wrap import Wrap

# Where a part is looked at, and the step of differences [m].
_LOOKS, _STEP = 201, 1e-6
# What stands for no limit of tensions, in those that bend the arm by 1 rad.
_STRONG = 20.0
_CLOSE = 1e-6


def remarks(
    targets: Iterable[Target], shape: Shape, limits: Limits, missed: bool, accuracy: float
) -> str:
    """Return sentences about the wraps that are missed, and about holds; empty if there are none.

    Each begins with a space. `missed` says whether a search that came to its end missed targets:
    of what is merely not certified, or not found in time, curvatures tell nothing.
    """
    told = list[str]()
    for target in targets:
        if isinstance(target, Wrap) and missed:
            told.append(_curvatures(target, shape, limits))
        if isinstance(target, Hold):
            told.append(_grip(target, shape, accuracy))
    return "".join(f" {own}" for own in told if own)


def _curvatures(wrap: Wrap, shape: Shape, limits: Limits) -> str:
    """Return whether the obstacle is too tight or too slack for the arm, and where.

    Of the arm at all where no tensions bend it as the obstacle asks, else of the shape found.
    """
    arm, (start, end) = shape.arm, wrap.part(shape.arm)
    s = np.linspace(max(start, 1e-3 * arm.length), end, _LOOKS)
    points = shape.position(s)
    over = wrap.obstacle.distance(points) - (1 + wrap.tolerance) * arm.outer_radius(s)[0]
    k = int(np.argmax(over))
    if over[k] <= _CLOSE * arm.length:
        return ""
    gap = wrap.obstacle.distance(points[k]) - arm.outer_radius(s[k : k + 1])[0][0]
    asked = curvature_along(wrap, shape, s)
    most = attainable_curvature(arm, shape.scene, limits, s)
    where = f"at {1e3 * s[k]:.4g} mm, where the gap is {1e3 * gap:.3g} mm"
    numbers = f"it asks for {asked[k]:.3g} /m, the limits allow {most[k]:.3g} /m there"
    if (asked > most).any():
        worst = int(np.argmax(asked - most))
        found = f"it asks for {asked[worst]:.3g} /m, the limits allow {most[worst]:.3g} /m"
        return f"The obstacle is too tight for the arm at {1e3 * s[worst]:.4g} mm: {found}."
    bent = _bend_towards(wrap, shape, float(s[k]))
    if bent > asked[k]:
        more = f"the arm bends by {bent:.3g} /m, more than the {asked[k]:.3g} /m of the obstacle"
        return f"In the shape found the obstacle is too slack for the arm {where}: {more}."
    less = f"it bends by {bent:.3g} /m; {numbers}"
    return f"In the shape found the obstacle is too tight for the arm {where}: {less}."


def curvature_along(wrap: Wrap, shape: Shape, s: Array) -> Array:
    """Return the curvature that the midline has where it lies along the obstacle (k,) [1/m].

    That of the surface at the midline's distance from it, along the arm's tangent: t . H t with the
    Hessian H of the distance, at the distance of the arm's radius.
    """
    arm, body = shape.arm, wrap.obstacle
    points, radius = shape.position(s), arm.outer_radius(s)[0]
    normals = body.gradient(points)
    near = points + (radius - body.distance(points))[:, None] * normals
    t = np.array([shape.frame(float(own))[:, 0] for own in s])
    t -= (t * normals).sum(axis=1)[:, None] * normals
    t /= np.maximum(np.linalg.norm(t, axis=1), 1e-12)[:, None]
    ends = [body.gradient(near + sign * _STEP * t) for sign in (1, -1)]
    return np.asarray(((ends[0] - ends[1]) * t).sum(axis=1) / (2 * _STEP))


def _bend_towards(wrap: Wrap, shape: Shape, s: float) -> float:
    """Return the curvature of the midline towards the obstacle at an arc length [1/m]."""
    _, xi, k = shape.strain(s)[:3]
    _, n, b = shape.frame(s).T
    towards = -wrap.obstacle.gradient(shape.position(s))
    return float(np.vdot(towards, k * n - xi * b))


def attainable_curvature(arm: Arm, scene: Scene, limits: Limits, s: Array) -> Array:
    """Return the largest curvature (k,) [1/m] that tendons within limits give a free arm at s.

    All tendons of one side pull as hard as they may, the others as little: of the sides that face
    tendons the best. Of tendons without limit 20 times what bends the arm by 1 rad.
    """
    upper = np.minimum(np.array(limits.upper), _STRONG * natural_tensions(arm))
    lower, phi = np.array(limits.lower), np.array([own for _, own in arm.tendons])
    free = Scene(Extension()) if scene.has(Extension) else Scene()
    found = list[Array]()
    for angle in sorted(set(phi.tolist())):
        pull = np.cos(phi - angle) > 1e-9
        strains = settle(arm, np.where(pull, upper, lower), free, 1e-4).strain(s)
        found.append(np.hypot(strains[:, 1], strains[:, 2]))
    return np.asarray(np.max(found, axis=0))


def _grip(hold: Hold, shape: Shape, accuracy: float) -> str:
    """Return what friction a hold takes, or which wrench is left."""
    left = left_of(shape.arm, shape, hold)
    scaled = left / hold.size(shape.arm)
    if np.linalg.norm(scaled) <= 10 * accuracy:
        needed = needed_friction(shape, hold, accuracy)
        return f"The wrench is held with friction from {needed:.3g} on, {hold.friction:g} given."
    force = ", ".join(f"{own:.3g}" for own in left[:3])
    moment = ", ".join(f"{own:.3g}" for own in left[3:])
    more = f" and a moment ({moment}) N m" if moment else ""
    return f"Of the wrench a force ({force}) N{more} is left; more friction or tension may hold it."
