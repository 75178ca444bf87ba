"""Trajectories: tensions over time, the path of the tip, and animations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.animation import FuncAnimation, writers
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from octoplan.model.arm import Arm
from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.checks import whole, within
from octoplan.model.support.errors import Described, InputError
from octoplan.planner.frontends.io.files import atomic_write, path_of
from octoplan.planner.frontends.plots.arm import (
    best_view,
    draw_arm,
    fill_panel,
    set_limits,
)
from octoplan.planner.frontends.plots.plan import add_scale, finish
from octoplan.planner.frontends.plots.style import (
    DPI,
    INK,
    MM,
    PULL,
    SIZE,
    SLACK,
    make_axes,
    pull_norm,
    set_labels,
    several,
    taut_tendons,
)
from octoplan.planner.frontends.plots.targets import draw_target
from octoplan.planner.plan_result import Plan

# Accuracy of the shapes of frames, over the arm length: invisible.
_SEEN = 1e-4
# Writers of animations by suffix.
_WRITERS = {".gif": "pillow", ".mp4": "ffmpeg"}
# Maximal number of frames of a trajectory.
_MOST = 1000
# Number of points of the path of the tip.
_SHOWN = 50
# Height of the figure of a trajectory for each section [inch].
_PANEL = 1.5
# Colours of the tendons of a section.
_COLOURS = ("#1f6fb4", "#e08214", "#2a8c6e", "#b3123f", "#6a3d9a", "#8a6d3b", "#30343a", "#e377c2")
# Length of the dashes of equal tensions, in line widths.
_DASH = 5.0
# Difference over the largest tension of a panel below which tensions are drawn as equal.
_SAME = 0.006
# Number of tendons in a column of the legend.
_COLUMN = 6
# Distance of the number of a waypoint from the tip, over the arm length.
_BESIDE = 0.05


@dataclass(frozen=True, eq=False)
class _Step:
    """A frame: a shape, and the number of the next plan with targets and obstacles."""

    shape: Shape
    number: int
    targets: tuple[Any, ...]
    obstacles: tuple[Obstacle, ...]

    def draw(self, ax: Any, around: Array) -> Array:
        """Draw the frame, and planes around points; return points (N, 3) [m] to be seen."""
        return draw_arm(self.shape, ax, self.targets, self.obstacles, around=around)


def plot_trajectory(motion: Any) -> Figure:
    """Draw a Trajectory: the arm and all waypoints in 3-D, and the tensions over time.

    The arm is in its last shape; thin lines are its midlines at the other waypoints, which have
    numbers. Each section has a panel of tensions, and each base joint a panel of its values.
    Tendons of equal tension are drawn as one line with alternating colours.
    """
    question = motion.question
    last = motion.shape(motion.duration)
    obstacles = question.surroundings.at(motion.duration).obstacles
    taut = taut_tendons(motion.flat.max(axis=0))
    groups = [
        [j for j in last.arm.tendons_of(i + 1) if taut[j]] for i in range(len(last.arm.sections))
    ]
    groups = [group for group in groups if group]
    joints = [*question.placement.joints.names] if question.placement else []
    n_tensions = max(len(groups), 1)
    height = max(5.0, _PANEL * (len(groups) + len(joints)))
    figure = Figure(figsize=(10, height), dpi=DPI)
    ax: Any = figure.add_axes((0.0, 0.14, 0.52, 0.78), projection="3d")
    tips = np.array([motion.shape(t).tip for t in np.linspace(0, motion.times[-1], _SHOWN)])
    ax.plot(*(MM * tips).T, "-", color=INK, lw=1.0, label="path of the tip", zorder=8)
    points = [tips, *_draw_waypoints(motion, ax)]
    points.append(draw_arm(last, ax, question.targets[-1], obstacles, home=motion.arm))
    finish(ax, last, np.vstack(points), obstacles)
    sides = {"left": 0.60, "right": 0.90, "bottom": 0.6 / height, "top": 1 - 0.65 / height}
    grid = figure.add_gridspec(n_tensions + len(joints), 1, **sides)
    panels = [figure.add_subplot(grid[row]) for row in range(grid.nrows)]
    for group, panel in zip(groups, panels, strict=False):
        plot_tensions_over_time(motion, group, panel)
    for name, panel in zip(joints, panels[n_tensions:], strict=True):
        _plot_joint(motion, name, panel)
    for panel in panels[:-1]:
        panel.tick_params(labelbottom=False)
    _number_stops(motion, panels[0])
    panels[-1].set_xlabel("time [s]", fontsize=SIZE)
    figure.suptitle(motion.outcome.split(":")[0], fontsize=SIZE + 2)
    return figure


def _draw_waypoints(motion: Any, ax: Any) -> list[Array]:
    """Draw targets, midlines and numbers of all waypoints; return points (N, 3) [m].

    Additional waypoints, around obstacles, are dots on the path of the tip.
    """
    s = np.linspace(0.0, motion.arm.length, 60)
    way = motion.way
    is_several = len(way.met) > 1
    seen = []
    for number, (k, targets) in enumerate(zip(way.met, motion.question.targets, strict=True), 1):
        shape = motion.shape(way.starts[k])
        if number < len(way.met):
            seen += [draw_target(target, ax, shape) for target in targets]
            midline = shape.position(s)
            ax.plot(*(MM * midline).T, color=SLACK, lw=1.2, label="arm at waypoints", zorder=1.8)
            seen.append(midline)
        if is_several:
            place = shape.tip + _BESIDE * motion.arm.length * shape.tip_frame[:, 0]
            ax.text(*(MM * place), f"{number}", fontsize=SIZE, ha="center", va="center", zorder=10)
    between = [motion.shape(way.starts[k]).tip for k in range(1, way.met[-1]) if k not in way.met]
    if between:
        tips = np.array(between)
        ax.plot(*(MM * tips).T, "o", ms=4, color=INK, label="via points", zorder=8)
    return seen


def _number_stops(motion: Any, panel: Any) -> None:
    """Write the numbers of the waypoints above a panel of tensions, if there are several."""
    if len(motion.stops) < 2:
        return
    for number, t in enumerate(motion.times[list(motion.stops)], 1):
        panel.annotate(
            f"{number}",
            (t, 1.0),
            (0, 2),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            ha="center",
            fontsize=SIZE,
        )


def plot_tensions_over_time(motion: Any, tendons: Sequence[int], ax: Any) -> None:
    """Draw tensions [N] of some tendons over time [s], with waypoints and maxima as lines.

    Tendons of equal tension are drawn as dashes of alternating colours.
    """
    times, tensions = motion.times, motion.flat[:, tendons]
    most = float(tensions.max())
    near = _SAME * (most or 1.0)
    colours = _tendon_colours(len(tendons))
    for begin, end, members in equal_runs(tensions, near):
        for k, member in enumerate(members):
            gap = _DASH * (len(members) - 1)
            style = "-" if len(members) == 1 else (-_DASH * k, (_DASH, gap))
            ax.plot(
                times[begin : end + 1],
                tensions[begin : end + 1, members[0]],
                color=colours[member],
                ls=style,
                lw=1.6,
                dash_capstyle="butt",
            )
    upper = np.array(motion.question.limits.upper)[list(tendons)]
    for level in np.unique(upper[upper <= 3 * most]):
        ax.axhline(level, color=INK, lw=0.8, ls="--")
    for t in times[list(motion.stops)]:
        ax.axvline(t, color=INK, lw=0.6, ls=":", zorder=0.5)
    set_labels(ax, y="tension [N]")
    names = [motion.arm.tendon_name(int(j)) for j in tendons]
    lines = [Line2D([], [], color=colour, lw=1.6) for colour in colours]
    ax.legend(
        lines,
        names,
        loc="upper left",
        bbox_to_anchor=(1.01, 1.0),
        frameon=False,
        fontsize=SIZE - 1,
        ncol=1 if len(names) <= _COLUMN else 2,
        handlelength=1.4,
        columnspacing=0.8,
    )


def _plot_joint(motion: Any, name: str, ax: Any) -> None:
    """Draw the insertion [mm] or the rotation [deg] of the base over time [s]."""
    is_insertion = name == "insertion"
    values = 1e3 * motion.base[:, 0] if is_insertion else np.degrees(motion.base[:, 1])
    ax.plot(motion.times, values, color=_COLOURS[0], lw=1.6)
    for t in motion.times[list(motion.stops)]:
        ax.axvline(t, color=INK, lw=0.6, ls=":", zorder=0.5)
    set_labels(ax, y=f"{name} {'[mm]' if is_insertion else '[deg]'}")


def equal_runs(values: Array, near: float) -> list[tuple[int, int, tuple[int, ...]]]:
    """Return runs of equal curves: first and last index, and the columns that are equal there.

    Columns of `values` (N + 1, n) are equal from one row to the next if both rows differ by less
    than `near`. Each column is in one run at a time; a run is as long as its set of columns.
    """
    runs = list[tuple[int, int, tuple[int, ...]]]()
    before = dict[tuple[int, ...], int]()
    for i, (a, b) in enumerate(pairwise(values)):
        groups = list[list[int]]()
        for column in range(values.shape[1]):
            same = (
                group
                for group in groups
                if max(abs(a[column] - a[group[0]]), abs(b[column] - b[group[0]])) < near
            )
            group = next(same, None)
            if group is None:
                groups.append([column])
            else:
                group.append(column)
        now = {tuple(group): before.get(tuple(group), i) for group in groups}
        runs += [(start, i, members) for members, start in before.items() if members not in now]
        before = now
    return runs + [(start, len(values) - 1, members) for members, start in before.items()]


def _tendon_colours(count: int) -> list[Any]:
    """Return distinct colours of the tendons of a section."""
    if count <= len(_COLOURS):
        return list(_COLOURS[:count])
    return list(colormaps["turbo"](np.linspace(0.05, 0.95, count)))


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
            given = Described("a plan for another arm or scene")
            raise InputError(f"plans[{i}]", given, "a plan for the arm and scene of plans[0]")
    within("fps", fps, 0.1, 120.0)
    steps = _steps(first.arm, first.scene, plans, whole("frames", frames, 1, 10_000))
    titles = [f"plan {step.number} of {len(plans)}" * (len(plans) > 1) for step in steps]
    tips = np.array([plan.shape.tip for plan in plans])
    return _animation(steps, titles, ax, fps, tips)


def animate_trajectory(
    motion: Any, ax: Any = None, *, fps: float = 15.0, seconds: float | None = None
) -> FuncAnimation:
    """Return the animation of a Trajectory, in real time or scaled to `seconds`.

    Every frame is the settled shape at the time, with the next target; all waypoints are marked.

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
    tips = np.array([motion.shape(motion.way.starts[k]).tip for k in motion.way.met])
    return _animation(steps, [f"{t:.2f} s" for t in times], ax, (count - 1) / shown, tips)


def _animation(
    steps: list[_Step], titles: list[str], ax: Any, fps: float, tips: Array
) -> FuncAnimation:
    """Return the animation of frames with titles; mark the tips (M, 3) [m] at all waypoints."""
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
    bent = np.vstack(seen)
    sights = [np.vstack([step.draw(ax, bent), seen[0]]) for step in last]
    points = np.vstack([*seen, *sights])
    width = 1.5 * float(arm.radius.evaluate(s[:1], arm.length)[0][0])
    box = np.vstack([points, points - width, points + width])
    view = best_view(np.vstack([*seen[::5], *sights]), steps[0].shape, steps[0].obstacles)

    def draw(index: int) -> list[Any]:
        step = steps[index]
        ax.clear()
        step.draw(ax, bent)
        ax.plot(*(MM * tips).T, "+", color=INK, ms=6, mew=1.0, zorder=6)
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
