"""A motion: tensions over time through targets, within limits on their rates."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from model.arm import Arm
from model.checks import kind, positive
from model.errors import InputError
from model.loads import contacts
from model.machine.compiled import Compile, checked_compile
from model.mesh import checked_accuracy
from model.paths import Array
from model.progress import with_progress
from model.scene import Scene
from model.time_limit import limited
from planner.avoidance.surroundings import surroundings
from planner.plan import Plan
from planner.program.limits import Limits
from planner.question import check_targets, checked_limits, planned_scene
from planner.targets.base import Target
from planner.trajectory.clear import cleared
from planner.trajectory.question import (
    Question,
    Rates,
    checked_times,
    of_target,
    waypoints_of,
)
from planner.trajectory.result import Trajectory
from planner.trajectory.time_law import Timed
from planner.trajectory.touching import check_touching, planned_touching

# What durations may exceed given times by, over these: rounding.
_LATE = 1e-6


@with_progress
def trajectory(
    arm: Arm,
    targets: Any,
    scene: Scene | None = None,
    tension_max: Any = np.inf,
    *,
    rate_max: Any = None,
    stroke_rate_max: float | None = None,
    stroke_acceleration_max: float | None = None,
    times: Any = None,
    start: Plan | Any = None,
    tension_min: Any = 0.0,
    total_pull: float | None = None,
    obstacles: Any = (),
    clearance: float = 0.0,
    self_clearance: bool = False,
    waypoints: int = 20,
    accuracy: float = 1e-6,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    stroke_max: Any = None,
    stroke_min: Any = None,
    stroke_zero: Any = "straight",
    time_limit: float | None = None,
    progress: bool | None = None,
    quasi_static: bool = False,
    tip_acceleration_max: float | None = None,
) -> Trajectory:
    """Return tensions over time that bring an arm through targets, in the least time or effort.

    Quasi-static: the arm is at rest at each instant; the outcome says how slow is slow enough.
    An arm that leans on things goes to each target from the one before, planned one by one: which
    of several equilibria it is in depends on its way. The certificate follows it, tells where it
    jumps, and checks contact at each target.

    Parameters
    ----------
    targets : sequence of targets (or of several to be met together), function, or file
        In order; a function of a share from 0 to 1 that returns a target or a place of the tip (3,)
        [m], asked so often as `waypoints` says; or the name of a .csv file with columns x_m, y_m,
        z_m, and t_s if times are given.
    tension_max, tension_min, total_pull, stroke_max, stroke_min, stroke_zero, scene, accuracy,
    compile
        As plan takes them.
    rate_max : float, or one for each tendon
        The fastest that tensions change [N/s].
    stroke_rate_max : float
        The fastest that lengths of tendons change [m/s].
    stroke_acceleration_max : float
        The most that these rates change [m/s2]. Ways are straight in the tensions, so that the arm
        then rests at each waypoint, and goes between them in the least time that limits allow; the
        ways themselves are not chosen for it.
    times : (M,)
        When each target is to be reached [s]; then effort is made least, otherwise time.
    start : Plan, or tensions
        Where the motion begins; at rest, with the least tensions, unless given.
    obstacles, clearance, self_clearance
        What the arm keeps clear of, all the time; see plan. Obstacles may be Moving. In the least
        time it goes around them; that it waits for them is not tried.
    time_limit : float
        [s].
    progress : bool
        Whether a line tells how far it is: unless given, after two seconds, on terminals and in
        notebooks.
    quasi_static : bool
        Whether the tip is to accelerate by a tenth of gravity at most, so that inertia, which is
        left out, counts for little.
    tip_acceleration_max : float
        The most that the tip accelerates, in place of that [m/s2]; as with accelerations of strokes
        the arm then rests at each waypoint.

    Raises
    ------
    InputError
        Naming the field, for anything that is not allowed; for times that the rates do not allow,
        with what would do.
    TimeLimitError
        Where the time limit is reached before there is a motion.
    """
    seconds = None if time_limit is None else positive("time_limit", time_limit)
    scene = planned_scene(arm, scene)
    path, file_times = waypoints_of(targets, waypoints)
    times = file_times if times is None else times
    strokes = (stroke_max, stroke_min, stroke_zero)
    limits = checked_limits(arm, scene, tension_max, tension_min, total_pull, *strokes)
    sequence = _checked(arm, path)
    accelerations = stroke_acceleration_max, tip_acceleration_max
    rates = Rates.of(arm, rate_max, stroke_rate_max, *accelerations, quasi_static)
    instants = checked_times(times, len(sequence))
    if instants is None and not rates.limited:
        allowed = (
            "rate_max [N/s], a limit of strokes [m/s, m/s2] or of the tip's acceleration [m/s2] "
            "for the least time, or times [s]"
        )
        raise InputError("times", None, allowed)
    every: tuple[Target, ...] = tuple(target for targets in sequence for target in targets)
    around = surroundings(arm, every, obstacles, clearance, self_clearance, in_time=True)
    accuracy = checked_accuracy(accuracy)
    begin = _start(arm, start, limits)
    own_plan = start if isinstance(start, Plan) else None
    more = (around, instants, begin, accuracy, checked_compile(compile), own_plan)
    question = Question(arm, scene, sequence, limits, rates, *more)
    with limited(seconds):
        if contacts(scene):
            check_touching(question)
            tensions, met = planned_touching(question)
        else:
            _check_start(question)
            led = cleared(question)
            tensions, met = led.tensions, led.met_at
        timed = Timed.of(question, tensions, met)
        _check_durations(question, timed, met)
        return Trajectory(question, timed, met)


def _checked(arm: Arm, path: Iterable[Any]) -> tuple[tuple[Target, ...], ...]:
    """Return the targets of each waypoint; InputError names the one that is not allowed."""
    checked = []
    for i, target in enumerate(path):
        with of_target(i):
            checked.append(check_targets(arm, target))
    return tuple(checked)


def _start(arm: Arm, start: Any, limits: Limits) -> Array:
    """Return the tensions (n_tendons,) that a motion begins with."""
    if start is None:
        return np.array(limits.lower)
    if isinstance(start, Plan):
        if start.arm != arm:
            raise InputError("start", "a plan for another arm", "one for the same")
        return np.ravel(start.tensions)
    kind("start", start, Iterable, "a Plan, or tensions [N]")
    return arm.flat(start, "start")


def _check_start(question: Question) -> None:
    """Raise InputError where the arm is too near to something before it moves."""
    line, surroundings = question.lines()(question.start), question.surroundings.at(0.0)
    nearest = surroundings.in_the_way(line) if surroundings and line is not None else ""
    if not nearest:
        return
    distance = 1e3 * surroundings.clearance
    kept = f"{distance:g} mm of clearance" if distance else "clear"
    allowed = f"a start or obstacles that leave the arm {kept} before it moves: {nearest}"
    raise InputError("start", [round(float(T), 6) for T in question.start], allowed)


def _check_durations(question: Question, timed: Timed, met: tuple[int, ...]) -> None:
    """Raise InputError for times that the rates do not allow, with what would do."""
    if question.steps is None or question.times is None:
        return
    needed, steps = np.diff(timed.starts[[0, *met]]), question.steps
    late = np.flatnonzero(needed > steps * (1 + _LATE) + 1e-12)
    if late.size:
        i, faster = int(late[0]), float((needed / steps).max())
        allowed = (
            f"{needed[i]:.4g} s after the target before at these rates, not "
            f"{steps[i]:.4g} s; or rates {faster:.3g} times as high"
        )
        raise InputError(f"times[{i}]", float(question.times[i]), allowed)
