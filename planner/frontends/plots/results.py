"""Figures of calibrations, the ablation of effects, accuracy studies and checks of arms."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from octoplan.model.paths import Array
from octoplan.model.support.checks import kind
from octoplan.planner.frontends.accuracy_study import AccuracyStudy
from octoplan.planner.frontends.arm_check import ArmCheck
from octoplan.planner.frontends.effect_ablation import Switch
from octoplan.planner.frontends.plots.arm import set_limits
from octoplan.planner.frontends.plots.style import INK, MM, SIZE, make_axes, set_labels

# Maximal number of shapes in a figure, evenly spread over the measurements.
_SHAPES = 12
_SKIN = "#b3123f"
_LINE = "#7a0c2b"
_MATTERS = "#b3123f"
_IDLE = "#9aa0a6"
_COST = "#1f6fb4"
# Smallest disagreement that is drawn: rounding.
_LEAST_GAP = 1e-17
# Distance in decades below which two points of a curve share a label: time, error.
_NEAR_TIME = 0.2
_NEAR_ERROR = 0.35


def plot_calibration(result: Any, ax: Axes | None = None) -> Figure | Axes:
    """Draw measured markers over settled arms, residuals in order, and standard errors as bars.

    With `ax`, draw the residuals only. Returns a new Figure, or the given axes.
    """
    if ax is not None:
        return plot_residuals(result, ax)
    figure = Figure(figsize=(10.0, 6.4), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.2, 1.0))
    _arms(result, figure.add_subplot(grid[:, 0], projection="3d"))
    plot_residuals(result, figure.add_subplot(grid[0, 1]))
    _errors(result, figure.add_subplot(grid[1, 1]))
    return figure


def _arms(result: Any, ax: Any) -> None:
    """Draw settled midlines, and lines from measured to predicted markers.

    Coordinates that were not measured are those of the prediction.
    """
    here = result.evaluation
    seen: list[Array] = []
    present = list(here.equilibria)
    which = present[:: max(1, -(-len(present) // _SHAPES))]
    for k, i in enumerate(which):
        equilibrium = here.equilibria[i]
        shape = result.measured[i]
        predicted = here.predicted_places(i)
        places = np.where(np.isnan(shape.places), predicted, shape.places)
        midline = equilibrium.system.poses(equilibrium.states)[:, 4:]
        ax.plot(*(MM * midline).T, color=f"C{k % 10}", lw=1.2)
        for line in MM * np.stack([places, predicted], axis=1):
            ax.plot(*line.T, color=f"C{k % 10}", lw=0.8)
        ax.plot(*(MM * places).T, "o", ms=3, color=f"C{k % 10}")
        seen += [midline, places]
    set_limits(ax, np.vstack(seen), fresh=True)
    ax.set_title("measured markers over settled arms", fontsize=SIZE)


def plot_residuals(result: Any, ax: Axes | None = None) -> Figure | Axes:
    """Draw the distance of each measured marker of a Calibration from the prediction [mm].

    Markers are in the order of measurement. Returns a new Figure, or the given axes.
    """
    shown, ax = make_axes(ax)
    names = [shape.name for shape in result.measured]
    rows = [row for row in result.residuals if row.is_place]
    for what in dict.fromkeys(row.what for row in rows):
        parts = [row for row in rows if row.what == what]
        sizes = [MM * row.size for row in parts]
        ax.plot([names.index(row.shape) for row in parts], sizes, "o-", ms=4, lw=0.8, label=what)
    ax.set_xticks(range(len(names)), names, rotation=90, fontsize=SIZE)
    set_labels(
        ax, y="residual [mm]", title=f"mean residual {MM * result.mean_error:.3g} mm" * bool(rows)
    )
    if rows:
        ax.set_ylim(bottom=0)
        ax.legend(fontsize=SIZE, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return shown  # type: ignore[no-any-return]


def _errors(result: Any, ax: Axes) -> None:
    """Draw values relative to bounds, with standard errors as bars if finite."""
    parameters = result.parameters
    std = np.where(np.isfinite(result.std), result.std, np.nan) / parameters.range
    at = np.arange(len(result.values))
    ax.errorbar(parameters.fractions(result.array), at, xerr=std, fmt="o", ms=4, capsize=3)
    labels = [
        f"{unknown.name}\n{value:.4g} +- {error:.2g} {parameters.unit(unknown)}".rstrip()
        for unknown, value, error in zip(result.unknowns, result.values, result.std, strict=True)
    ]
    ax.set_yticks(at, labels, fontsize=SIZE)
    ax.invert_yaxis()
    ax.margins(y=0.2)
    ax.set_xlim(-0.05, 1.05)
    ax.set_xticks([0, 1], ["lower bound", "upper bound"], fontsize=SIZE)
    ax.set_title("standard errors", fontsize=SIZE)


def plot_effects(switches: tuple[Switch, ...], length: float, tolerance: float) -> Figure:
    """Draw tip movements against the tolerance, and run time factors, for each effect.

    `length` is the arm's [m]. Effects of the scene come first, with filled dots; other effects have
    hollow dots. A dot is missing if the arm does not settle with or without the effect.
    """
    figure = Figure(figsize=(7.6, 1.5 + 0.32 * len(switches)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    rows = np.arange(len(switches))[::-1]
    left.set_yticks(rows, [switch.effect for switch in switches], fontsize=SIZE - 1)
    limit = MM * length * tolerance
    left.axvline(limit, color=INK, linewidth=0.8, linestyle="--", zorder=0)
    left.annotate(
        f"tolerance: {100 * tolerance:g} % of L",
        (limit, 1.0),
        (2, 2),
        xycoords=("data", "axes fraction"),
        textcoords="offset points",
        fontsize=SIZE - 2,
        color=INK,
    )
    for row, switch in zip(rows, switches, strict=True):
        colour = _MATTERS if switch.matters else _IDLE
        # On a logarithmic scale, draw a movement of 0 at the left.
        moved = MM * length * max(switch.tip_change, 1e-12)
        for ax, x, shade in ((left, moved, colour), (right, switch.time_factor, _COST)):
            face = shade if switch.enabled else "white"
            ax.plot([x], [row], "o", color=shade, markerfacecolor=face, markersize=6)
    for face, label in ((INK, "in the scene"), ("white", "switched on")):
        left.plot([], [], "o", color=INK, markerfacecolor=face, markersize=5, label=label)
    left.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.22),
        ncol=2,
        fontsize=SIZE - 2,
        frameon=False,
    )
    right.axvline(1.0, color=INK, linewidth=0.8, linestyle="--", zorder=0)
    labels = ((left, "tip moves by [mm]"), (right, "time of settle, with over without"))
    for ax, label in labels:
        ax.set_xscale("log")
        set_labels(ax, label, grid=True)
    # Time factors often span less than a decade: label 1, 2 and 5 in plain numbers.
    low, high = right.get_xlim()
    right.set_xlim(min(low, 0.5), max(high, 2.0))
    right.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    right.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    right.xaxis.set_minor_formatter(NullFormatter())
    return figure


def plot_accuracy(study: AccuracyStudy, ax: Axes | None = None) -> Figure | Axes:
    """Draw verified errors over processor times of settling and planning.

    Labels are requested accuracies, rings the recommended one. Returns a new Figure, or the given
    axes.
    """
    kind("study", study, AccuracyStudy)
    shown, ax = make_axes(ax, (7.2, 4.4))
    curves = (("settle", study.settling, _COST), ("plan, with certificate", study.planning, _SKIN))
    for name, curve, colour in curves:
        done = [point for point in curve if not point.problem]
        if not done:
            continue
        times = [MM * point.seconds for point in done]
        errors = [max(point.error, study.reference) for point in done]
        ax.plot(times, errors, "o-", color=colour, ms=5, lw=1.2, label=name)
        for point, x, y in zip(done, times, errors, strict=True):
            if point.accuracy == study.recommended:
                ax.plot([x], [y], "o", ms=12, mfc="none", mec=colour, mew=1.6)
        for text, x, y in _labels([point.accuracy for point in done], times, errors):
            ax.annotate(
                text, (x, y), (10, 3), textcoords="offset points", fontsize=SIZE - 2, color=colour
            )
    ax.axhline(study.reference, color=INK, lw=0.8, ls="--", zorder=0)
    ax.annotate(
        "smaller errors are not resolved",
        (0.0, study.reference),
        (2, 3),
        xycoords=("axes fraction", "data"),
        textcoords="offset points",
        fontsize=SIZE - 2,
        color=INK,
    )
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.margins(x=0.14)
    set_labels(ax, "processor time [ms]", "verified error [L, rad]", grid=True)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize=SIZE, frameon=False, loc="best")
    if study.recommended is not None:
        ax.set_title(
            f"labels: requested accuracy; ring: recommended, {study.recommended:.0e}",
            fontsize=SIZE,
        )
    return shown  # type: ignore[no-any-return]


def _labels(
    accuracies: list[float], times: list[float], errors: list[float]
) -> list[tuple[str, float, float]]:
    """Return labels (text, time, error) of accuracies; points that nearly coincide share one."""
    groups: list[list[int]] = []
    for i in range(len(accuracies)):
        last = groups[-1][0] if groups else i
        decades = abs(np.log10(times[i] / times[last])), abs(np.log10(errors[i] / errors[last]))
        if groups and decades[0] < _NEAR_TIME and decades[1] < _NEAR_ERROR:
            groups[-1].append(i)
        else:
            groups.append([i])
    labels = []
    for group in groups:
        ends = dict.fromkeys(f"{accuracies[i]:.0e}".replace("e-0", "e-") for i in group)
        names = list(ends)
        text = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
        right = max(group, key=lambda i: times[i])
        labels.append((text, times[right], errors[right]))
    return labels


def plot_check(result: ArmCheck, ax: Axes | None = None) -> Figure | Axes:
    """Draw the disagreements of an ArmCheck, one row per comparison, with the allowed maxima.

    Returns a new Figure, or the given axes.
    """
    kind("result", result, ArmCheck)
    shown, ax = make_axes(ax, (7.2, 1.4 + 0.36 * len(result.comparisons)))
    rows = range(len(result.comparisons))
    for row, each in zip(rows, result.comparisons, strict=True):
        gaps = np.maximum(each.disagreements, _LEAST_GAP)
        ax.plot(gaps, row + np.linspace(-0.2, 0.2, gaps.size), "o", color=_COST, ms=4, alpha=0.6)
        colour = _MATTERS if each.is_error else INK
        ax.plot([each.allowed] * 2, [row - 0.35, row + 0.35], color=colour, lw=2)
    ax.plot([], [], "o", color=_COST, ms=4, label="a tension set")
    ax.plot([], [], color=_MATTERS, lw=2, label="allowed")
    if not all(each.is_error for each in result.comparisons):
        ax.plot([], [], color=INK, lw=2, label="another equilibrium")
    names = [f"{each.name} ({len(each.refusals)} refused)" for each in result.comparisons]
    ax.set_yticks(rows, names)
    ax.invert_yaxis()
    ax.set_xscale("log")
    set_labels(ax, "distance of the tips [L]", grid=True)
    ax.set_title(
        f"{int(result.settled.sum())} of {result.settled.size} tension sets settle", fontsize=SIZE
    )
    ax.legend(fontsize=SIZE - 1, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return shown  # type: ignore[no-any-return]
