"""Draw the loads of a scene in the three-dimensional panel of a figure."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np

from octoplan.model.effects import (
    Buoyancy,
    Current,
    LineLoad,
    PointLoad,
    PointMass,
    TipLoad,
    Weight,
)
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.obstacles.base import axes_with
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.planner.frontends.plots.style import INK, MM

_LOAD = "#6a3d9a"
_FLOW = "#1f6fb4"
# Lengths of arrows over the arm length: the largest force, the smallest one, and all others.
_LARGEST = 0.2
_LEAST = 0.07
_ARROW = 0.13
# Radius of the arc that shows a moment, and distance between arrow and arm, over the arm length.
_ARC = 0.04
_APART = 0.08
# Number of arrows of a line load, and places of the arrows of a current over the arm length.
_COMB = 7
_STREAM = (0.3, 0.53, 0.76, 1.0)


def draw_loads(shape: Shape, ax: Any) -> Array:
    """Draw the loads of a shape's scene in 3-D axes, in mm; return the points (N, 3) [m].

    Arrows of forces at points are to scale, except small ones. Loads of 0, and effects without a
    drawing, are omitted.
    """
    sizes = [float(np.linalg.norm(_point_force(each, shape))) for each in shape.scene.effects]
    longest = _LARGEST * shape.arm.length / (max(sizes, default=0.0) or 1.0)
    parts = [draw_load(each, ax, shape, longest) for each in shape.scene.effects]
    return np.vstack([np.empty((0, 3)), *parts])


@singledispatch
def draw_load(effect: Effect, ax: Any, shape: Shape, scale: float) -> Array:
    """Draw an effect; return the points (N, 3) [m] that must be visible.

    `scale` is the length of arrows per force [m/N]. Other effects are not drawn; a package with its
    own effect registers a function here.
    """
    return np.empty((0, 3))


@draw_load.register
def _(effect: Weight, ax: Any, shape: Shape, scale: float) -> Array:
    """Draw an arrow along gravity beside the base, on the side away from the arm."""
    arm = shape.arm
    g = np.array(effect.g)
    size = float(np.linalg.norm(g))
    if not size:
        return np.empty((0, 3))
    base = np.array(arm.base_position)
    side = np.cross(g / size, np.array(arm.base_frame)[:, 0])
    if np.linalg.norm(side) < 1e-3:
        side = np.array(arm.base_frame)[:, 1]
    side /= np.linalg.norm(side)
    bent = shape.position(np.linspace(0.0, arm.length, 9)).mean(axis=0) - base
    foot = base - np.copysign(_APART * arm.length + _radius(shape, 0.0), side @ bent) * side
    fluid = shape.scene.find(Buoyancy)
    medium = f", in a fluid of {fluid.density:g} kg/m³" if fluid else ""
    end = foot + _ARROW * arm.length * g / size
    return _arrows(ax, foot[None], end[None], INK, f"gravity {size:.3g} m/s²{medium}")


@draw_load.register
def _(effect: TipLoad, ax: Any, shape: Shape, scale: float) -> Array:
    force = _point_force(effect, shape)
    moment = np.array(effect.moment)
    if effect.follower:
        moment = shape.tip_frame @ moment
    name = "follower load" if effect.follower else "tip load"
    return _force_and_moment(ax, shape, shape.tip, force, moment, scale, name, "")


@draw_load.register
def _(effect: PointLoad, ax: Any, shape: Shape, scale: float) -> Array:
    foot = shape.position(effect.s)
    moment = np.array(effect.moment or (0.0, 0.0, 0.0))
    place = f" at s = {MM * effect.s:.4g} mm"
    force = _point_force(effect, shape)
    return _force_and_moment(ax, shape, foot, force, moment, scale, "point load", place)


@draw_load.register
def _(effect: PointMass, ax: Any, shape: Shape, scale: float) -> Array:
    if not effect.mass:
        return np.empty((0, 3))
    offset = np.array(effect.offset or (0.0, 0.0, 0.0))
    foot: Array = shape.position(effect.s) + shape.frame(effect.s) @ offset
    label = f"mass of {1e3 * effect.mass:.3g} g at s = {MM * effect.s:.4g} mm"
    ax.plot(*(MM * foot[:, None]), "o", color=_LOAD, ms=7, label=label, zorder=8)
    weight = _point_force(effect, shape)
    if not weight.any():
        return foot[None]
    return _arrows(ax, foot[None], foot[None] + _scaled(weight, scale, shape), _LOAD, None)


@draw_load.register
def _(effect: LineLoad, ax: Any, shape: Shape, scale: float) -> Array:
    """Draw a comb of arrows on the loaded part, and arcs about a moment."""
    arm = shape.arm
    end = arm.length if effect.end is None else effect.end
    s = np.linspace(effect.begin, end, _COMB)
    feet = shape.position(s)
    frames = np.broadcast_to(np.eye(3), (_COMB, 3, 3))
    if effect.follower:
        frames = shape.frame(s)
    name = "follower load" if effect.follower else "line load"
    seen = [feet]
    size = float(np.linalg.norm(effect.force))
    if size:
        heads = feet + _ARROW / 2 * arm.length * frames @ np.array(effect.force) / size
        seen.append(_arrows(ax, feet, heads, _LOAD, f"{name} {_quantity(size, 'N/m')}"))
        ax.plot(*(MM * heads.T), color=_LOAD, lw=0.8, zorder=8)
    size = float(np.linalg.norm(effect.moment))
    for k in (1, 3, 5) if size else ():
        label = f"{name} {_quantity(size, 'N m/m')}" if k == 1 else None
        seen.append(_arc(ax, shape, feet[k], frames[k] @ np.array(effect.moment), label))
    return np.vstack(seen)


@draw_load.register
def _(effect: Current, ax: Any, shape: Shape, scale: float) -> Array:
    """Draw arrows along the stream that end before the arm."""
    size = float(np.linalg.norm(effect.velocity))
    if not size:
        return np.empty((0, 3))
    length = shape.arm.length
    along = np.array(effect.velocity) / size
    feet = shape.position(length * np.array(_STREAM))
    heads: Array = feet - (_APART / 3 * length + _radius(shape, 0.0)) * along
    tails = heads - _ARROW * length * along
    return _arrows(ax, tails, heads, _FLOW, f"current {size:.3g} m/s")


def _point_force(effect: Effect, shape: Shape) -> Array:
    """Return the force of a load at a point in the base frame (3,) [N]; 0 for other effects."""
    if isinstance(effect, TipLoad):
        force = np.array(effect.force)
        return np.asarray(shape.tip_frame @ force if effect.follower else force)
    if isinstance(effect, PointLoad):
        return np.array(effect.force)
    weight = shape.scene.find(Weight)
    if isinstance(effect, PointMass) and weight:
        return effect.mass * np.array(weight.g)
    return np.zeros(3)


def _force_and_moment(
    ax: Any,
    shape: Shape,
    foot: Array,
    force: Array,
    moment: Array,
    scale: float,
    name: str,
    place: str,
) -> Array:
    seen = [np.empty((0, 3))]
    size = float(np.linalg.norm(force))
    if size:
        label = f"{name} {_quantity(size, 'N')}{place}"
        end = foot + _scaled(force, scale, shape)
        seen.append(_arrows(ax, foot[None], end[None], _LOAD, label))
    size = float(np.linalg.norm(moment))
    if size:
        seen.append(_arc(ax, shape, foot, moment, f"{name} {_quantity(size, 'N m')}{place}"))
    return np.vstack(seen)


def _scaled(force: Array, scale: float, shape: Shape) -> Array:
    """Return the vector of an arrow [m] for a force (3,) [N], not too short to be seen."""
    size = float(np.linalg.norm(force))
    return force / size * max(scale * size, _LEAST * shape.arm.length)


def _arrows(ax: Any, tails: Array, heads: Array, colour: str, label: str | None) -> Array:
    """Draw arrows from tails (N, 3) to heads (N, 3) [m]; return the points of both."""
    ax.quiver(
        *(MM * tails.T),
        *(MM * (heads - tails).T),
        color=colour,
        lw=1.5,
        arrow_length_ratio=0.28,
        label=label,
        zorder=8,
    )
    return np.vstack([tails, heads])


def _arc(ax: Any, shape: Shape, foot: Array, moment: Array, label: str | None) -> Array:
    """Draw three quarters of a turn about a moment (3,), with an arrow head."""
    size = float(np.linalg.norm(moment))
    _, a, b = axes_with(moment / size).T
    angles = np.linspace(0.0, 1.5 * np.pi, 37)[:, None]
    radius = _ARC * shape.arm.length + _radius(shape, 0.0)
    points = foot + radius * (np.cos(angles) * a + np.sin(angles) * b)
    ax.plot(*(MM * points.T), color=_LOAD, lw=1.5, label=label, zorder=8)
    head = points[-1] - points[-4]
    ax.quiver(
        *(MM * points[-4]), *(MM * head), color=_LOAD, lw=1.5, arrow_length_ratio=1.5, zorder=8
    )
    return np.asarray(points)


def _radius(shape: Shape, s: float) -> float:
    """Return the radius of the body at s [m]."""
    return float(shape.arm.radius.evaluate(np.array([s]), shape.arm.length)[0][0])


def _quantity(value: float, unit: str) -> str:
    """Return a quantity with its unit, in thousandths below 1."""
    return f"{value:.3g} {unit}" if value >= 1 else f"{1e3 * value:.3g} m{unit}"
