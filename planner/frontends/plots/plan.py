"""Figures of plans and shapes: the arm in 3-D, strains along the arm, and tensions."""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from octoplan.model.arm import Arm
from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.support.checks import kind
from octoplan.planner.frontends.io.files import atomic_write, path_of
from octoplan.planner.frontends.plots.arm import draw_arm, set_best_view
from octoplan.planner.frontends.plots.style import (
    DPI,
    INK,
    MM,
    PULL,
    ROUND_STEPS,
    SIZE,
    add_legend,
    make_axes,
    pull_norm,
    set_labels,
)
from octoplan.planner.plan_result import Plan

_CURVATURES = (("τ", "#8a8f98"), ("ξ", "#1f6fb4"), ("k", "#d1495b"))
_STRETCH = "#2a8c6e"
# Maxima of tensions are drawn up to this multiple of the largest tension.
_COMPARABLE = 3.0
# Number of tendons from which their names below bars are rotated.
_MOST_UPRIGHT = 8
# Number of entries from which the legend of a 3-D panel has two columns.
_COLUMN = 4


def plot_plan(plan: Plan, ax: Any = None) -> Figure | Axes:
    """Draw a plan: the arm with the target in 3-D, strains along the arm, and tensions.

    With 3-D axes, draw arm and target only; `figure.colorbar(ax.collections[-1])` adds the scale of
    tensions. Returns a new Figure, or the given axes.
    """
    kind("plan", plan, Plan)
    if ax is not None:
        draw_plan(plan, make_axes(ax, form="3d")[1])
        return ax  # type: ignore[no-any-return]
    figure = Figure(figsize=(10, 5.8), dpi=DPI)
    shape = plan.shape
    ax = figure.add_axes((0.0, 0.14, 0.56, 0.80), projection="3d")
    finish(ax, shape, draw_plan(plan, ax), plan.problem.environment.obstacles)
    plot_strains(shape, figure.add_axes((0.618, 0.515, 0.30, 0.36)))
    bars = figure.add_axes((0.618, 0.09, 0.30, 0.27))
    plot_tensions(shape.arm, shape.tensions, np.array(plan.problem.limits.upper), bars)
    title = f"{plan.outcome.split(':')[0]}; effort {plan.effort:.3g} N"
    figure.suptitle(title, fontsize=SIZE + 2, y=0.975)
    return figure


def plot_together(plans: Sequence[Plan]) -> Figure:
    """Draw the arms of several plans with targets in one 3-D figure."""
    figure, ax = alone()
    points = [draw_plan(plan, ax) for plan in plans]
    finish(ax, plans[0].shape, np.vstack(points), plans[0].problem.environment.obstacles)
    return figure


def plot_shape(shape: Shape, ax: Any = None) -> Figure | Axes:
    """Draw the arm in 3-D; return a new Figure, or the given 3-D axes."""
    kind("shape", shape, Shape)
    if ax is not None:
        draw_arm(shape, make_axes(ax, form="3d")[1])
        return ax  # type: ignore[no-any-return]
    figure, ax = alone()
    finish(ax, shape, draw_arm(shape, ax))
    return figure


def draw_plan(plan: Plan, ax: Any) -> Array:
    """Draw the arm of a plan, targets and obstacles; return points (N, 3) [m]."""
    result = plan.certificate.clearances.values()
    nearest = min(result, key=lambda clear: clear.gap, default=None)
    obstacles = plan.problem.environment.obstacles
    return draw_arm(plan.shape, ax, plan.targets, obstacles, nearest, home=plan.arm)


