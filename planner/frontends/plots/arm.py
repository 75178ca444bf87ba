"""The three-dimensional panel of a figure: the body, tendons, targets and obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from matplotlib.colors import LightSource, Normalize
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import (  # type: ignore[import-untyped]
    Line3DCollection,
    Poly3DCollection,
)
from mpl_toolkits.mplot3d.proj3d import proj_transform  # type: ignore[import-untyped]

from octoplan.model.arm import Arm
from octoplan.model.extensions.clearance import Clearance, clearance
from octoplan.model.extensions.clearance.nearest import ITSELF
from octoplan.model.extensions.obstacles import HalfSpace
from octoplan.model.extensions.obstacles.base import Convex, Obstacle
from octoplan.model.loads import has_complementarity
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.shape import Shape
from octoplan.planner.frontends.bodies.surface import (
    along,
    outline,
    outlines,
    rings,
    tendon_lines,
)
from octoplan.planner.frontends.plots.style import (
    INK,
    MM,
    PULL,
    ROUND_STEPS,
    SIZE,
    SLACK,
    pull_norm,
    taut_tendons,
)
from octoplan.planner.frontends.plots.targets import draw_target

_BODY = "#dde8f3"
_LIGHT = LightSource(azdeg=218, altdeg=55)
# Rings along the body, and points around each.
_ALONG = 161
_AROUND = 32
# Smallest side of the box of the axes relative to the largest.
_FLAT = 0.3
# Half width and half height of a panel, in units of projected axes.
_ROOM = 0.084, 0.080
_OBSTACLE = "#b5651d"
_WARNING = "#c0182b"
# Clearance over the arm length below which the nearest point is marked.
_NEAR = 0.02
# Depth of a contact point below which the surfaces touch [m], as in the certificate of a plan.
_DEPTH = 1e-8


def draw_arm(
    shape: Shape,
    ax: Any,
    targets: tuple[Any, ...] = (),
    obstacles: tuple[Obstacle, ...] = (),
    nearest: Clearance | None = None,
) -> Array:
    """Draw the arm, targets and obstacles in 3-D axes, in mm; return points (N, 3) [m].

    The point nearest to an obstacle, or in collision, is marked; `nearest` is the clearance of a
    certificate.

    The last collection that is added contains the taut tendons, with tensions [N] as colours.
    """
    ax.computed_zorder = False
    fresh = not ax.has_data()
    s = along(shape.arm, _ALONG)
    poses = shape.poses(s)
    obstacles = (*obstacles, *_leaned_on(shape.scene))
    things = draw_obstacles(obstacles, ax)
    skin = _body(shape.arm, ax, s, poses)
    goals = [draw_target(target, ax, shape) for target in targets]
    mark_nearest(shape, obstacles, ax, nearest)
    _tendons(shape, ax, tendon_lines(shape.arm, s, poses))
    set_limits(ax, np.vstack([skin, things, *goals]), fresh)
    return np.vstack([poses[:, 4:], *goals])


def _leaned_on(scene: Scene) -> list[Convex]:
    """Return the obstacles that the arm may lean on."""
    if not has_complementarity(scene):
        return []
    from octoplan.model.extensions.contact.effects import contacts

    return [contact.obstacle for contact in contacts(scene)]


def draw_obstacles(obstacles: Sequence[Obstacle], ax: Any) -> Array:
    """Draw obstacles in 3-D axes, in mm; return the points (N, 3) [m] that must be visible."""
    seen = [np.empty((0, 3))]
    for obstacle in obstacles:
        points, triangles = outline(obstacle)
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
    """Mark the point of the arm nearest to an obstacle or to the arm itself; collisions in red.

    `nearest` is the clearance of a certificate; computed by default. Contacts of the
    equilibrium, see Shape.contacts, are marked separately.
    """
    held = _leaned_on(shape.scene)
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


def set_best_view(ax: Any, shape: Shape, points: Array) -> None:
    """Set the best view of points (N, 3) [m] in 3-D axes, and fill the panel."""
    set_limits(ax, points, fresh=False)
    fill_panel(ax, *best_view(points, shape.frame(0.0)[:, 0]))


def fill_panel(ax: Any, elevation: float, azimuth: float) -> None:
    """Set a view [deg] of 3-D axes, and zoom so that the box fills the panel."""
    ax.view_init(elevation, azimuth)
    sides = (ax.get_xlim(), ax.get_ylim(), ax.get_zlim())
    corners = np.array(list(product(*sides)))
    x, y, _ = proj_transform(*corners.T, ax.get_proj())
    zoom = min(_ROOM[0] / np.abs(x).max(), _ROOM[1] / np.abs(y).max())
    ax.set_box_aspect(np.ptp(sides, axis=1), zoom=zoom)


def best_view(points: Array, t: Array) -> tuple[float, float]:
    """Return the elevation and azimuth [deg] from which points (N, 3) overlap least.

    Views along an axis are excluded. The usual azimuth and views of the front of the base, the side
    of t, are preferred.
    """
    p = points[:: max(1, len(points) // 80)]
    size = float(np.ptp(p, axis=0).max()) or 1.0
    azimuths = [side + off for side in (-90, 0, 90, 180) for off in (25.0, 35.0, 45.0, 55.0, 65.0)]

    def crowding(view: tuple[float, float]) -> float:
        el, az = np.radians(view)
        side = np.array([-np.sin(az), np.cos(az), 0.0])
        front = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
        gaps = np.hypot(*(np.subtract.outer(p @ v, p @ v) for v in (side, np.cross(front, side))))
        unusual = 1 - np.cos(az - np.radians(-60.0))
        behind = max(0.0, -float(front @ t))
        return float(np.mean(1 / (gaps / size + 0.03)) * (1 + 0.02 * unusual + 0.1 * behind))

    elevation, azimuth = min(product((20.0, 28.0, 36.0), azimuths), key=crowding)
    return elevation, float(azimuth)


def _body(arm: Arm, ax: Any, s: Array, poses: Array) -> Array:
    """Draw the surface and discs at base and anchorages; return visible points (N, 3) [m]."""
    points = outlines(arm, s, _AROUND)
    skin = rings(poses, points)
    closed = MM * np.concatenate([skin, skin[:, :1]], axis=1)
    style = {"alpha": 0.55, "lw": 0, "rasterized": True, "zorder": 2}
    # Soft light from above.
    xyz = np.moveaxis(closed, 2, 0)
    ax.plot_surface(*xyz, rstride=1, cstride=1, color=_BODY, lightsource=_LIGHT, **style)
    at = np.searchsorted(s, [0.0, *(section.at for section in arm.sections)])
    discs = rings(poses[at], np.where(at == 0, 1.5, 1.0)[:, None, None] * points[at])
    for zorder, some, alpha in ((1, discs[:1], 0.55), (3, discs[1:], 0.2)):
        faces = Poly3DCollection(
            MM * some, facecolors=(0.2, 0.24, 0.28, alpha), edgecolors=INK, lw=0.9, zorder=zorder
        )
        ax.add_collection3d(faces)
    return np.vstack([skin.reshape(-1, 3), discs[0]])


def _tendons(shape: Shape, ax: Any, lines: list[Array]) -> None:
    """Draw the tendons (N_j, 3) [m]; taut ones in the colour of the tension."""
    pulled = taut_tendons(shape.tensions)
    slack = [MM * line for line, on in zip(lines, pulled, strict=True) if not on]
    if slack:
        ax.add_collection3d(Line3DCollection(slack, colors=SLACK, lw=0.6, zorder=4))
    if pulled.any():
        tight = Line3DCollection(
            [MM * line for line, on in zip(lines, pulled, strict=True) if on],
            cmap=PULL,
            norm=pull_norm(shape.tensions),
            lw=2.0,
            zorder=5,
        )
        tight.set_array(shape.tensions[pulled])
        ax.add_collection3d(tight)
        # Use a common colour scale for all arms in the axes.
        drawn = [each for each in ax.collections if each.get_cmap().name == PULL.name]
        shared = Normalize(0.0, max(each.norm.vmax for each in drawn))
        for each in drawn:
            each.set_norm(shared)


def set_limits(ax: Any, points: Array, fresh: bool) -> None:
    """Set equal scales that contain points (N, 3) [m] and, unless `fresh`, earlier contents."""
    ax.auto_scale_xyz(*(MM * points).T, had_data=not fresh)
    held = [ax.xy_dataLim.intervalx, ax.xy_dataLim.intervaly, ax.zz_dataLim.intervalx]
    low, high = np.array(held).T
    size = np.maximum(high - low, _FLAT * (high - low).max()) * 1.06
    middle = (low + high) / 2
    for name, c, width in zip("xyz", middle, size, strict=True):
        getattr(ax, f"set_{name}lim")(c - width / 2, c + width / 2)
        axis = getattr(ax, f"{name}axis")
        # A short side has at least two ticks.
        most = max(6 * width / size.max(), 3.5)
        axis.set_major_locator(MaxNLocator(most, steps=ROUND_STEPS))
        axis.set_pane_color((0.97, 0.975, 0.98, 1.0))
        # Matplotlib offsets labels in proportion to the other two sides.
        others = (size.sum() - width) / 2 / np.linalg.norm(size)
        getattr(ax, f"set_{name}label")(f"{name} [mm]", fontsize=SIZE, labelpad=14.4 / others - 21)
        ax.tick_params(axis=name, labelsize=SIZE - 1, pad=5.6 / others - 8)
    ax.zaxis.set_rotate_label(False)
    ax.zaxis.label.set_rotation(90)
    ax.set_box_aspect(size)
