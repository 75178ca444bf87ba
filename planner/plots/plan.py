"""Figures of plans and shapes. Only planner/plots knows matplotlib."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from model.errors import InputError
from model.paths import Array
from model.shape import Shape
from planner.avoidance.asked import Surroundings
from planner.certificate import Certificate
from planner.io.files import placed
from planner.plots.arm import draw_arm, look
from planner.plots.strains import plot_strains, plot_tensions
from planner.plots.style import DPI, SIZE, axes_of
from planner.program.limits import Limits
from planner.targets.base import Target

__all__ = ["plot_plan", "plot_shape", "plot_strains", "save"]


class Planned(Protocol):
    """What is drawn of a plan."""

    @property
    def shape(self) -> Shape:
        """Return the settled shape."""

    @property
    def targets(self) -> tuple[Target, ...]:
        """Return what was asked."""

    @property
    def surroundings(self) -> Surroundings:
        """Return what the arm was to keep clear of."""

    @property
    def limits(self) -> Limits:
        """Return the limits of the tensions."""

    @property
    def outcome(self) -> str:
        """Return what happened, in words."""

    @property
    def certificate(self) -> Certificate:
        """Return what the check of the tensions found."""

    @property
    def effort(self) -> float:
        """Return the norm of the tensions [N]."""


def plot_plan(plan: Planned, ax: Any = None) -> Figure | Axes:
    """Draw a plan: the arm with its target in 3-D, strains along it, and tensions.

    With 3-D axes given, draws the arm and the target in them and returns them; colours are those
    of tensions, and `figure.colorbar(ax.collections[-1])` tells them. Otherwise returns a Figure.
    """
    if ax is not None:
        draw_plan(plan, axes_of(ax, kind="3d")[1])
        return ax  # type: ignore[no-any-return]
    figure, shape = Figure(figsize=(10, 5.8), dpi=DPI), plan.shape
    ax = figure.add_axes((0.0, 0.14, 0.56, 0.80), projection="3d")
    finish(ax, shape, draw_plan(plan, ax))
    plot_strains(shape, figure.add_axes((0.618, 0.515, 0.30, 0.36)))
    bars = figure.add_axes((0.618, 0.09, 0.30, 0.27))
    plot_tensions(shape.arm, shape.tensions, np.array(plan.limits.upper), bars)
    title = f"{plan.outcome.split(':')[0]}; effort {plan.effort:.3g} N"
    figure.suptitle(title, fontsize=SIZE + 2, y=0.975)
    return figure


def plot_together(plans: Sequence[Planned]) -> Figure:
    """Draw the arms of several plans with their targets in one 3-D figure."""
    figure, ax = _alone()
    points = [draw_plan(plan, ax) for plan in plans]
    finish(ax, plans[0].shape, np.vstack(points))
    return figure


def plot_shape(shape: Shape, ax: Any = None) -> Figure | Axes:
    """Draw the arm in 3-D; returns a new Figure, or the 3-D axes if given."""
    if ax is not None:
        draw_arm(shape, axes_of(ax, kind="3d")[1])
        return ax  # type: ignore[no-any-return]
    figure, ax = _alone()
    finish(ax, shape, draw_arm(shape, ax))
    return figure


def draw_plan(plan: Planned, ax: Any) -> Array:
    """Draw the arm of a plan with its targets and obstacles; return points (N, 3) [m] of them."""
    found = plan.certificate.on_request.clearances.values()
    nearest = min(found, key=lambda clear: clear.gap, default=None)
    return draw_arm(plan.shape, ax, plan.targets, plan.surroundings.obstacles, nearest)


def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure as .png or .pdf; the file appears whole or not at all."""
    path = Path(path)
    if path.suffix.lower() not in (".png", ".pdf"):
        raise InputError("path", str(path), "a file name that ends in .png or .pdf")
    if not path.parent.is_dir():
        raise InputError("path", str(path), "a file in a folder that exists")
    with placed(path) as part:
        part.write_bytes(drawn(figure, path.suffix[1:].lower()))
    return path


def drawn(figure: Figure, kind: str) -> bytes:
    """Return a figure as a file of a kind, "png" or "pdf"."""
    file = io.BytesIO()
    figure.savefig(file, format=kind, dpi=DPI if kind == "png" else 2 * DPI)
    return file.getvalue()


def _alone() -> tuple[Figure, Any]:
    figure = Figure(figsize=(7, 6.2), dpi=DPI)
    return figure, figure.add_axes((0.02, 0.15, 0.94, 0.83), projection="3d")


def finish(ax: Any, shape: Shape, points: Array) -> None:
    """Turn a panel to where points (N, 3) [m] are seen best; add its legend and its colours."""
    look(ax, shape, points)
    if shape.tensions.any():
        add_scale(ax, ax.collections[-1])
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="upper left", frameon=False, fontsize=SIZE)


def add_scale(ax: Any, pulled: Any) -> None:
    """Add the scale of what colours tendons below a panel."""
    x, y, width, _ = ax.get_position(original=True).bounds
    place = ax.figure.add_axes((x + 0.3 * width, y - 0.04, 0.4 * width, 0.018))
    bar = ax.figure.colorbar(pulled, cax=place, orientation="horizontal")
    bar.set_label("tension [N]", fontsize=SIZE)
    bar.ax.tick_params(labelsize=SIZE - 1)
    bar.outline.set_visible(False)
