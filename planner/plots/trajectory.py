"""Figures of motions: the arm at its waypoints, and tensions over time against their limits."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from matplotlib.figure import Figure

from model.paths import Array
from model.shape import Shape
from planner.plots.arm import draw_arm, fit, look
from planner.plots.style import DPI, INK, MM, SIZE, labelled

_SHOWN = 50
# Tendons that pull less than this share of the most are left out; a colour a section, a style each.
_PULLS = 1e-3
_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))


class Moving(Protocol):
    """What is drawn of a motion; see planner.Trajectory."""

    @property
    def question(self) -> Any:
        """Return what was asked."""

    @property
    def times(self) -> Array:
        """Return the times (N,) [s]."""

    @property
    def flat(self) -> Array:
        """Return the tensions (N, n_tendons) [N]."""

    def shape(self, t: float) -> Shape:
        """Return the shape at a time [s]."""

    @property
    def duration(self) -> float:
        """Return how long it takes [s]."""

    @property
    def stops(self) -> tuple[int, ...]:
        """Return at which of the times each target is met."""

    @property
    def outcome(self) -> str:
        """Return what happened, in words."""


def plot_trajectory(motion: Moving) -> Figure:
    """Draw a motion: its last shape and where the tip goes, and tensions with their maxima."""
    figure = Figure(figsize=(10, 5.0), dpi=DPI)
    ax: Any = figure.add_axes((0.0, 0.06, 0.52, 0.86), projection="3d")
    asked, last = motion.question, motion.shape(motion.duration)
    points = draw_arm(last, ax, asked.targets[-1], asked.surroundings.at(motion.duration).obstacles)
    tips = np.array([motion.shape(t).tip for t in np.linspace(0, motion.times[-1], _SHOWN)])
    ax.plot(*(MM * tips).T, "-", color=INK, lw=1.0, label="path of the tip", zorder=8)
    seen = np.vstack([points, tips])
    fit(ax, seen, fresh=False)
    look(ax, last, seen)
    ax.legend(loc="upper left", frameon=False, fontsize=SIZE)
    over = figure.add_axes((0.60, 0.14, 0.37, 0.74))
    most = float(motion.flat.max())
    upper = np.array(asked.limits.upper)
    for j in np.flatnonzero(motion.flat.max(axis=0) > _PULLS * most):
        section = last.arm.tendons[j][0]
        style = _STYLES[(j - last.arm.tendons_of(section + 1)[0]) % len(_STYLES)]
        name = last.arm.tendon_name(int(j))
        given: dict[str, Any] = {"color": f"C{section % 10}", "ls": style, "lw": 1.4, "label": name}
        over.plot(motion.times, motion.flat[:, j], **given)
    for level in np.unique(upper[upper <= 3 * most]):
        over.axhline(level, color=INK, lw=0.8, ls="--")
    labelled(over, "time [s]", "tension [N]")
    over.legend(ncol=3, frameon=False, fontsize=SIZE - 2, loc="upper left")
    figure.suptitle(motion.outcome.split(":")[0], fontsize=SIZE + 2)
    return figure
