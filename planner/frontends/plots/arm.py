"""The three-dimensional panel of a figure: body, tendons, loads, targets and obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.colors import LightSource, Normalize
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox
from mpl_toolkits.mplot3d.art3d import (  # type: ignore[import-untyped]
    Line3DCollection,
    Poly3DCollection,
)
from mpl_toolkits.mplot3d.proj3d import proj_transform  # type: ignore[import-untyped]

from octoplan.model.arm import Arm
from octoplan.model.extensions.clearance import Clearance
from octoplan.model.extensions.obstacles import HalfSpace
from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.planner.frontends.bodies.surface import (
    along,
    outlines,
    rings,
    tendon_lines,
)
from octoplan.planner.frontends.plots.loads import draw_loads
from octoplan.planner.frontends.plots.obstacles import draw_obstacles, leaned_on, mark_nearest
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
# Number of corrections of the zoom, so that labels lie in the panel.
_ROUNDS = 3
# Distance of labels from a vertical axis for each character after the third [pt].
_PAD_PER_DIGIT = 3.0
# Smallest gap between the labels of two axes [px].
_APART = 10.0
# Weight of a plane that is seen from behind in the choice of a view.
_BEHIND = 2.0


def draw_arm(
    shape: Shape,
    ax: Any,
    targets: tuple[Any, ...] = (),
    obstacles: tuple[Obstacle, ...] = (),
    nearest: Clearance | None = None,
    around: Array | None = None,
    home: Arm | None = None,
) -> Array:
    """Draw the arm, loads, targets and obstacles in 3-D axes, in mm; return points (N, 3) [m].

    Planes of targets refer to the base of `home`, by default to that of the shape.

    The point nearest to an obstacle, or in collision, is marked; `nearest` is the clearance of a
    certificate. Planes are drawn around the points `around` (M, 3) [m]; the default is the arm.

    The last collection that is added contains the taut tendons, with tensions [N] as colours.
    """
    ax.computed_zorder = False
    fresh = not ax.has_data()
    s = along(shape.arm, _ALONG)
    poses = shape.poses(s)
    obstacles = (*obstacles, *leaned_on(shape.scene))
    skin = _body(shape.arm, ax, s, poses)
    from_home = shape if home is None else replace(shape, arm=home)
    goals = [draw_loads(shape, ax), *(draw_target(target, ax, from_home) for target in targets)]
    seen = np.vstack([skin, *goals])
    things = draw_obstacles(obstacles, ax, seen if around is None else around)
    mark_nearest(shape, obstacles, ax, nearest)
    _tendons(shape, ax, tendon_lines(shape.arm, s, poses))
    set_limits(ax, np.vstack([seen, things]), fresh)
    return np.vstack([poses[:, 4:], *goals])


def set_best_view(ax: Any, shape: Shape, points: Array, obstacles: Sequence[Obstacle] = ()) -> None:
    """Set the best view of points (N, 3) [m] in 3-D axes, and fill the panel."""
    set_limits(ax, points, fresh=False)
    view = best_view(points, shape, obstacles)
    share = 1.0
    fill_panel(ax, *view)
    for _ in range(_ROUNDS):
        excess = _excess_of_labels(ax)
        if excess <= 1:
            break
        share /= excess
        fill_panel(ax, *view, share=share)
    _separate_labels(ax)


def _separate_labels(ax: Any) -> None:
    """Remove ticks with labels that nearly touch others, along the longest axis last."""
    renderer = _renderer(ax)
    occupied: list[Bbox] = []
    for axis in _axes(ax):
        low, high = axis.get_view_interval()
        ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
        boxes = {tick.get_loc(): tick.label1.get_window_extent(renderer) for tick in ticks}
        wide = {at: box.padded(_APART) for at, box in boxes.items()}
        free = [at for at, box in wide.items() if not box.count_overlaps(occupied)]
        occupied += [boxes[at] for at in free]
        if len(free) < len(boxes):
            axis.set_ticks(free)


def _axes(ax: Any) -> tuple[Any, Any, Any]:
    """Return the three axes; the longest one comes first."""
    axes = (ax.xaxis, ax.yaxis, ax.zaxis)
    return tuple(sorted(axes, key=lambda axis: -np.ptp(axis.get_view_interval())))


def _renderer(ax: Any) -> RendererAgg:
    """Draw the figure, because Matplotlib places labels then, and return a renderer."""
    figure = ax.figure
    figure.draw_without_rendering()
    return RendererAgg(figure.bbox.width, figure.bbox.height, figure.dpi)  # type: ignore[no-untyped-call]


def fill_panel(ax: Any, elevation: float, azimuth: float, share: float = 1.0) -> None:
    """Set a view [deg] of 3-D axes, and zoom so that the box fills the panel, or a share of it."""
    ax.view_init(elevation, azimuth)
    sides = (ax.get_xlim(), ax.get_ylim(), ax.get_zlim())
    corners = np.array(list(product(*sides)))
    ax.set_box_aspect(np.ptp(sides, axis=1))
    x, y, _ = proj_transform(*corners.T, ax.get_proj())
    zoom = share * min(_ROOM[0] / np.abs(x).max(), _ROOM[1] / np.abs(y).max())
    ax.set_box_aspect(np.ptp(sides, axis=1), zoom=zoom)


def _excess_of_labels(ax: Any) -> float:
    """Return the size of the box with ticks and labels over the size of its panel."""
    renderer = _renderer(ax)
    panel = ax.get_position(original=True).transformed(ax.figure.transFigure)
    labels = Bbox.union([axis.get_tightbbox(renderer) for axis in (ax.xaxis, ax.yaxis, ax.zaxis)])
    center = (panel.min + panel.max) / 2
    reach = np.maximum(labels.max - center, center - labels.min)
    return float((reach / (panel.size / 2)).max())


def best_view(
    points: Array, shape: Shape, obstacles: Sequence[Obstacle] = ()
) -> tuple[float, float]:
    """Return the elevation and azimuth [deg] from which points (N, 3) overlap least.

    Views along an axis are excluded. The usual azimuth, views of the front of the base, and views
    from the free side of planes are preferred.
    """
    p = points[:: max(1, len(points) // 80)]
    t = shape.frame(0.0)[:, 0]
    planes = [each for each in (*obstacles, *leaned_on(shape.scene)) if isinstance(each, HalfSpace)]
    normals = np.array([plane.normal for plane in planes]).reshape(-1, 3)
    size = float(np.ptp(p, axis=0).max()) or 1.0
    azimuths = [side + off for side in (-90, 0, 90, 180) for off in (25.0, 35.0, 45.0, 55.0, 65.0)]
    elevations = [20.0, 28.0, 36.0]
    if (normals[:, 2] < -0.5).any():
        elevations += [-20.0, -28.0]

    def crowding(view: tuple[float, float]) -> float:
        el, az = np.radians(view)
        side = np.array([-np.sin(az), np.cos(az), 0.0])
        front = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
        gaps = np.hypot(*(np.subtract.outer(p @ v, p @ v) for v in (side, np.cross(front, side))))
        unusual = 1 - np.cos(az - np.radians(-60.0))
        behind = max(0.0, -float(front @ t))
        hidden = float(np.maximum(0.0, -normals @ front).sum())
        weight = 1 + 0.02 * unusual + 0.1 * behind + _BEHIND * hidden
        return float(np.mean(1 / (gaps / size + 0.03)) * weight)

    elevation, azimuth = min(product(elevations, azimuths), key=crowding)
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
        pad = 5.6 / others - 8
        if name == "z":
            # Labels are centred on their place beside the axis.
            digits = max(len(f"{place:.0f}") for place in (c - width / 2, c + width / 2))
            pad += _PAD_PER_DIGIT * max(digits - 3, 0)
        ax.tick_params(axis=name, labelsize=SIZE - 1, pad=pad)
    ax.zaxis.set_rotate_label(False)
    ax.zaxis.label.set_rotation(90)
    ax.set_box_aspect(size)
