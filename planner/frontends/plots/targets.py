"""Draw targets in the three-dimensional panel of a figure."""

from __future__ import annotations

from functools import singledispatch
from itertools import pairwise
from typing import Any

import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.planner.frontends.plots.style import MM, SIZE
from octoplan.planner.targets.backbone import Backbone
from octoplan.planner.targets.base import toward
from octoplan.planner.targets.bending_plane import BendingPlane
from octoplan.planner.targets.fetch import Fetch, FetchReach, stretches
from octoplan.planner.targets.tip import TipPointing, TipPose, TipPosition

GOAL = "#00806a"


@singledispatch
def draw_target(target: Any, ax: Any, shape: Shape) -> Array:
    """Draw a target in 3-D axes; return the points (N, 3) [m] that must be visible.

    Other types of targets are not drawn.
    """
    return np.empty((0, 3))


@draw_target.register
def _(target: TipPosition, ax: Any, shape: Shape) -> Array:
    return _tip_mark(ax, shape, target.position, "x", "target of the tip")


@draw_target.register
def _(target: TipPointing, ax: Any, shape: Shape) -> Array:
    points = _tip_mark(ax, shape, target.position, "x", "target of the tip")
    end = points[0] + 0.15 * shape.arm.length * np.array(target.direction)
    ax.quiver(
        *(MM * points[0]),
        *(MM * (end - points[0])),
        color=GOAL,
        lw=1.6,
        arrow_length_ratio=0.2,
        label="target direction",
        zorder=7,
    )
    return np.vstack([points, end])


@draw_target.register
def _(target: TipPose, ax: Any, shape: Shape) -> Array:
    points = _tip_mark(ax, shape, target.position, "x", "target of the tip")
    ends = points + 0.12 * shape.arm.length * np.array(target.frame).T
    for name, end in zip("tnb", ends, strict=True):
        ax.plot(*(MM * np.vstack([points[0], end])).T, color=GOAL, lw=1.4, zorder=7)
        place = MM * (1.25 * end - 0.25 * points[0])
        ax.text(*place, name, color=GOAL, fontsize=SIZE, ha="center", va="center", zorder=8)
    return np.vstack([points, ends])


@draw_target.register
def _(target: Backbone, ax: Any, shape: Shape) -> Array:
    return _mark(ax, np.array(target.points), "o", "target points")


@draw_target.register
def _(target: BendingPlane, ax: Any, shape: Shape) -> Array:
    return _plane(ax, shape, target.angle, "bending plane")


@draw_target.register
def _(target: Fetch, ax: Any, shape: Shape) -> Array:
    """Draw the target tangent at the end of each stretch, relative to the frame at the start."""
    shown = []
    bends = (target.proximal, target.medial, target.distal)
    for (start, end), (angle, plane) in zip(pairwise(stretches(shape.arm)), bends, strict=True):
        sin = np.sin(angle)
        local = [np.cos(angle), -sin * np.sin(plane), sin * np.cos(plane)]
        foot = shape.position(end)
        tip = foot + 0.1 * shape.arm.length * (shape.frame(start) @ np.array(local))
        shown.append(tip)
        label = "target tangents" if start == 0 else None
        ax.plot(*(MM * np.vstack([foot, tip])).T, color=GOAL, lw=1.6, label=label, zorder=7)
    return np.array(shown)


@draw_target.register
def _(target: FetchReach, ax: Any, shape: Shape) -> Array:
    mouth = _tip_mark(ax, shape, target.mouth, "*", "mouth")
    if target.plane is None:
        return mouth
    return np.vstack([mouth, _plane(ax, shape, target.plane, "plane")])


def _tip_mark(ax: Any, shape: Shape, at: tuple[float, ...], marker: str, label: str) -> Array:
    """Mark the target of the tip, and draw a line from the tip."""
    ax.plot(*(MM * np.array([shape.tip, at])).T, color=GOAL, lw=1.0, ls=":", zorder=6)
    return _mark(ax, np.array([at]), marker, label)


def _mark(ax: Any, points: Array, marker: str, label: str) -> Array:
    style = {"x": (9, 2.2), "o": (6, 1.3), "*": (13, 1.0)}[marker]
    ax.plot(
        *(MM * points).T,
        ls="",
        marker=marker,
        ms=style[0],
        mew=style[1],
        color=GOAL,
        mfc="none" if marker == "o" else GOAL,
        mec="white" if marker == "*" else GOAL,
        label=label,
        zorder=7,
    )
    return points


def _plane(ax: Any, shape: Shape, angle: float, label: str) -> Array:
    """Draw the part of a plane through the base that contains the arm, and the direction."""
    arm = shape.arm
    origin = np.array(arm.base_position)
    t = np.array(arm.base_frame)[:, 0]
    e = toward(arm, angle)
    path = shape.position(np.linspace(0.0, arm.length, 201)) - origin
    margin = 0.08 * arm.length
    a = (min(0.0, float((path @ t).min())), float((path @ t).max()) + margin)
    b = (min(0.0, float((path @ e).min())), float((path @ e).max()) + margin)
    corners = [
        origin + u * t + v * e for u, v in ((a[0], b[0]), (a[1], b[0]), (a[1], b[1]), (a[0], b[1]))
    ]
    ax.add_collection3d(
        Poly3DCollection(
            [MM * np.array(corners)],
            facecolors=(0, 0.5, 0.42, 0.07),
            edgecolors=GOAL,
            lw=0.8,
            ls="--",
            zorder=1.5,
        )
    )
    arrow = [origin, origin + b[1] * e]
    ax.quiver(
        *(MM * origin),
        *(MM * b[1] * e),
        color=GOAL,
        lw=1.6,
        arrow_length_ratio=0.07,
        label=label,
        zorder=6,
    )
    return np.array([*corners, *arrow])
