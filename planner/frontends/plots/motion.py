"""Trajectories: tensions over time, the path of the tip, and animations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import FuncAnimation, writers
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from octoplan.model.arm import Arm
from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.checks import within
from octoplan.model.support.errors import InputError
from octoplan.planner.frontends.io.files import atomic_write, path_of
from octoplan.planner.frontends.plots.arm import (
    best_view,
    draw_arm,
    fill_panel,
    set_best_view,
    set_limits,
)
from octoplan.planner.frontends.plots.plan import add_scale
from octoplan.planner.frontends.plots.style import (
    DPI,
    INK,
    MM,
    PULL,
    SIZE,
    make_axes,
    pull_norm,
    set_labels,
    several,
    taut_tendons,
)
from octoplan.planner.plan_result import Plan

# Accuracy of the shapes of frames, over the arm length: invisible.
_SEEN = 1e-4
# Writers of animations by suffix.
_WRITERS = {".gif": "pillow", ".mp4": "ffmpeg"}
# Maximal number of frames of a trajectory.
_MOST = 1000
# Number of points of the path of the tip.
_SHOWN = 50
# Line styles of taut tendons within a section; each section has a colour.
_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)))


@dataclass(frozen=True, eq=False)
class _Step:
    """A frame: a shape, and the number of the next plan with targets and obstacles."""

    shape: Shape
    number: int
    targets: tuple[Any, ...]
    obstacles: tuple[Obstacle, ...]

    def draw(self, ax: Any) -> Array:
        """Draw the frame; return points (N, 3) [m] that must be visible."""
        return draw_arm(self.shape, ax, self.targets, self.obstacles)


def plot_trajectory(motion: Any) -> Figure:
    """Draw a Trajectory: the last shape, the path of the tip, and tensions with maxima."""
    figure = Figure(figsize=(10, 5.0), dpi=DPI)
    ax: Any = figure.add_axes((0.0, 0.06, 0.52, 0.86), projection="3d")
    question = motion.question
    last = motion.shape(motion.duration)
    points = draw_arm(
        last, ax, question.targets[-1], question.surroundings.at(motion.duration).obstacles
    )
    tips = np.array([motion.shape(t).tip for t in np.linspace(0, motion.times[-1], _SHOWN)])
    ax.plot(*(MM * tips).T, "-", color=INK, lw=1.0, label="path of the tip", zorder=8)
    seen = np.vstack([points, tips])
    set_best_view(ax, last, seen)
    ax.legend(loc="upper left", frameon=False, fontsize=SIZE)
    over = figure.add_axes((0.60, 0.14, 0.37, 0.74))
    most = float(motion.flat.max())
    upper = np.array(question.limits.upper)
    for j in np.flatnonzero(taut_tendons(motion.flat.max(axis=0))):
        section = last.arm.tendons[j][0]
        style = _STYLES[(j - last.arm.tendons_of(section + 1)[0]) % len(_STYLES)]
        name = last.arm.tendon_name(int(j))
        colour = f"C{section % 10}"
        over.plot(motion.times, motion.flat[:, j], color=colour, ls=style, lw=1.4, label=name)
    for level in np.unique(upper[upper <= 3 * most]):
        over.axhline(level, color=INK, lw=0.8, ls="--")
    set_labels(over, "time [s]", "tension [N]")
    over.legend(ncol=3, frameon=False, fontsize=SIZE - 2, loc="upper left")
    figure.suptitle(motion.outcome.split(":")[0], fontsize=SIZE + 2)
    return figure


def plot_motion(
    plans: Sequence[Plan], ax: Any = None, *, frames: int = 15, fps: float = 15.0
) -> FuncAnimation:
    """Return the animation of an arm whose tensions go from zero to each of several plans.

    Tensions are interpolated between plans, and every frame is a settled shape. Each frame has the
    target of the next plan. Given 3-D axes are used.

    Parameters
    ----------
    plans : sequence of Plan
        Plans for one arm and scene.
    frames : int
        Number of frames from one plan to the next.
    fps : float
        Frames per second.

    Raises
    ------
    InputError
        For an empty sequence, for different arms or scenes, and for axes that are not 3-D.
    OctoplanError
        If the arm does not settle between the plans, see settle.
    """
    plans = several("plans", plans, Plan)
    first = plans[0].shape
    for i, other in enumerate(plan.shape for plan in plans):
        if (other.arm, other.scene) != (first.arm, first.scene):
            raise InputError(f"plans[{i}]", "another arm or scene", "for the arm and scene of all")
    within("fps", fps, 0.1, 120.0)
    steps = _steps(first.arm, first.scene, plans, int(within("frames", frames, 1, 10_000)))
    titles = [f"plan {step.number} of {len(plans)}" * (len(plans) > 1) for step in steps]
    return _animation(steps, titles, ax, fps)


def animate_trajectory(
    motion: Any, ax: Any = None, *, fps: float = 15.0, seconds: float | None = None
) -> FuncAnimation:
    """Return the animation of a Trajectory, in real time or scaled to `seconds`.

    Every frame is the settled shape at the time, with the next target.

    Raises InputError for axes that are not 3-D, and OctoplanError if the arm does not settle.
    """
    within("fps", fps, 0.1, 120.0)
    shown = motion.duration if seconds is None else within("seconds", seconds, 0.01, 3600.0)
    count = min(max(round(shown * fps), 1), _MOST) + 1
    times = np.linspace(0.0, motion.duration, count)
    ends = motion.times[list(motion.stops)]
    question = motion.question
    after = np.minimum(np.searchsorted(ends, times - 1e-9 * motion.duration), ends.size - 1)
    around = question.surroundings
    steps = [
        _Step(motion.shape(float(t)), int(k) + 1, question.targets[k], around.at(t).obstacles)
        for t, k in zip(times, after, strict=True)
    ]
    return _animation(steps, [f"{t:.2f} s" for t in times], ax, (count - 1) / shown)


def _animation(steps: list[_Step], titles: list[str], ax: Any, fps: float) -> FuncAnimation:
    """Return the animation of frames with titles."""
    arm = steps[0].shape.arm
    norm = pull_norm(np.concatenate([step.shape.tensions for step in steps]))
    if ax is None:
        figure = Figure(figsize=(6, 5.6), dpi=DPI)
        ax = figure.add_axes((0.02, 0.13, 0.96, 0.80), projection="3d")
        add_scale(ax, ScalarMappable(norm, PULL))
    make_axes(ax, form="3d")
    s = np.linspace(0.0, arm.length, 60)
    seen = [step.shape.position(s) for step in steps]
    last = {step.number: step for step in steps}.values()  # the frame at each plan
    sights = [np.vstack([step.draw(ax), seen[0]]) for step in last]
    points = np.vstack([*seen, *sights])
    width = 1.5 * float(arm.radius.evaluate(s[:1], arm.length)[0][0])
    box = np.vstack([points, points - width, points + width])
    view = best_view(np.vstack([*seen[::5], *sights]), steps[0].shape.frame(0.0)[:, 0])

    def draw(index: int) -> list[Any]:
        step = steps[index]
        ax.clear()
        step.draw(ax)
        set_limits(ax, box, True)
        fill_panel(ax, *view)
        if taut_tendons(step.shape.tensions).any():
            ax.collections[-1].set_norm(norm)
        ax.set_title(titles[index], fontsize=SIZE)
        return []

    return FuncAnimation(ax.figure, draw, len(steps), interval=1e3 / fps, init_func=list)


def save_motion(motion: FuncAnimation, path: str | Path, dpi: float = 0.8 * DPI) -> Path:
    """Write an animation as .gif, or as .mp4 by ffmpeg, atomically.

    Raises InputError for another suffix, for a folder that does not exist, and for .mp4 without
    ffmpeg.
    """
    path = path_of(path)
    writer = writer_of(path)
    with atomic_write(path, *_WRITERS) as part:
        motion.save(str(part), writer, dpi=dpi)
    return path


def writer_of(path: Path) -> str:
    """Return the name of the writer for a file; raise InputError, see save_motion."""
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise InputError("path", str(path), "a file name that ends in .gif or .mp4")
    if not path.parent.is_dir():
        raise InputError("path", str(path), "a file in a folder that exists")
    if not writers.is_available(writer):
        raise InputError("path", str(path), f"a .gif, because {writer} is not installed")
    return writer


def _steps(arm: Arm, scene: Scene, plans: Sequence[Plan], frames: int) -> list[_Step]:
    """Return the frames: the arm without tension, then `frames` to each plan, slow near plans."""
    pulls: list[Array] = [np.zeros(arm.n_tendons), *(plan.shape.tensions for plan in plans)]
    shares = (1 - np.cos(np.pi * np.arange(1, frames + 1) / frames)) / 2
    things = [(plan.targets, plan.problem.environment.obstacles) for plan in plans]
    results = [_Step(settle(arm, pulls[0], scene, _SEEN), 1, *things[0])]
    for i, (start, end) in enumerate(pairwise(pulls)):
        for share in shares:
            shape = settle(arm, start + share * (end - start), scene, _SEEN)
            results.append(_Step(shape, i + 1, *things[i]))
    return results
