"""Work-precision diagrams: what an error costs, by several ways side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from model.errors import InputError
from model.paths import Array
from planner.plots.style import INK, SIZE, axes_of, labelled

# Of the project's own ways: a colour each; what others offer is grey, and told by its marker.
_OWN = (
    *("#1f6fb4", "#d1495b", "#2a8c6e", "#e8912c", "#7a4fb5"),
    *("#4db6c4", "#9b6b3f", "#c2559d", "#6b8e23", "#17365d"),
)
_MARKS = ("o", "s", "D", "^", "v", "P", "<", ">")
_CHOICE, _STARS = "#111111", ("*", "P")
_LEAST = 1e-13
# Costs within this factor have ticks between the powers of ten.
_FEW = 50.0


@dataclass(frozen=True, eq=False)
class Curve:
    """One way to do a work, at several settings.

    Attributes
    ----------
    name : str
    cost, error : (N, 3)
        Lower quartile, median and upper quartile.
    failed : (F,)
        What it cost where it led to nothing.
    kind : str
        "own", "choice" (what is chosen unless told otherwise) or "other" (another program).
    """

    name: str
    cost: Array
    error: Array
    failed: Array = field(default_factory=lambda: np.zeros(0))
    kind: str = "own"


def plot_work(
    curves: Sequence[Curve],
    cost: str,
    error: str,
    ax: Axes | None = None,
    names: Sequence[str] = (),
) -> Figure | Axes:
    """Draw errors over costs, both logarithmic, with quartiles; failures are crosses at the top.

    `cost` and `error` are the labels of the axes, with units. Curves of `names` look the same in
    all panels that are given the same names; others take the next looks. Returns a new Figure, or
    the axes if given; raises InputError for no curves.
    """
    if not curves:
        raise InputError("curves", (), "at least one Curve")
    shown, ax = axes_of(ax, (6.4, 4.4))
    for curve in curves:
        _draw(curve, _number(curve, curves, names), ax)
    ax.set(xscale="log", yscale="log")
    ax.xaxis.set_minor_formatter(NullFormatter())
    low, high = ax.get_xlim()
    if high < _FEW * low:
        ax.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        ax.xaxis.set_major_formatter("{x:g}")
    labelled(ax, cost, error, grid=True)
    return shown  # type: ignore[no-any-return]


def _number(curve: Curve, curves: Sequence[Curve], names: Sequence[str]) -> int:
    """Return which look a curve has among those of its kind."""
    if curve.name in names:
        return list(names).index(curve.name)
    others = [c.name for c in curves if c.kind == curve.kind and c.name not in names]
    return len(names) + others.index(curve.name)


def _draw(curve: Curve, number: int, ax: Axes) -> None:
    style = {
        "own": (_OWN[number % len(_OWN)], "o" if number < len(_OWN) else "s", "-", 1.2, 2),
        "choice": (_CHOICE, _STARS[number % len(_STARS)], "", 0.8, 4),
        "other": ("#7d838b", _MARKS[number % len(_MARKS)], "--", 1.0, 1),
    }
    colour, mark, line, width, order = style[curve.kind]
    error = np.maximum(curve.error, _LEAST)
    if len(error):
        ax.errorbar(
            curve.cost[:, 1],
            error[:, 1],
            xerr=_arms(curve.cost),
            yerr=_arms(error),
            color=colour,
            marker=mark,
            markersize=9 if curve.kind == "choice" else 4,
            linestyle=line,
            linewidth=width,
            elinewidth=0.6,
            zorder=order,
            label=curve.name,
        )
    if curve.failed.size:
        top = ax.get_xaxis_transform()
        ax.plot(
            curve.failed,
            np.full(curve.failed.size, 0.985),
            "x",
            transform=top,
            color=colour,
            markersize=6,
            label=None if len(error) else f"{curve.name} (failed)",
        )


def _arms(values: Array) -> Array:
    """Return how far the quartiles (2, N) are from the medians."""
    return np.maximum([values[:, 1] - values[:, 0], values[:, 2] - values[:, 1]], 0.0)


def legend_below(figure: Figure, axes: Sequence[Axes], columns: int) -> None:
    """Put one legend for all panels below them."""
    entries: dict[str, Artist] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    figure.legend(
        list(entries.values()),
        list(entries),
        loc="outside lower center",
        ncols=columns,
        fontsize=SIZE - 1,
        frameon=False,
        labelcolor=INK,
    )
