"""Figures of plans and shapes. Only planner/plots knows matplotlib."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from model.arm import Arm
from model.clearance import Clearance
from model.errors import InputError
from model.loads import contacts
from model.obstacles import Obstacle
from model.paths import Array
from model.shape import Shape
from planner.avoidance.asked import Surroundings
from planner.certificate import Certificate
from planner.io.files import placed
from planner.plots.arm import draw_arm, look
from planner.plots.strains import SIZE, plot_strains, plot_tensions
from planner.program.limits import Limits
from planner.targets.base import Target

__all__ = ["plot_plan", "plot_shape", "plot_strains", "save"]

DPI = 110


class Planned(Protocol):
    """What is drawn of a plan."""

    @property
    def arm(self) -> Arm:
        """Return the arm."""

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
    def tensions(self) -> Array:
        """Return the tensions [N]."""

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
        draw_arm(plan.shape, _three_d(ax), plan.targets, _things(plan), _nearest(plan))
        return ax  # type: ignore[no-any-return]
    figure = Figure(figsize=(10, 5.8), dpi=DPI)
    ax = _panel(figure, (0.0, 0.14, 0.56, 0.80))
    points = draw_arm(plan.shape, ax, plan.targets, _things(plan), _nearest(plan))
    _finish_panel(figure, ax, plan.shape, points)
    plot_strains(plan.shape, figure.add_axes((0.618, 0.515, 0.30, 0.36)))
    bars = figure.add_axes((0.618, 0.09, 0.30, 0.27))
    plot_tensions(plan.arm, np.ravel(plan.tensions), np.array(plan.limits.upper), bars)
    title = f"{plan.outcome.split(':')[0]}; effort {plan.effort:.3g} N"
    figure.suptitle(title, fontsize=SIZE + 2, y=0.975)
    return figure


def plot_together(plans: Sequence[Planned]) -> Figure:
    """Draw the arms of several plans with their targets in one 3-D figure."""
    figure = Figure(figsize=(7, 6.2), dpi=DPI)
    ax = _panel(figure, (0.02, 0.15, 0.94, 0.83))
    points = [
        draw_arm(plan.shape, ax, plan.targets, _things(plan), _nearest(plan)) for plan in plans
    ]
    _finish_panel(figure, ax, plans[0].shape, points[-1])
    return figure


def plot_shape(shape: Shape, ax: Any = None) -> Figure | Axes:
    """Draw the arm in 3-D; returns a new Figure, or the 3-D axes if given."""
    if ax is not None:
        draw_arm(shape, _three_d(ax), (), _touched(shape))
        return ax  # type: ignore[no-any-return]
    figure = Figure(figsize=(7, 6.2), dpi=DPI)
    ax = _panel(figure, (0.02, 0.15, 0.94, 0.83))
    _finish_panel(figure, ax, shape, draw_arm(shape, ax, (), _touched(shape)))
    return figure


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


def _things(plan: Planned) -> tuple[Obstacle, ...]:
    """Return what the arm keeps clear of, and what it may lean on."""
    return plan.surroundings.obstacles + _touched(plan.shape)


def _touched(shape: Shape) -> tuple[Obstacle, ...]:
    """Return what an arm may lean on."""
    return tuple(contact.obstacle for contact in contacts(shape.scene))


def _three_d(ax: Any) -> Any:
    if getattr(ax, "name", "") != "3d":
        raise InputError("ax", ax, 'axes made with projection="3d"')
    return ax


def _nearest(plan: Planned) -> Clearance | None:
    """Return what the certificate says of the nearest thing that the arm can meet."""
    found = plan.certificate.on_request.clearances.values()
    return min(found, key=lambda clear: clear.gap, default=None)


def _panel(figure: Figure, place: tuple[float, float, float, float]) -> Any:
    return figure.add_axes(place, projection="3d")


def _finish_panel(figure: Figure, ax: Any, shape: Shape, points: Array) -> None:
    """Turn the panel to where points (N, 3) [m] are seen best; add the scale of tensions."""
    look(ax, shape, points)
    if shape.tensions.any():
        x, _, width, _ = ax.get_position(original=True).bounds
        bar_place = (x + 0.3 * width, 0.105, 0.4 * width, 0.018)
        bar = figure.colorbar(
            ax.collections[-1], cax=figure.add_axes(bar_place), orientation="horizontal"
        )
        bar.set_label("tension [N]", fontsize=SIZE)
        bar.ax.tick_params(labelsize=SIZE - 1)
        bar.outline.set_visible(False)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="upper left", frameon=False, fontsize=SIZE)
