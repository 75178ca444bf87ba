"""What each effect does to a scene and what it costs, side by side."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from planner.effect_ablation import Switch
from planner.plots.style import INK, SIZE, labelled

_MATTERS, _IDLE, _COST = "#b3123f", "#9aa0a6", "#1f6fb4"
_FLOOR = 1e-12


def plot_effects(switches: tuple[Switch, ...], accuracy: float) -> Figure:
    """Draw tip change over L against the accuracy, and the factor in time, effect by effect.

    Effects of the scene come first, with a filled dot; others, which it lacks, are hollow. An
    effect with or without which the arm does not settle has no dot.
    """
    figure = Figure(figsize=(7.2, 1.3 + 0.32 * len(switches)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    rows = np.arange(len(switches))[::-1]
    left.set_yticks(rows, [switch.effect for switch in switches], fontsize=SIZE - 1)
    left.axvline(accuracy, color=INK, linewidth=0.8, linestyle="--", zorder=0)
    left.annotate(
        "accuracy",
        (accuracy, 1.0),
        (2, 2),
        xycoords=("data", "axes fraction"),
        textcoords="offset points",
        fontsize=SIZE - 2,
        color=INK,
    )
    for row, switch in zip(rows, switches, strict=True):
        colour = _MATTERS if switch.matters else _IDLE
        change = max(switch.tip_change, _FLOOR)
        _dot(left, change, row, colour, switch.enabled)
        _dot(right, switch.time_factor, row, _COST, switch.enabled)
    for face, label in ((INK, "in the scene"), ("white", "switched on")):
        left.plot([], [], "o", color=INK, markerfacecolor=face, markersize=5, label=label)
    left.legend(loc="lower left", fontsize=SIZE - 2, frameon=False)
    right.axvline(1.0, color=INK, linewidth=0.8, linestyle="--", zorder=0)
    for ax, label in ((left, "tip moves by [L]"), (right, "time of a settle, with over without")):
        ax.set_xscale("log")
        labelled(ax, label, grid=True)
    return figure


def _dot(ax: Axes, x: float, y: float, colour: str, filled: bool) -> None:
    face = colour if filled else "white"
    ax.plot([x], [y], "o", color=colour, markerfacecolor=face, markersize=6)
