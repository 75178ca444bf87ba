"""Plan a motion: tensions over time that pass through targets, within rate limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.forward import checked_accuracy
from octoplan.model.loads import has_complementarity
from octoplan.model.scene import Scene
from octoplan.model.support.errors import Described, InputError
from octoplan.model.support.machine.compiled import Compile, checked_compile
from octoplan.model.support.progress import GRACE, limited, seconds_left, with_progress
from octoplan.model.support.progress import time_limit as limited_to
from octoplan.planner.extensions.avoidance.surroundings import surroundings
from octoplan.planner.extensions.base_joints.joints import BaseJoints
from octoplan.planner.extensions.base_joints.placement import JointPlacement, placement_of
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
from octoplan.planner.limits import Limits, checked_limits
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import planned_scene

if TYPE_CHECKING:
    from octoplan.planner.extensions.contact.plan import ContactPlan


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
    limits: Limits | None = None,
    obstacles: Any = (),
    clearance: float = 0.0,
    self_clearance: bool = False,
    waypoints: int = 20,
    accuracy: float = 1e-6,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    stroke_zero: Any = "straight",
    time_limit: float | None = None,
    progress: bool | None = None,
    quasi_static: bool = False,
    tip_acceleration_max: float | None = None,
    base: BaseJoints | None = None,
) -> Trajectory:
    """Return tensions over time that move an arm through targets, in minimal time or effort.

    The motion is quasi-static: the arm is in static equilibrium at each instant. The outcome
    reports whether the motion is slow enough for this. With contact, each target is planned from
    the previous one, because the equilibrium depends on the history. The certificate follows the
    history, reports jumps, and checks contact at each target.

    Parameters
    ----------
    arm : Arm
    targets : sequence of targets, function, or file
        Targets in order; an entry may be several targets of one shape. A function of a fraction
        from 0 to 1 returns a target or a place of the tip (3,) [m]. A .csv file has columns x_m,
        y_m, z_m, and optionally t_s.
    waypoints : int
        Number of fractions at which a function is evaluated.
    scene, accuracy, compile, progress
        See plan.
    time_limit : float
        Limit of the whole call [s]. The certificate has the time that the search leaves, and at
        least GRACE, 1 s; `outcome` reports an incomplete certificate.
    tension_max, limits, stroke_zero
        See plan.
    rate_max : float, or one for each tendon
        Largest rate of tensions [N/s].
    stroke_rate_max : float
        Largest rate of tendon lengths [m/s].
    stroke_acceleration_max : float
        Largest acceleration of tendon lengths [m/s2]. Paths are straight in the tensions, so that
        the arm stops at each waypoint; between waypoints it moves in minimal time. The paths
        themselves are not optimised for accelerations.
    times : (M,)
        Prescribed time of each target [s]; the objective is then the effort, otherwise the time.
    start : Plan, or tensions
        Start of the motion; by default the arm at rest, with the smallest allowed tensions.
    obstacles, clearance, self_clearance
        Clearance requirements for the whole motion; see plan. Obstacles may be Moving. A motion in
        minimal time goes around obstacles and does not wait for them.
    quasi_static : bool
        Whether to limit the tip's acceleration to a tenth of gravity, so that the neglected inertia
        is small. A slender arm may still oscillate; see Trajectory.period.
    tip_acceleration_max : float
        Largest acceleration of the tip [m/s2], instead of `quasi_static`; the arm then stops at
        each waypoint, as for accelerations of strokes.
    base : BaseJoints
        Joints of the base, with rates; see plan. Joint values are linear between waypoints, as
        tensions are. Such motions have no obstacles, no limits of strokes and their rates, and no
        limits of accelerations.

    Raises
    ------
    InputError
        For unsuitable input, with the name of the field; for times that the rates do not allow,
        with times or rates that suffice.
    TimeLimitError
        If the time limit is reached before there is a motion.
    CompilerError
        See plan.
    """
    scene = planned_scene(arm, scene)
    sequence, file_times = waypoints_of(arm, targets, waypoints)
    bounds = checked_limits(arm, scene, tension_max, limits, stroke_zero)
    rates = Rates.of(
        arm,
        tension=rate_max,
        stroke=stroke_rate_max,
        acceleration=stroke_acceleration_max,
        tip=tip_acceleration_max,
        quasi_static=quasi_static,
    )
    placement = None if base is None else _placement(arm, scene, base, start)
    instants = checked_times(file_times if times is None else times, len(sequence), rates, base)
    every = tuple(target for targets in sequence for target in targets)
    question = Question(
        arm=arm,
        scene=scene,
        targets=sequence,
        limits=bounds,
        rates=rates,
        surroundings=surroundings(arm, every, obstacles, clearance, self_clearance, in_time=True),
        times=instants,
        start=checked_start(arm, start, bounds),
        accuracy=checked_accuracy(accuracy),
        machine_code=checked_compile(compile),
        begin=_plan_in_contact(start, scene) if has_complementarity(scene) else None,
        placement=placement,
    )
    if placement is not None:
        _check_fixed_base_options(question)
    with limited(time_limit):
        way = Timed.of(
            question, (planned_touching if has_complementarity(scene) else cleared)(question)
        )
        left = None if time_limit is None else max(seconds_left(), GRACE)
    question.check_durations(np.diff(way.starts[[0, *way.met]]))
    result = Trajectory(question, way)
    with limited_to(left):
        result.complete()
    return result


def _plan_in_contact(start: Any, scene: Scene) -> ContactPlan | None:
    """Return the plan that a motion in contact starts from, if `start` is one for the scene."""
    from octoplan.planner.extensions.contact.load_path import is_same
    from octoplan.planner.extensions.contact.plan import ContactPlan

    is_plan = isinstance(start, ContactPlan) and is_same(start.scene, scene)
    return start if is_plan else None


def _placement(arm: Arm, scene: Scene, base: Any, start: Any) -> JointPlacement:
    """Return the base joints at their initial values: of the plan `start`, or nearest to 0."""
    placement = placement_of(arm, scene, (), base)
    if not isinstance(start, Plan):
        return placement
    values = start.solution.base or (0.0, 0.0)
    low, high = placement.joints.limits
    if np.any(np.less(values, low)) or np.any(np.greater(values, high)):
        raise InputError("start", tuple(values), f"a plan with base joints from {low} to {high}")
    return placement.at(values)


def _check_fixed_base_options(question: Question) -> None:
    """Raise InputError for options of motions that base joints do not support."""
    rates = question.rates
    given = {
        "obstacles": bool(question.surroundings),
        "stroke_max": question.limits.strokes is not None,
        "stroke_rate_max": np.isfinite(rates.stroke),
        "stroke_acceleration_max": np.isfinite(rates.acceleration),
        "tip_acceleration_max": np.isfinite(rates.tip_acceleration),
    }
    for name, is_given in given.items():
        if is_given:
            raise InputError(name, Described("given"), "omitted beside base joints")
