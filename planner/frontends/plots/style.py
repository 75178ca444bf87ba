"""Style of all figures: colours, sizes, axes and labels."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from octoplan.model.paths import Array
from octoplan.model.support.checks import is_several, kind
from octoplan.model.support.errors import InputError

V = TypeVar("V")
# Millimetres per metre.
MM = 1e3
# Font size.
SIZE = 9
# Dots per inch.
DPI = 110
PULL = LinearSegmentedColormap.from_list("pull", ["#f5b83d", "#e8622c", "#b3123f", "#4d0a3a"])
# Steps of ticks.
ROUND_STEPS = [1, 2, 2.5, 5, 10]
SLACK = "#9aa0a6"
INK = "#30343a"
GRID = "#e3e5e8"
_ALLOWED = {"3d": 'axes made with projection="3d"', "rectilinear": "two-dimensional axes"}


def make_axes(
    ax: Any, size: tuple[float, float] = (6.4, 4.0), form: str = "rectilinear"
) -> tuple[Any, Any]:
    """Return the result of a plot function and the axes: the given axes, or a new Figure.

    Raises InputError if the axes are not of the kind `form`, "3d" or "rectilinear".
    """
    if ax is None:
        figure = Figure(figsize=size, dpi=DPI, layout="constrained")
        return figure, figure.add_subplot(projection=form)
    if getattr(ax, "name", "") != form:
        raise InputError("ax", ax, _ALLOWED[form])
    return ax, ax


def several(field: str, values: Any, wanted: type[V]) -> list[V]:
    """Return a sequence of values of a type; raise InputError if empty or of other types."""
    if not is_several(values) or not len(values):
        raise InputError(field, values, f"at least one {wanted.__name__}, in a list")
    return [kind(f"{field}[{i}]", value, wanted) for i, value in enumerate(values)]


def set_labels(ax: Axes, x: str = "", y: str = "", title: str = "", grid: bool = False) -> None:
    """Set labels and title, and remove the upper and right frame; empty labels are omitted."""
    ax.set_xlabel(x, fontsize=SIZE)
    ax.set_ylabel(y, fontsize=SIZE)
    ax.set_title(title, fontsize=SIZE)
    ax.tick_params(labelsize=SIZE - 1)
    ax.spines[["top", "right"]].set_visible(False)
    if grid:
        ax.grid(color=GRID, linewidth=0.6)
        ax.set_axisbelow(True)


def add_legend(ax: Any, **options: Any) -> Any:
    """Add a legend to axes that contain labelled artists, and return it; each label occurs once."""
    handles, labels = ax.get_legend_handles_labels()
    entries = dict(zip(reversed(labels), reversed(handles), strict=True))
    if not entries:
        return None
    style = {"loc": "upper left", "frameon": False, "fontsize": SIZE, "title_fontsize": SIZE}
    names = list(dict.fromkeys(labels))
    return ax.legend([entries[name] for name in names], names, **(style | options))


def pull_norm(tensions: Array) -> Normalize:
    """Return the colour scale for tensions [N]: from 0 to the maximum."""
    return Normalize(0.0, float(tensions.max(initial=0.0)) or 1.0)


def taut_tendons(tensions: Array) -> NDArray[np.bool_]:
    """Return which tendons are taut: above a thousandth of the maximal tension."""
    return np.asarray(tensions > 1e-3 * tensions.max(initial=0.0))
