"""Plan: check the arguments, choose the strategy, solve and certify."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.forward import checked_accuracy
from octoplan.model.scene import Scene
from octoplan.model.support.checks import kind, positive, within
from octoplan.model.support.errors import InputError
from octoplan.model.support.machine.compiled import Compile, checked_compile
from octoplan.model.support.progress import GRACE, reserve, seconds_left, with_progress
from octoplan.model.support.progress import time_limit as limited_to
from octoplan.planner.limits import checked_limits
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import (
    PlanningProblem,
    check_targets,
    checked_options,
    planned_scene,
)
from octoplan.planner.strategy import strategy_of
from octoplan.planner.targets.base import Target


@with_progress
def plan(
    arm: Arm,
    target: Target | Iterable[Target],
    scene: Scene | None = None,
    tension_max: Any = np.inf,
    *,
    tension_min: Any = 0.0,
    total_pull: float | None = None,
    norm: Any = "2",
    accuracy: float = 1e-6,
    starts: int | None = None,
    near: Plan | None = None,
    time_limit: float | None = None,
    stability_margin: float | None = None,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    obstacles: Any = (),
    clearance: float = 0.0,
    self_clearance: bool = False,
    stroke_max: Any = None,
    stroke_min: Any = None,
    progress: bool | None = None,
    stroke_zero: Any = "straight",
    certify: bool = True,
) -> Plan:
    """Return the tensions of least effort that give an arm the shape that a target wants.

    It may be called from several threads at once, as all functions may: what they share is built
    once and not changed, and each solves in memory of its own. Their linear algebra takes turns, so
    that processes are faster.

    Parameters
    ----------
    arm : Arm
    target : Target, or several to be met together
    scene : Scene
        The effects enabled; the bare arm unless given.
    tension_max, tension_min : float, or one for each tendon
        Bounds [N]; infinite and 0 unless given.
    total_pull : float
        The most that all tendons together may pull [N]; no limit unless given.
    norm : "2", "1" or "inf"
        What effort is: root of the sum of squares, sum, or largest tension.
    accuracy : float
        What residuals and tip errors are held to, over the arm's length (angles: rad).
    starts : int
        How many initial guesses are tried, as far as so many differ. Unless given, 14 at most, and
        fewer once enough of them led to the same optimum, which is no proof that it is the best. If
        these miss the target, 8 more, the nearest of several hundred settled shapes under tensions
        sampled over the limits; of a given number, half are such shapes.
    near : Plan
        A plan for a target nearby, of the same kind, for the same arm and scene: the search begins
        at its optimum, which takes a tenth of the time. Where that fails all starts are tried.
        Where the tensions do not go over into each other, as where a target passes the arm's axis,
        `outcome` says that the plan left the branch. Where contacts have friction it is the plan
        that the arm moves from in a straight line of tensions, against friction, which may have
        been 0 there; unless given, from the least tensions, where the arm has to touch nothing.
        Such plans are for places and poses.
    time_limit : float
        How long the call may take [s], with shape, certificate and outcome. The search then returns
        the best plan so far. The certificate has what is left of the limit, and at least GRACE, 1
        s. In contact the search ends early by about the time that the arm takes to settle.
        `outcome` says if the limit ended the search, or came before the certificate was complete.
        Setting up the first plan for an arm and a scene is not cut short.
    stability_margin : float
        The least stability of the shape under its loads that is accepted, 0 to 1: the least
        eigenvalue of the scaled Hessian of the energy, which is 1 for an arm at rest and 0 where it
        is about to yield. With 0 the arm has to be stable. Unless given 0.1, where that can be had,
        else the best that is stable, which `outcome` tells as on the brink; 0 where contacts have
        friction.
    compile : bool or "auto"
        Whether to work by machine code, see settle; the plan's shape and certificate are found by
        it too. In a scene as printed, and of curved tendons without loads, only these are.
    obstacles : sequence of Obstacle
        What the arm keeps clear of, all along; see octoplan.model.extensions.obstacles.
    clearance : float
        How far its surface stays from them [m].
    self_clearance : bool
        Whether it stays as far from itself and from the far side of its base plane.
    stroke_max : float, or one for each tendon
        The most that winches take in of tendons from where they are zeroed [m], of slack ones too
        (`Plan.strokes`); no limit unless given.
    stroke_min : float, or one for each tendon
        The least: 0 or below, how far they can pay out; as far as they take in unless given.
    progress : bool
        Whether a line tells how far it is: unless given, after two seconds, on terminals and in
        notebooks.
    stroke_zero : "straight", "at rest", Shape, or lengths (n_tendons,)
        Where winches are zeroed, and strokes count from: at the straight arm without loads, at the
        arm as it stands in the scene without tensions, at a shape, at lengths of tendons [m].
    certify : bool
        Whether to compute shape, certificate and outcome before returning. Pass False in loops that
        need tensions alone; shape and certificate are then computed when they are first read.

    Returns
    -------
    Plan
        Also if the target is not met: then it is the nearest shape found, and `outcome` says how
        far off that is, what holds it, and how many guesses and sampled shapes were tried.

    Raises
    ------
    InputError
        Naming the field, for anything that is not allowed; targets that contradict each other.
    CompilerError
        If `compile` is True, and there is no compiler or it fails.
    """
    scene = planned_scene(arm, scene)
    targets = check_targets(arm, target)
    seconds = None if time_limit is None else positive("time_limit", time_limit)
    strokes = (stroke_max, stroke_min, stroke_zero)
    limits = checked_limits(arm, scene, tension_max, tension_min, total_pull, *strokes)
    problem = PlanningProblem(
        arm,
        targets,
        scene,
        limits,
        checked_options(targets, limits, norm, starts),
        checked_accuracy(accuracy),
        machine_code=checked_compile(compile),
        guesses=starts,
        best_margin=stability_margin is None,
    )
    environment = obstacles, clearance, self_clearance
    strategy = strategy_of(problem, has_obstacles=not _is_default(*environment))
    if stability_margin is None:
        margin = strategy.default_margin(scene)
    else:
        margin = within("stability_margin", stability_margin, 0.0, 1.0)
    problem = replace(problem, options=replace(problem.options, margin=margin))
    problem = strategy.prepared(problem, *environment)
    if near is not None:
        kind("near", near, Plan, "a Plan for the same arm and scene, or None")
        if near.arm != arm or not strategy.is_continuable(near.scene, scene):
            raise InputError("near", "a plan for another arm or scene", "one for the same")
        problem = strategy.adapted(problem, near)
    kind("certify", certify, bool, "True or False")
    with limited_to(seconds, reserves=certify):
        result = strategy.plan(problem, near)
        reserve(0.0)
        left = None if seconds is None else max(seconds_left(), GRACE)
    if certify:
        with limited_to(left):
            result.complete()
    return result


def _is_default(obstacles: Any, clearance: Any, self_clearance: Any) -> bool:
    """Return whether the arguments are the defaults: no obstacles, and no clearance."""
    no_obstacles = isinstance(obstacles, tuple | list) and not obstacles
    no_clearance = type(clearance) in (int, float) and clearance == 0
    return no_obstacles and no_clearance and self_clearance is False
