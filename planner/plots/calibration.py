"""How far measured markers are from where a calibrated arm has them."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from planner.plots.strains import MM, SIZE


def plot_residuals(found: Any, ax: Axes | None = None) -> Figure | Axes:
    """Draw the distance of each marker of each shape of a Calibration from its prediction [mm].

    Returns a new Figure, or the axes if given.
    """
    if ax is None:
        figure = Figure(figsize=(6.4, 4.0), layout="constrained")
        plot_residuals(found, figure.add_subplot())
        return figure
    names = [shape.name for shape in found.measured]
    rows = [own for own in found.residuals if own.is_place]
    for what in dict.fromkeys(own.what for own in rows):
        own = [row for row in rows if row.what == what]
        sizes = [MM * row.size for row in own]
        ax.plot([names.index(row.shape) for row in own], sizes, "o-", ms=4, lw=0.8, label=what)
    ax.set_xticks(range(len(names)), names, rotation=90, fontsize=SIZE)
    ax.set_ylabel("off by [mm]", fontsize=SIZE)
    ax.set_ylim(bottom=0)
    ax.set_title(f"{MM * found.mean_error:.3g} mm off in the mean", fontsize=SIZE)
    ax.legend(fontsize=SIZE)
    return ax
