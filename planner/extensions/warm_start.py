"""From a plan to that for a target nearby: the same program, warm, with unknowns and multipliers.

The numbers of a target are parameters of the program, so that an optimum moves with them and takes
its multipliers along; so it does with the minima of the tensions. Steps that are too long are
halved. What is followed is one optimum, not the best of all. Where its branch ends, as it may where
a target passes the arm's axis, the optimum beyond is another one, and the jump of the tensions is
told.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from octoplan.model.paths import Array
from octoplan.model.support.progress import OutOfTime, check_time
from octoplan.planner.extensions.avoidance.rows import ClearanceConstraints
from octoplan.planner.nlp_solution import STABILITY_TOLERANCE, NlpSolution
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.problem import Problem
from octoplan.planner.solution import Solution, Trial
from octoplan.planner.solve.refine import PART, polish, refine

# By so much, over their norm, tensions may change from one target to the next; where more is asked
# of one step, smaller ones tell whether they jump.
_LITTLE = 0.25
_LEAST_STEP = 1 / 64


def warm_start(
    near: Plan, task: PlanningProblem, avoidance: ClearanceConstraints | None = None
) -> Solution | None:
    """Return the optimum that a plan leads to, None where it cannot be followed.

    Its targets are of the same structure as the task's. Minima of the tensions may be others;
    maxima are the same. It is also None where the plan does not reach its targets, and where the
    optimum is less stable than it has to be.
    """
    arm, limits, margin = task.arm, task.limits, task.options.margin
    before, after = near.problem.target_set, task.target_set
    is_alike = (
        near.problem.options.mode == "exact"
        and near.problem.options.norm == task.options.norm
        and near.problem.options.margin == margin
        and replace(near.problem.limits, lower=limits.lower) == limits
        and near.solution.avoidance == avoidance
        and before.stations == after.stations
        and before.terms == after.terms
        and before.tendons == after.tendons
    )
    if not is_alike:
        return None
    try:
        continued = _continued(near, task, avoidance)
        if continued is None:
            return None
        optimum, apart = continued
        fine = refine(optimum)
        if fine is None or not fine.problem.is_stable(
            fine.x, margin and margin - STABILITY_TOLERANCE / PART
        ):
            return None
        trials = (Trial(optimum.f, True, optimum.iterations),)
        return fine.result(trials, jump=apart, avoidance=avoidance)
    except OutOfTime:
        T = np.clip(np.ravel(near.tensions), limits.lower, limits.upper)
        return Solution(near.problem.options, arm.by_section(T), (), (), (), stopped=True)


def jump(before: Array, after: Array, *others: Array) -> float:
    """Return how far tensions are apart, over the largest norm; 0 where that is little.

    Others count by their norms alone.
    """
    size = max(float(np.linalg.norm(T)) for T in (before, after, *others))
    apart = float(np.linalg.norm(np.ravel(after) - np.ravel(before)))
    return apart / size if apart > _LITTLE * size else 0.0


def _continued(
    near: Plan, task: PlanningProblem, avoidance: ClearanceConstraints | None
) -> tuple[NlpSolution, float] | None:
    """Return the optimum for a task, by steps in target numbers and minima from one nearby.

    By the defect of that; and by how much the tensions jump, 0 where they change little by little.
    """
    blocks = avoidance.blocks(task.arm) if avoidance else ()
    origin, problem = near.optimum, Problem(task, near.problem.options, blocks)
    n = task.arm.n_tendons
    if origin is None:
        return None
    begin = current = replace(origin.with_adjoint(), problem=problem)
    first, last = (of.parameters(defect=origin.defect) for of in (origin.problem, problem))
    lbx, ubx, lbg, ubg = problem.bounds
    rise = np.zeros(lbx.size)
    rise[:n] = (np.array(problem.limits.lower) - near.problem.limits.lower) / problem.unit
    fraction, step, left = 0.0, 1.0, False
    while fraction < 1:
        check_time()
        trial = min(1.0, fraction + step)
        p, lag = first + trial * (last - first), (1 - trial) * rise
        bounds = lbx - lag, np.where(lbx == ubx, ubx - lag, ubx), lbg, ubg
        following = polish(current, p, bounds, warm=True)
        jumps = jump(current.tensions, following.tensions, begin.tensions) > 0
        if following.converged and (step <= _LEAST_STEP or not jumps):
            left |= jumps
            current, fraction, step = following, trial, 2 * step
        elif step <= _LEAST_STEP:
            return None
        else:
            step /= 2
    return current, jump(begin.tensions, current.tensions) if left else 0.0
