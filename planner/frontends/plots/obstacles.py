"""Draw obstacles in the three-dimensional panel of a figure, and mark contacts and collisions."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

from octoplan.model.extensions.clearance import Clearance, clearance
from octoplan.model.extensions.clearance.nearest import ITSELF
from octoplan.model.extensions.obstacles import HalfSpace
from octoplan.model.extensions.obstacles.base import Convex, Obstacle, axes_with
from octoplan.model.loads import has_complementarity
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.shape import Shape
from octoplan.planner.frontends.bodies.surface import outline
from octoplan.planner.frontends.plots.style import MM, SIZE

_OBSTACLE = "#b5651d"
_WARNING = "#c0182b"
# Clearance over the arm length below which the nearest point is marked.
_NEAR = 0.02
# Depth of a contact point below which the surfaces touch [m], as in the certificate of a plan.
_DEPTH = 1e-8
# Margin of the drawn part of a plane around the arm, over the size of the arm.
_MARGIN = 0.08
# Distance over the size of the arm beyond which a plane is not drawn.
_FAR = 1.0


def leaned_on(scene: Scene) -> list[Convex]:
    """Return the obstacles that the arm may lean on."""
    if not has_complementarity(scene):
        return []
    from octoplan.model.extensions.contact.effects import contacts

    return [contact.obstacle for contact in contacts(scene)]


def draw_obstacles(obstacles: Sequence[Obstacle], ax: Any, around: Array) -> Array:
    """Draw obstacles in 3-D axes, in mm; return the points (N, 3) [m] that must be visible.

    Planes are drawn around the points `around` (M, 3) [m], faintly and with an outline, so that
    they do not hide the arm.
    """
    seen = [np.empty((0, 3))]
    for obstacle in obstacles:
        if isinstance(obstacle, HalfSpace):
            points = plane_patch(obstacle, around)
            if points.size:
                faces, alpha, width = MM * points[None], 0.10, 0.9
            else:
                continue
        else:
            points, triangles = outline(obstacle)
            faces, alpha, width = MM * points[triangles], 0.28, 0.0
        surface = Poly3DCollection(
            faces,
            facecolors=(*to_rgb(_OBSTACLE), alpha),
            edgecolors=(*to_rgb(_OBSTACLE), 0.7 if width else 0.0),
            lw=width,
            zorder=1,
        )
        ax.add_collection3d(surface)
        seen.append(points)
    return np.vstack(seen)


def plane_patch(plane: HalfSpace, around: Array) -> Array:
    """Return the corners (N, 3) [m], in order, of the part of a plane in the box of points (M, 3).

    The box is extended to the plane; the result is empty if the plane is far away.
    """
    normal = np.array(plane.normal)
    size = float(np.ptp(around, axis=0).max())
    distances = (around - np.array(plane.point)) @ normal
    nearest = int(np.argmin(np.abs(distances)))
    if abs(distances[nearest]) > _FAR * size:
        return np.empty((0, 3))
    foot = around[nearest] - distances[nearest] * normal
    box = np.vstack([around, foot])
    low, high = box.min(axis=0) - _MARGIN * size, box.max(axis=0) + _MARGIN * size
    corners = np.array(list(product(*zip(low, high, strict=True))))
    heights = (corners - foot) @ normal
    # Two corners with neighbouring indices differ in one coordinate.
    edges = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
    cut = np.array(
        [
            corners[i] + heights[i] / (heights[i] - heights[j]) * (corners[j] - corners[i])
            for i, j in edges
            if heights[i] * heights[j] < 0
        ]
    )
    _, a, b = axes_with(normal).T
    across = cut - cut.mean(axis=0)
    return cut[np.argsort(np.arctan2(across @ b, across @ a))]


def mark_nearest(
    shape: Shape, obstacles: Sequence[Obstacle], ax: Any, nearest: Clearance | None = None
) -> None:
    """Mark the point of the arm nearest to an obstacle or to the arm itself; collisions in red.

    `nearest` is the clearance of a certificate; computed by default. Contacts of the
    equilibrium, see Shape.contacts, are marked separately.
    """
    held = leaned_on(shape.scene)
    touching = [touch for touch in shape.contacts if touch.gap >= -_DEPTH]
    if touching:
        points = MM * np.array([touch.point for touch in touching])
        _mark(points, "contact", _OBSTACLE, ax, mfc=_OBSTACLE, ms=SIZE / 2)
    free = [obstacle for obstacle in obstacles if obstacle not in held]
    result = clearance(shape, free) if nearest is None else nearest
    pressed = [touch for touch in shape.contacts if touch.gap < -_DEPTH]
    if pressed:
        deepest = min(pressed, key=lambda touch: touch.gap)
        result = Clearance(deepest.gap, type(deepest.obstacle).__name__, (deepest.s,))
    in_self_contact = has_complementarity(shape.scene) and not held
    if result.what == ITSELF and (shape.self_contacts or in_self_contact):
        return
    through = result.gap < 0
    if not (through or (free and result.gap < _NEAR * shape.arm.length)):
        return
    message = f"passes through {result.what}" if through else f"{1e3 * result.gap:.2g} mm clear"
    points = MM * shape.position(np.array(result.s))
    _mark(points, message, _WARNING if through else _OBSTACLE, ax, mfc="none", ms=SIZE)


def _mark(points: Array, label: str, colour: str, ax: Any, **style: Any) -> None:
    ax.plot(*points.T, "o", ls="", label=label, color=colour, mew=1.8, zorder=9, **style)
