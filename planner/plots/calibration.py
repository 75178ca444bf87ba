"""A calibration drawn: markers over settled arms, residuals, and standard errors."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from planner.plots.style import MM, SIZE, axes_of, labelled

# Shapes that are drawn at most, evenly spread over the measurements.
_SHAPES = 12


def plot_calibration(found: Any, ax: Axes | None = None) -> Figure | Axes:
    """Draw measured markers over settled arms, residuals in order, and standard errors as bars.

    Only residuals in `ax`, if it is given. Returns a new Figure, or the axes.
    """
    if ax is not None:
        return plot_residuals(found, ax)
    figure = Figure(figsize=(10.0, 6.4), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.2, 1.0))
    _arms(found, figure.add_subplot(grid[:, 0], projection="3d"))
    plot_residuals(found, figure.add_subplot(grid[0, 1]))
    _errors(found, figure.add_subplot(grid[1, 1]))
    return figure


def _arms(found: Any, ax: Any) -> None:
    """Draw settled midlines, predicted markers as lines to the measured ones."""
    here = found.evaluation
    present = list(here.equilibria)
    which = present[:: max(1, -(-len(present) // _SHAPES))]
    for k, i in enumerate(which):
        equilibrium, shape = here.equilibria[i], found.measured[i]
        places, miss = shape.places, here.residuals[i]
        midline = MM * equilibrium.system.poses(equilibrium.states)[:, 4:]
        ax.plot(*midline.T, color=f"C{k % 10}", lw=1.2)
        predicted = MM * (places + miss[: places.size].reshape(-1, 3))
        for one, other in zip(MM * places, predicted, strict=True):
            ax.plot(*np.array([one, other]).T, color=f"C{k % 10}", lw=0.8)
        ax.plot(*(MM * places).T, "o", ms=3, color=f"C{k % 10}")
    ax.set_aspect("equal")
    ax.locator_params(nbins=4)
    for axis in "xyz":
        getattr(ax, f"set_{axis}label")(f"{axis} [mm]", fontsize=SIZE)
    ax.set_title("measured markers over settled arms", fontsize=SIZE)
    ax.tick_params(labelsize=SIZE)


def plot_residuals(found: Any, ax: Axes | None = None) -> Figure | Axes:
    """Draw the distance of each marker of each shape of a Calibration from its prediction [mm].

    In the order of measurement. Returns a new Figure, or the axes if given.
    """
    shown, ax = axes_of(ax)
    names = [shape.name for shape in found.measured]
    rows = [row for row in found.residuals if row.is_place]
    for what in dict.fromkeys(row.what for row in rows):
        own = [row for row in rows if row.what == what]
        sizes = [MM * row.size for row in own]
        ax.plot([names.index(row.shape) for row in own], sizes, "o-", ms=4, lw=0.8, label=what)
    ax.set_xticks(range(len(names)), names, rotation=90, fontsize=SIZE)
    labelled(
        ax, y="off by [mm]", title=f"{MM * found.mean_error:.3g} mm off in the mean" * bool(rows)
    )
    if rows:
        ax.set_ylim(bottom=0)
        ax.legend(fontsize=SIZE, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return shown  # type: ignore[no-any-return]


def _errors(found: Any, ax: Axes) -> None:
    """Draw values between their bounds, with standard errors as bars; none where inf."""
    of = found.parameters
    std = np.where(np.isfinite(found.std), found.std, np.nan) / of.range
    at = np.arange(len(found.values))
    ax.errorbar(of.shares(found.array), at, xerr=std, fmt="o", ms=4, capsize=3)
    labels = [
        f"{own.name}\n{value:.4g} +- {error:.2g} {of.unit(own)}".rstrip()
        for own, value, error in zip(found.unknowns, found.values, found.std, strict=True)
    ]
    ax.set_yticks(at, labels, fontsize=SIZE)
    ax.invert_yaxis()
    ax.margins(y=0.2)
    ax.set_xlim(-0.05, 1.05)
    ax.set_xticks([0, 1], ["lower bound", "upper bound"], fontsize=SIZE)
    ax.set_title("standard errors", fontsize=SIZE)
