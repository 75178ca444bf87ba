"""Plan: check the arguments, choose the strategy, solve and certify.

`Strategy` plans free arms. Extensions derive the strategies that entry_points.py lists.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.centreline import Centreline
from octoplan.model.forward import checked_accuracy
from octoplan.model.loads import is_coupled
from octoplan.model.scene import Scene
from octoplan.model.support.checks import flag, kind, positive, whole, within
from octoplan.model.support.errors import Described, InputError, OctoplanError
from octoplan.model.support.machine.compiled import Compile, checked_compile
from octoplan.model.support.progress import GRACE, OutOfTime, reserve, seconds_left, with_progress
from octoplan.model.support.progress import time_limit as limited_to
from octoplan.planner.block import Constraints
from octoplan.planner.certificate import BRINK
from octoplan.planner.entry_points import BASE_JOINTS, JUMP, STRATEGIES, WARM_START, load
from octoplan.planner.limits import Limits, checked_limits
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import (
    PlanningProblem,
    check_targets,
    checked_options,
    planned_scene,
)
from octoplan.planner.solution import Solution
from octoplan.planner.solve.multistart import Multistart
from octoplan.planner.solve.refine import CORRECTIONS, refine
from octoplan.planner.solve.search import Search
from octoplan.planner.targets.base import Target

if TYPE_CHECKING:
    from octoplan.planner.extensions.base_joints.joints import BaseJoints


@with_progress
def plan(
    arm: Arm,
    target: Target | Iterable[Target],
    scene: Scene | None = None,
    tension_max: Any = np.inf,
    *,
    limits: Limits | None = None,
    base: BaseJoints | None = None,
    near: Plan | None = None,
    obstacles: Any = (),
    clearance: float = 0.0,
    self_clearance: bool = False,
    stroke_zero: Any = "straight",
    accuracy: float = 1e-6,
    stability_margin: float | None = None,
    norm: Any = "2",
    starts: int | None = None,
    certify: bool = True,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    time_limit: float | None = None,
    progress: bool | None = None,
) -> Plan:
    """Return the tensions of least effort that give an arm the shape that a target asks for.

    Several threads may call this function at the same time. Their linear algebra takes turns, so
    that processes are faster.

    Parameters
    ----------
    arm : Arm
    target : Target, or several to be met together
    scene : Scene
        The effects; the bare arm unless given.
    tension_max : float, or one for each tendon
        Largest tension [N]; infinite unless given.
    limits : Limits
        Further limits: smallest tensions, the sum of the tensions, and strokes of the winches.
    base : BaseJoints
        Joints of the base as further unknowns: insertion along the axis of the base, and rotation
        about it, within limits and with a weight in the effort. `Plan.base` has the joint values.
        Targets and loads stay in space. The default is a fixed base.
    near : Plan
        A plan for a target nearby, of the same kind, for the same arm and scene. The search begins
        at its optimum, which takes a tenth of the time. If this fails, all guesses are tried. If
        the tensions jump, for example because a target passes the arm's axis, `outcome` reports
        that the plan left the branch. With friction of contacts, `near` is the plan from which the
        arm moves, in a straight line of tensions, against friction; the friction of `near` may
        differ. Without `near` the arm moves from the smallest tensions, at which it must not touch
        anything. Plans with friction of contacts are for positions and poses.
    obstacles : sequence of Obstacle
        Bodies that the whole arm keeps clear of; see octoplan.model.extensions.obstacles.
    clearance : float
        Smallest distance of the arm's surface from the obstacles [m].
    self_clearance : bool
        Whether the arm keeps the same distance from itself and from the far side of its base plane.
    stroke_zero : "straight", "at rest", Shape, or lengths (n_tendons,)
        Zero of the winches: the straight arm without loads, the arm in the scene without tensions,
        a shape, or lengths of the tendons [m].
    accuracy : float
        Tolerance of residuals and tip errors, over the arm's length (angles: rad).
    stability_margin : float
        Smallest accepted stability of the shape under its loads, 0 to 1: the smallest eigenvalue of
        the scaled Hessian of the energy, which is 1 for an arm at rest and 0 for an arm that is
        about to yield. With 0 the arm has to be stable. Unless given, 0.1 if attainable, otherwise
        the best stable plan, which `outcome` reports as on the brink; 0 with friction of contacts.
    norm : "2", "1" or "inf"
        The effort that is minimised: root of the sum of squares, sum, or largest tension.
    starts : int
        Number of initial guesses. Unless given, at most 14; the search stops once enough guesses
        lead to the same optimum, which does not prove that the optimum is the best. If the guesses
        miss the target, 8 more follow: the nearest of several hundred settled shapes, under
        tensions sampled over the limits. Half of a given number are such shapes.
    certify : bool
        Whether to compute shape, certificate and outcome before returning. Pass False in loops that
        need tensions alone; the plan then computes shape and certificate at their first reading.
    compile : bool or "auto"
        Whether to use machine code, see settle. In a scene as printed, and with curved tendons
        without loads, machine code computes the shape and the certificate only.
    time_limit : float
        Time for the call [s], with shape, certificate and outcome. The search then returns the best
        plan so far. The certificate gets the rest of the time, and at least GRACE, 1 s. In contact
        the search ends earlier, by about the time that the arm takes to settle. `outcome` reports
        if the limit ended the search or the certificate. The first plan for an arm and a scene
        builds functions; the limit does not stop this.
    progress : bool
        Whether to show a line of progress. Unless given, after two seconds, on terminals and in
        notebooks.

    Returns
    -------
    Plan
        If the target is missed, the nearest shape found. `outcome` then reports the distance, the
        active limits, and the numbers of guesses and sampled shapes.

    Raises
    ------
    InputError
        With the name of the argument, for values that are not allowed and for targets that
        contradict each other.
    CompilerError
        If `compile` is True and there is no compiler, or the compiler fails.
    """
    scene = planned_scene(arm, scene)
    targets = check_targets(arm, target)
    seconds = None if time_limit is None else positive("time_limit", time_limit)
    bounds = checked_limits(arm, scene, tension_max, limits, stroke_zero)
    problem = PlanningProblem(
        arm,
        targets,
        scene,
        bounds,
        checked_options(targets, bounds, norm),
        checked_accuracy(accuracy),
        machine_code=checked_compile(compile),
        guesses=None if starts is None else whole("starts", starts, 1),
        best_margin=stability_margin is None,
    )
    environment = obstacles, clearance, self_clearance
    strategy = strategy_of(problem, has_obstacles=not _is_default(*environment))
    if stability_margin is None:
        margin = strategy.default_margin(arm, scene)
    else:
        margin = within("stability_margin", stability_margin, 0.0, 1.0)
    problem = replace(problem, options=replace(problem.options, margin=margin))
    problem = strategy.prepared(problem, *environment)
    if base is not None:
        problem = load(BASE_JOINTS)(problem, base)
    if near is not None:
        kind("near", near, Plan, "a Plan for this arm and scene, or None")
        if near.arm != arm or not strategy.is_continuable(near.scene, scene):
            given = Described("a plan for another arm or scene")
            raise InputError("near", given, "a plan for this arm and scene")
        problem = strategy.adapted(problem, near)
    certify = flag("certify", certify)
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


class Strategy:
    """The strategy for free arms: continue a plan nearby, otherwise search from all guesses.

    Strategies have no state.
    """

    def default_margin(self, arm: Arm, scene: Scene) -> float:
        """Return the stability margin of an arm in a scene if none is given."""
        return BRINK if is_coupled(arm, scene) else 0.0

    def prepared(
        self, problem: PlanningProblem, obstacles: Any, clearance: Any, self_clearance: Any
    ) -> PlanningProblem:
        """Return the problem with the environment; raise InputError for unsupported arguments."""
        return problem

    def constraints(self, problem: PlanningProblem) -> Constraints | None:
        """Return further constraints of the program, if any; see octoplan.planner.block."""
        return None

    def is_continuable(self, near: Scene, scene: Scene) -> bool:
        """Return whether a plan in the scene `near` may be continued in a scene."""
        return near == scene

    def adapted(self, problem: PlanningProblem, near: Plan) -> PlanningProblem:
        """Return the problem with the structure of the problem of a plan nearby."""
        return problem

    def plan_of(self, problem: PlanningProblem, solution: Solution) -> Plan:
        """Return the plan of a known solution, such as that of a saved plan."""
        return Plan.of(problem, solution)

    def plan(self, problem: PlanningProblem, near: Plan | None) -> Plan:
        """Return the plan of a problem whose targets also hold between stations.

        `Target.refined_along` adds stations if the settled arm violates the target there. The
        problem is then solved again from the tensions of the plan.
        """
        return self.between_stations(problem, self.solved(problem, near))

    def between_stations(self, problem: PlanningProblem, plan: Plan) -> Plan:
        """Return a plan whose targets also hold between stations, from a plan for the stations."""
        for _ in range(CORRECTIONS):
            if plan.solution.stopped or plan.mode != "exact":
                return plan
            refined = plan.targets
            with suppress(OctoplanError, OutOfTime):
                line = partial(_centreline, plan)
                refined = tuple(each.refined_along(line, problem.accuracy) for each in refined)
            if refined == plan.targets:
                return plan
            again = replace(problem, targets=refined)
            result = self.solve_from(again, plan)
            if result is None:
                plan = self.solved(again, plan)
            else:
                before = plan.solution
                kept = {name: getattr(before, name) for name in ("starts", "jump", "lost")}
                again = replace(again, environment=plan.problem.environment)
                plan = type(plan).of(again, replace(result, **kept))
        return plan

    def solved(self, problem: PlanningProblem, near: Plan | None) -> Plan:
        """Return the plan of a problem; raises OutOfTime if no tensions are found in time."""
        return Plan.of(problem, self.solve(problem, near))

    def solve(self, problem: PlanningProblem, near: Plan | None) -> Solution:
        """Return the solution of a problem, warm-started from a plan nearby if possible."""
        constraints = self.constraints(problem)
        result: Solution | None = None
        if near is not None:
            result = load(WARM_START)(near, problem, constraints)
        if result is None:
            result = self.with_jump(Search(problem, constraints).run(), near)
        return result

    def with_jump(self, result: Solution, near: Plan | None) -> Solution:
        """Return the result of a search with the change of the tensions from a plan nearby."""
        if near is None or result.stopped or result.options.mode != "exact":
            return result
        return replace(result, jump=load(JUMP)(near.tensions, result.tensions))

    def solve_from(self, problem: PlanningProblem, plan: Plan) -> Solution | None:
        """Return the solution that meets the targets near the tensions of a plan, if any."""
        problem = problem.at_base(plan.solution.base)
        constraints = self.constraints(problem)
        blocks = constraints.blocks(problem.arm) if constraints else ()
        stage = Multistart(problem, "exact", blocks=blocks)
        with suppress(OutOfTime):
            optimum = stage.solve_from(np.ravel(plan.tensions))
            fine = None if optimum is None else refine(optimum)
            return None if fine is None else fine.result(stage.trials, avoidance=constraints)
        return None


def _centreline(plan: Plan) -> Centreline:
    """Return the midline of the shape of a plan."""
    return plan.shape.centreline()


def strategy_of(problem: PlanningProblem, has_obstacles: bool) -> Strategy:
    """Return the strategy that targets and effects name, otherwise that of obstacles or none."""
    effects = (effect.plan_strategy for effect in problem.scene.effects)
    targets = (target.plan_strategy for target in problem.targets)
    name = next(filter(None, (*effects, *targets)), "avoidance" if has_obstacles else "")
    strategy: Strategy = load(STRATEGIES[name])() if name else Strategy()
    return strategy