def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure as .png or .pdf, atomically."""
    path = path_of(path)
    with atomic_write(path, ".png", ".pdf") as part:
        part.write_bytes(render(figure, path.suffix[1:].lower()))
    return path


def render(figure: Figure, kind: str) -> bytes:
    """Return a figure as the contents of a "png" or "pdf" file."""
    file = io.BytesIO()
    figure.savefig(file, format=kind, dpi=DPI if kind == "png" else 2 * DPI)
    return file.getvalue()


def alone() -> tuple[Figure, Any]:
    """Return a figure with one 3-D panel, and place for a title and a colour scale."""
    figure = Figure(figsize=(7, 6.2), dpi=DPI)
    return figure, figure.add_axes((0.02, 0.15, 0.94, 0.83), projection="3d")


def finish(
    ax: Any, shape: Shape, points: Array, obstacles: Sequence[Obstacle] = (), title: str = ""
) -> None:
    """Set the best view of points (N, 3) [m]; add the legend with a title, and the colour scale.

    The legend is above the drawing.
    """
    figure = ax.figure
    if shape.tensions.any():
        add_scale(ax, ax.collections[-1])
    panel = ax.get_position(original=True)
    count = len(set(ax.get_legend_handles_labels()[1]))
    place: dict[str, Any] = {"ncol": 1 + (count > _COLUMN), "columnspacing": 1.0}
    place |= {"bbox_to_anchor": (panel.x0 + 0.02, panel.y1), "bbox_transform": figure.transFigure}
    legend = add_legend(ax, title=title or None, alignment="left", borderaxespad=0.0, **place)
    if legend is not None:
        figure.draw_without_rendering()
        low = legend.get_window_extent().transformed(figure.transFigure.inverted()).y0
        ax.set_position((panel.x0, panel.y0, panel.width, low - panel.y0))
    set_best_view(ax, shape, points, obstacles)


def add_scale(ax: Any, pulled: Any) -> None:
    """Add the colour scale of tensions below a panel."""
    x, y, width, _ = ax.get_position(original=True).bounds
    place = ax.figure.add_axes((x + 0.3 * width, y - 0.04, 0.4 * width, 0.018))
    bar = ax.figure.colorbar(pulled, cax=place, orientation="horizontal")
    bar.set_label("tension [N]", fontsize=SIZE)
    bar.ax.tick_params(labelsize=SIZE - 1)
    bar.outline.set_visible(False)


def plot_strains(shape: Shape, ax: Axes | None = None) -> Figure | Axes:
    """Draw curvatures [1/m] and longitudinal strain [-] along the arm, as in figure 12.

    Zero torsion is omitted. A jump at an anchorage is a gap. Both scales have their zero
    at the same height. Returns a new Figure, or the given axes.
    """
    kind("shape", shape, Shape)
    shown, ax = make_axes(ax)
    s, strain = broken_strains(shape)
    right: Any = ax.twinx()
    for column, (name, colour) in enumerate(_CURVATURES):
        values = strain[:, column]
        if column or np.nanmax(np.abs(values)) > 1e-6 / shape.arm.length:
            ax.plot(MM * s, values, color=colour, lw=1.6, label=f"{name} [1/m]")
    right.plot(MM * s, strain[:, 3], color=_STRETCH, lw=1.6, ls=(0, (5, 1.5)), label="q [-]")
    for section in shape.arm.sections:
        ax.axvline(MM * section.at, color=INK, lw=0.7, ls=":", zorder=0.5)
    ax.axhline(0, color=INK, lw=0.6, zorder=0.5)
    _common_zero(ax, right, strain)
    _label_strains(ax, right, MM * shape.arm.length)
    return shown  # type: ignore[no-any-return]


def broken_strains(shape: Shape) -> tuple[Array, Array]:
    """Return arc lengths (N,) [m] and strains (N, 4), with a NaN row at each anchorage.

    Shape.strain returns the value on the base side; the tip side is evaluated at 1e-9 L beyond.
    """
    L = shape.arm.length
    ends = sorted({0.0, L, *(section.at for section in shape.arm.sections)})
    rows = []
    for start, end in pairwise(ends):
        if end - start > 1e-6 * L:
            inside = np.linspace(start, end, max(20, round(300 * (end - start) / L)))
            inside[0] += 1e-9 * L if start > 0 else 0.0
            rows.append(np.column_stack([inside, shape.strain(inside)]))
            rows.append(np.array([[end, *[np.nan] * 4]]))
    table = np.concatenate(rows[:-1])
    return table[:, 0], table[:, 1:]


def _common_zero(left: Axes, right: Axes, strain: Array) -> None:
    """Set both vertical ranges so that zeros are at the same height, with a margin."""
    ranges = []
    for values in (strain[:, :3], strain[:, 3]):
        low = min(np.nanmin(values), 0.0)
        high = max(np.nanmax(values), 0.0)
        size = high - low
        ranges.append((low / size, high / size, size) if size > 1e-12 else (0.0, 0.0, 1.0))
    low = min(r[0] for r in ranges) - 0.06
    high = max(r[1] for r in ranges) + 0.06
    for ax, (_, _, size) in zip((left, right), ranges, strict=True):
        ax.set_ylim(low * size, high * size)
        ax.yaxis.set_major_locator(MaxNLocator(6, steps=ROUND_STEPS))


def _label_strains(ax: Axes, right: Axes, length: float) -> None:
    ax.set_xlim(0, length * 1.01)
    set_labels(ax, "s [mm]", "curvature [1/m]")
    set_labels(right, y="longitudinal strain q [-]")
    right.yaxis.label.set_color(_STRETCH)
    right.tick_params(colors=_STRETCH)
    lines = [line for line in ax.get_lines() if not str(line.get_label()).startswith("_")]
    lines += [*right.get_lines(), Line2D([], [], color=INK, lw=0.7, ls=":", label="anchorage")]
    ax.legend(
        handles=lines,
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncol=len(lines),
        frameon=False,
        fontsize=SIZE,
        handlelength=1.2,
        handletextpad=0.4,
        columnspacing=0.8,
    )


def plot_tensions(arm: Arm, tensions: Array, upper: Array, ax: Axes) -> None:
    """Draw tensions (n,) [N] as bars by tendon name, with maxima of similar size.

    For up to 16 tendons, bars have numbers, rotated if the bars are narrow.
    """
    n = arm.n_tendons
    most = float(tensions.max())
    bars = ax.bar(range(n), tensions, width=0.7, color=PULL(pull_norm(tensions)(tensions)))
    near = np.isfinite(upper) & (upper <= _COMPARABLE * most if most > 0 else True)
    if near.any():
        at = np.flatnonzero(near)
        ax.hlines(upper[at], at - 0.42, at + 0.42, color=INK, lw=1.2, label="maximum")
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=SIZE)
    top = max(most, float(upper[near].max(initial=0.0))) or 1.0
    narrow = n > 8
    many = n > 16
    if not many:
        texts = [f"{each:.3g}" if each > 0.02 * top else "" for each in tensions]
        ax.bar_label(bars, texts, padding=2, rotation=90 * narrow, fontsize=SIZE - 1.5)
    set_labels(ax, y="tension [N]")
    turned = 90 * (n > _MOST_UPRIGHT)
    ax.set_xticks(range(n), arm.tendon_names, fontsize=SIZE - 2 * many, rotation=turned)
    ax.tick_params(axis="x", length=0)
    ax.set_xlim(-0.6, n - 0.4)
    ax.set_ylim(0, (1.32 if narrow and not many else 1.15) * top)
    for end in np.cumsum([len(section.angles) for section in arm.sections])[:-1]:
        ax.axvline(float(end) - 0.5, color=INK, lw=0.5, ls=":")
    ax.yaxis.set_major_locator(MaxNLocator(5, steps=ROUND_STEPS))
