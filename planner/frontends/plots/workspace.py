"""Figures of workspaces: slices with the boundary and a value as colour, and tips in space."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from scipy.interpolate import RBFInterpolator

from octoplan.model.paths import Array
from octoplan.model.settle import settle
from octoplan.model.support.errors import InputError, OctoplanError
from octoplan.planner.frontends.io.scene_file import question_of
from octoplan.planner.frontends.plots.arm import draw_arm, set_best_view
from octoplan.planner.frontends.plots.style import (
    DPI,
    INK,
    MM,
    PULL,
    SIZE,
    make_axes,
    set_labels,
)
from octoplan.planner.frontends.workspaces.gaps import Classified

# Points of a grid along the longer side of a slice.
_GRID = 200
# The same for the value that is shown as colour.
_FIELD = 80
# Number of tips that the value at a point is interpolated from.
_NEIGHBOURS = 24
# Tips nearer than this distance have one value [m].
_SAME = 1e-6
# Distance from a slice up to which tips are drawn in the slice, over the diagonal of the slice.
_WIDTH = 0.01
# Ratio of the largest to the smallest value above which colours are logarithmic.
_LOGARITHMIC = 30.0
# Share of the values below and above the range of colours.
_CLIPPED = 0.02
_LEVELS = 12
_UNKNOWN = "#eceef1"
_VALUES = {
    "effort": "effort [N]",
    "stiffness_min": "stiffness of the tip, softest direction [N/m]",
    "stiffness_max": "stiffness of the tip, stiffest direction [N/m]",
    "dexterity": "dexterity [-]",
    "manipulability": "manipulability",
}


@dataclass(frozen=True, eq=False)
class _Slice:
    """A plane of a workspace: origin, axes (2, 3) and corners [m], and the name of the axes."""

    name: str
    origin: Array
    axes: Array
    low: Array
    high: Array

    def grid(self, count: int) -> tuple[Array, Array]:
        """Return coordinates (2, m, n) along the axes, and points (m, n, 3) [m]."""
        span = self.high - self.low
        counts = np.maximum((count * span / span.max()).astype(int), 16)
        lines = [np.linspace(*each) for each in zip(self.low, self.high, counts, strict=True)]
        along = np.stack(np.meshgrid(*lines))
        return along, self.origin + np.einsum("kij,kx->ijx", along, self.axes)

    def near(self, tips: Array) -> Array:
        """Return which tips (m, 3) are near the plane (m,)."""
        beside = tips - self.origin
        off = beside - beside @ self.axes.T @ self.axes
        width = _WIDTH * float(np.linalg.norm(self.high - self.low))
        return np.asarray(np.linalg.norm(off, axis=1) <= width)

    def coordinates(self, tips: Array) -> Array:
        """Return the coordinates (m, 2) of tips (m, 3) along the axes [m]."""
        return np.asarray((tips - self.origin) @ self.axes.T)


def plot_workspace(data: Any, value: str = "effort", ax: Any = None) -> Figure | Axes:
    """Draw a workspace: slices with the boundary, and the tips in space.

    Parameters
    ----------
    data : xarray.Dataset
        From `octoplan.workspace`.
    value : str
        The variable that is shown as colour: "effort", "stiffness_min", "stiffness_max",
        "dexterity" or "manipulability".
    ax : Axes
        With 3-D axes, draw the tips in space only; with 2-D axes, the first slice only.

    Returns a new Figure, or the given axes. Raises InputError for other data, values and axes.
    """
    if getattr(data, "attrs", {}).get("title") != "octoplan workspace":
        raise InputError("data", type(data).__name__, "a Dataset, as workspace returns it")
    if value not in _VALUES:
        raise InputError("value", value, f"one of {', '.join(_VALUES)}")
    drawing = _Drawing(data, value)
    if ax is not None:
        if getattr(ax, "name", "") == "3d":
            drawing.space(ax)
        else:
            make_axes(ax)
            drawing.slice(ax, drawing.slices[0])
        return ax  # type: ignore[no-any-return]
    if data.attrs["planar"]:
        figure = Figure(figsize=(6.4, 4.8), dpi=DPI, layout="constrained")
        axes = [figure.add_subplot()]
        drawing.slice(axes[0], drawing.slices[0])
    else:
        figure = Figure(figsize=(10.0, 8.0), dpi=DPI, layout="constrained")
        space = figure.add_subplot(2, 2, 1, projection="3d")
        drawing.space(space)
        axes = [figure.add_subplot(2, 2, 2 + i) for i in range(len(drawing.slices))]
        for panel, each in zip(axes, drawing.slices, strict=True):
            drawing.slice(panel, each)
        axes = [space, *axes]
    bar = figure.colorbar(drawing.colours, ax=axes, shrink=0.6, aspect=30, extend="both")
    bar.set_label(drawing.label, fontsize=SIZE)
    bar.ax.tick_params(labelsize=SIZE - 1)
    bar.outline.set_visible(False)
    return figure


class _Drawing:
    """The numbers of a workspace that are drawn, with the scale of the colours."""

    def __init__(self, data: Any, value: str) -> None:
        settled = data.settled.values
        boundary = data.kind.values == "boundary"
        self.tips = data.tip.values[settled]
        self.values = data[value].values[settled]
        self.classified = Classified(
            self.tips, data.target.values[boundary], data.empty_radius.values[boundary]
        )
        names = data.coords["slice"].values.tolist()
        parts = (data[f"slice_{name}"].values for name in ("origin", "axes", "low", "high"))
        self.slices = [_Slice(*each) for each in zip(names, *parts, strict=True)]
        self._computed = dict[str, Array]()
        self.scene = data.attrs["scene"]
        self.least = np.asarray(data.attrs["tension_min_N"], float)
        units = data[value].attrs["units"]
        self.label = _VALUES[value] if "[" in _VALUES[value] else f"{_VALUES[value]} [{units}]"
        if value == "effort" and data.attrs["least_effort"]:
            self.label = "least effort [N]"
        finite = self.values[np.isfinite(self.values)]
        low, high = np.quantile(finite, (_CLIPPED, 1 - _CLIPPED)) if finite.size else (0.0, 1.0)
        self.is_logarithmic = value != "effort" and low > 0 and high / low > _LOGARITHMIC
        low = 0.0 if value in ("effort", "dexterity") else low
        high = high if high > low else low + 1.0
        self.range = float(low), float(high)
        scale = LogNorm if self.is_logarithmic else Normalize
        self.colours = ScalarMappable(scale(low, high), PULL)

    def slice(self, ax: Axes, plane: _Slice) -> None:
        """Draw the boundary in a plane, the value as colour, and the tips near the plane."""
        along, _ = plane.grid(_GRID)
        outside = self._outside(plane)
        x, y = MM * along
        coarse, places = plane.grid(_FIELD)
        field = self._field(places)
        norm = self.colours.norm
        if field is not None:
            low, high = self.range
            space = np.geomspace if self.is_logarithmic else np.linspace
            levels = space(low, high, _LEVELS + 1)
            ax.contourf(*MM * coarse, field, levels, norm=norm, cmap=PULL, extend="both")
        else:
            ax.contourf(x, y, outside, [-np.inf, 0], colors=[_UNKNOWN])
        ax.contourf(x, y, outside, [0, np.inf], colors=["white"])
        ax.contour(x, y, outside, [0], colors=[INK], linewidths=1.4)
        near = plane.near(self.tips)
        ax.plot(*(MM * plane.coordinates(self.tips[near])).T, ".", color=INK, ms=2.2, alpha=0.6)
        ax.set_aspect("equal")
        set_labels(ax, f"{plane.name[0]} [mm]", f"{plane.name[1]} [mm]", self._title(plane))

    def _title(self, plane: _Slice) -> str:
        normal = np.cross(*plane.axes)
        place = float(plane.origin @ normal)
        axis = int(np.argmax(np.abs(normal)))
        if len(self.slices) == 1:
            return "the plane of the arm"
        if abs(normal[axis]) < 1 - 1e-9:
            return f"slice {plane.name}"
        return f"slice at {'xyz'[axis]} = {MM * place * normal[axis] + 0.0:.0f} mm"

    def _outside(self, plane: _Slice) -> Array:
        """Return a function of the grid of a slice that is positive outside, and at the edge."""
        if plane.name in self._computed:
            return self._computed[plane.name]
        _, points = plane.grid(_GRID)
        distance = self.classified.signed_distance(points)
        edge = np.ones(distance.shape, bool)
        edge[1:-1, 1:-1] = False
        self._computed[plane.name] = np.where(edge, np.maximum(distance, 1e-6), distance)
        return self._computed[plane.name]

    def _field(self, points: Array) -> Array | None:
        """Return the value at points (m, n, 3), interpolated between all tips; None if too few."""
        good = np.isfinite(self.values)
        values = np.log(self.values[good]) if self.is_logarithmic else self.values[good]
        tips, first = np.unique((self.tips[good] / _SAME).round(), axis=0, return_index=True)
        rank = np.linalg.matrix_rank(tips - tips.mean(axis=0), tol=1.0)
        if len(tips) < _NEIGHBOURS or rank < 2:
            return None
        # In a plane the interpolation has two coordinates.
        _, _, axes = np.linalg.svd(tips - tips.mean(axis=0), full_matrices=False)
        axes = axes[:rank]
        interpolated = RBFInterpolator(
            tips @ axes.T, values[first], neighbors=_NEIGHBOURS, kernel="linear"
        )
        field = interpolated((points.reshape(-1, 3) / _SAME) @ axes.T).reshape(points.shape[:-1])
        return np.asarray(np.exp(field) if self.is_logarithmic else field)

    def space(self, ax: Any) -> None:
        """Draw the arm at rest, the tips with the value as colour, and the boundary in slices."""
        tips = MM * self.tips
        shown = {"c": self.values, "norm": self.colours.norm, "cmap": PULL}
        ax.scatter(*tips.T, **shown, s=8, linewidths=0, alpha=0.9, depthshade=False)
        drawn = [self.tips]
        for plane in self.slices:
            along, _ = plane.grid(_GRID)
            lines = Figure().add_subplot().contour(*along, self._outside(plane), [0])
            for line in lines.allsegs[0]:
                drawn.append(plane.origin + line @ plane.axes)
                ax.plot(*(MM * drawn[-1]).T, color=INK, lw=1.2)
        question = question_of(json.loads(self.scene), "workspace")
        with suppress(OctoplanError):
            shape = settle(question.arm, self.least, question.scene, 1e-2)
            drawn.append(draw_arm(shape, ax))
            set_best_view(ax, shape, np.vstack(drawn))
        for name in "xyz":
            getattr(ax, f"set_{name}label")(f"{name} [mm]", fontsize=SIZE)
        ax.tick_params(labelsize=SIZE - 2)
        ax.set_title("tips, boundary in the slices, and the arm at rest", fontsize=SIZE)
