"""Obstacles in the three-dimensional panel of a figure, and where the arm is nearest to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

from model.clearance import clearance
from model.obstacles import HalfSpace, Obstacle
from model.paths import Array
from model.shape import Shape
from planner.plots.strains import MM, SIZE

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


def mark_nearest(shape: Shape, obstacles: Sequence[Obstacle], ax: Any) -> None:
    """Mark where the arm is nearest to what it can meet, in red where it passes through."""
    found = clearance(shape, obstacles)
    through = found.gap < 0
    if not (through or (obstacles and found.gap < _NEAR * shape.arm.length)):
        return
    points = MM * shape.position(np.array(found.s))
    told = f"passes through {found.what}" if through else f"{1e3 * found.gap:.2g} mm clear"
    colour = _WARNING if through else _OBSTACLE
    style = {"color": colour, "ms": SIZE, "mew": 1.8, "zorder": 9}
    ax.plot(*points.T, "o", mfc="none", ls="", label=told, **style)
