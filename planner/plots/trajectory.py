"""Figures of motions: the arm at its waypoints, and tensions over time against their limits."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from matplotlib.figure import Figure

from model.arm import Arm
from model.paths import Array
from model.shape import Shape
from planner.plots.arm import draw_arm, look
from planner.plots.plan import DPI
from planner.plots.strains import INK, MM, PULL, SIZE

_SHOWN = 50


class Moving(Protocol):
    """What is drawn of a motion; see planner.Trajectory."""

    @property
    def arm(self) -> Arm:
        """Return the arm."""

    @property
    def question(self) -> Any:
        """Return what was asked."""

    @property
    def times(self) -> Array:
        """Return the times (N,) [s]."""

    @property
    def flat(self) -> Array:
        """Return the tensions (N, n_tendons) [N]."""

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Return the shapes at the times."""

    def shape(self, t: float) -> Shape:
        """Return the shape at a time [s]."""

    @property
    def outcome(self) -> str:
        """Return what happened, in words."""


def plot_trajectory(motion: Moving) -> Figure:
    """Draw a motion: its last shape and where the tip goes, and tensions with their maxima."""
    figure = Figure(figsize=(10, 5.0), dpi=DPI)
    ax: Any = figure.add_axes((0.0, 0.06, 0.52, 0.86), projection="3d")
    asked, last = motion.question, motion.shapes[-1]
    points = draw_arm(last, ax, asked.targets[-1], asked.surroundings.obstacles)
    tips = np.array([motion.shape(t).tip for t in np.linspace(0, motion.times[-1], _SHOWN)])
    ax.plot(*(MM * tips).T, "-", color=INK, lw=1.0, label="way of the tip", zorder=8)
    look(ax, last, np.vstack([points, tips]))
    ax.legend(loc="upper left", frameon=False, fontsize=SIZE)
    over = figure.add_axes((0.60, 0.14, 0.37, 0.74))
    most = float(motion.flat.max())
    upper = np.array(asked.limits.upper)
    for j in np.argsort(motion.flat.max(axis=0)):
        colour = PULL(0.15 + 0.8 * j / max(1, motion.arm.n_tendons - 1))
        name = motion.arm.tendon_name(int(j))
        over.plot(motion.times, motion.flat[:, j], color=colour, lw=1.3, label=name)
    for level in np.unique(upper[upper <= 3 * most]):
        over.axhline(level, color=INK, lw=0.8, ls="--")
    over.set_xlabel("time [s]", fontsize=SIZE)
    over.set_ylabel("tension [N]", fontsize=SIZE)
    over.tick_params(labelsize=SIZE - 1)
    over.legend(ncol=3, frameon=False, fontsize=SIZE - 2, loc="upper left")
    figure.suptitle(motion.outcome.split(":")[0], fontsize=SIZE + 2)
    return figure
