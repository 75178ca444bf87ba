"""Obstacles in the three-dimensional panel of a figure, and where the arm is nearest to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

from model.clearance import Clearance, clearance
from model.clearance.nearest import ITSELF
from model.effects import SelfContact
from model.loads import contacts
from model.obstacles import HalfSpace, Obstacle
from model.paths import Array
from model.shape import Shape
from planner.certificate import COMPLEMENTARY
from planner.plots.style import MM, SIZE

_OBSTACLE, _WARNING = "#b5651d", "#c0182b"
# A place nearer than this share of the arm's length is marked.
_NEAR = 0.02


def draw_obstacles(obstacles: Sequence[Obstacle], ax: Any) -> Array:
    """Draw obstacles in 3-D axes, in mm; return points (N, 3) [m] that have to be in sight."""
    seen = [np.empty((0, 3))]
    for obstacle in obstacles:
        points, triangles = obstacle.outline
        faces = MM * points[triangles]
        ax.add_collection3d(
            Poly3DCollection(faces, facecolors=_OBSTACLE, alpha=0.28, lw=0, zorder=1)
        )
        if not isinstance(obstacle, HalfSpace):
            seen.append(points)
    return np.vstack(seen)


def mark_nearest(
    shape: Shape, obstacles: Sequence[Obstacle], ax: Any, nearest: Clearance | None = None
) -> None:
    """Mark where the arm is nearest to what it can meet, in red where it passes through.

    `nearest` is what a certificate says of it; otherwise it is looked for. What the arm leans on
    is met by contact, see Shape.contacts: there it touches.
    """
    held = [contact.obstacle for contact in contacts(shape.scene)]
    touching = [touch for touch in shape.contacts if touch.gap >= -COMPLEMENTARY]
    if touching:
        points = MM * np.array([touch.point for touch in touching])
        _mark(points, "leans on it", _OBSTACLE, ax, mfc=_OBSTACLE, ms=SIZE / 2)
    free = [obstacle for obstacle in obstacles if obstacle not in held]
    found = clearance(shape, free) if nearest is None else nearest
    pressed = [touch for touch in shape.contacts if touch.gap < -COMPLEMENTARY]
    if pressed:
        deepest = min(pressed, key=lambda touch: touch.gap)
        found = Clearance(deepest.gap, type(deepest.obstacle).__name__, (deepest.s,))
    if found.what == ITSELF and (shape.on_itself or shape.scene.has(SelfContact)):
        return
    through = found.gap < 0
    if not (through or (free and found.gap < _NEAR * shape.arm.length)):
        return
    told = f"passes through {found.what}" if through else f"{1e3 * found.gap:.2g} mm clear"
    points = MM * shape.position(np.array(found.s))
    _mark(points, told, _WARNING if through else _OBSTACLE, ax, mfc="none", ms=SIZE)


def _mark(points: Array, told: str, colour: str, ax: Any, **style: Any) -> None:
    ax.plot(*points.T, "o", ls="", label=told, color=colour, mew=1.8, zorder=9, **style)
