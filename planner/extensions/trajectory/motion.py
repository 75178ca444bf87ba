"""A motion: tensions over time through targets, within limits on their rates."""

from __future__ import annotations

from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.extensions.contact.effects import contacts
from octoplan.model.forward import checked_accuracy
from octoplan.model.scene import Scene
from octoplan.model.support.machine.compiled import Compile, checked_compile
from octoplan.model.support.progress import GRACE, limited, seconds_left, with_progress
from octoplan.model.support.progress import time_limit as limited_to
from octoplan.planner.extensions.avoidance.surroundings import surroundings
from octoplan.planner.extensions.contact.load_path import is_same
from octoplan.planner.extensions.trajectory.clear import cleared
from octoplan.planner.extensions.trajectory.question import (
    Question,
    Rates,
    checked_start,
    checked_times,
    waypoints_of,
)
from octoplan.planner.extensions.trajectory.result import Trajectory
from octoplan.planner.extensions.trajectory.time_law import Timed
from octoplan.planner.extensions.trajectory.waypoints import planned_touching
from octoplan.planner.plan import ContactPlan, Plan
from octoplan.planner.question import checked_limits, planned_scene


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
    An arm in contact goes to each target from the one before, planned one by one: which of several
    equilibria it is in depends on its way. The certificate follows it, tells where it
    jumps, and checks contact at each target.

    Parameters
    ----------
    arm : Arm
    targets : sequence of targets (or of several to be met together), function, or file
        In order; a function of a fraction from 0 to 1 that returns a target or a place of the tip
        (3,) [m]; or the name of a .csv file with columns x_m, y_m, z_m, and t_s if times are given.
    waypoints : int
        At how many fractions a function is evaluated.
    scene, accuracy, compile, progress
        As plan takes them.
    time_limit : float
        How long the call may take [s]. The certificate has what the search leaves of the limit, and
        at least GRACE, 1 s; `outcome` says if the limit came before it was complete.
    tension_max, tension_min, total_pull, stroke_max, stroke_min, stroke_zero
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
    quasi_static : bool
        Whether the tip is to accelerate by a tenth of gravity at most, so that inertia, which is
        left out, counts for little; a slender arm may swing all the same, see Trajectory.period.
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
    CompilerError
        As plan does.
    """
    scene = planned_scene(arm, scene)
    sequence, file_times = waypoints_of(arm, targets, waypoints)
    strokes = stroke_max, stroke_min, stroke_zero
    accelerations = stroke_acceleration_max, tip_acceleration_max
    limits = checked_limits(arm, scene, tension_max, tension_min, total_pull, *strokes)
    rates = Rates.of(arm, rate_max, stroke_rate_max, *accelerations, quasi_static)
    instants = checked_times(file_times if times is None else times, len(sequence), rates)
    every = tuple(target for targets in sequence for target in targets)
    around = surroundings(arm, every, obstacles, clearance, self_clearance, in_time=True)
    held = start if isinstance(start, ContactPlan) and is_same(start.scene, scene) else None
    began, precision = checked_start(arm, start, limits), checked_accuracy(accuracy)
    how = instants, began, precision, checked_compile(compile), held
    question = Question(arm, scene, sequence, limits, rates, around, *how)
    with limited(time_limit):
        way = Timed.of(question, (planned_touching if contacts(scene) else cleared)(question))
        left = None if time_limit is None else max(seconds_left(), GRACE)
    question.check_durations(np.diff(way.starts[[0, *way.met]]))
    result = Trajectory(question, way)
    with limited_to(left):
        result.complete()
    return result
