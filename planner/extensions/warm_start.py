"""Warm starts: continue the optimum of a plan to the target of another problem.

The numbers of a target are parameters of the program. Unknowns and multipliers of an optimum change
continuously with these parameters, and with the smallest tensions. Steps that are too long are
halved. The result is the optimum of this branch, not the best of all. A branch may end, for example
if a target passes the arm's axis. Then the optimum belongs to another branch, and the solution
records the jump of the tensions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from octoplan.model.paths import Array
from octoplan.model.support.progress import OutOfTime, check_time
from octoplan.planner.block import Constraints
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.program_instance import ProgramInstance
from octoplan.planner.solution import STABILITY_TOLERANCE, NlpSolution, Solution, Trial
from octoplan.planner.solve.refine import SAFETY_FACTOR, polish, refine

# Relative change of the tensions per step above which the step is halved to detect a jump.
_LITTLE = 0.25
# Smallest step, as a share of the change of the parameters.
_LEAST_STEP = 1 / 64


def warm_start(
    near: Plan, problem: PlanningProblem, avoidance: Constraints | None = None
) -> Solution | None:
    """Return the optimum to which the optimum of a plan continues, or None.

    The targets of both problems need the same structure, and the limits may differ in the smallest
    tensions only. None as well if the plan does not reach its targets, if the continuation fails,
    or if its optimum is less stable than the margin.
    """
    problem = problem.at_base(near.solution.base)
    arm, limits, margin = problem.arm, problem.limits, problem.options.margin
    before, after = near.problem.target_set, problem.target_set
    is_alike = (
        near.problem.options.mode == "exact"
        and near.problem.options.norm == problem.options.norm
        and near.problem.options.margin == margin
        and replace(near.problem.limits, lower=limits.lower) == limits
        and near.solution.avoidance == avoidance
        and near.placed.placement == problem.placement
        and before.stations == after.stations
        and before.terms == after.terms
        and before.tendons == after.tendons
    )
    if not is_alike:
        return None
    try:
        continued = _continued(near, problem, avoidance)
        if continued is None:
            return None
        optimum, apart = continued
        fine = refine(optimum)
        if fine is None or not fine.instance.is_stable(
            fine.x, margin and margin - STABILITY_TOLERANCE / SAFETY_FACTOR
        ):
            return None
        trials = (Trial(optimum.f, True, optimum.iterations),)
        return fine.result(trials, jump=apart, avoidance=avoidance)
    except OutOfTime:
        T = np.clip(np.ravel(near.tensions), limits.lower, limits.upper)
        T = arm.by_section(T)
        base = near.solution.base
        return Solution(near.problem.options, T, (), (), (), stopped=True, base=base)


def jump(before: Array, after: Array, *others: Array) -> float:
    """Return the change of the tensions over the largest norm; 0 if the change is small.

    Only the norms of the `others` enter.
    """
    size = max(float(np.linalg.norm(T)) for T in (before, after, *others))
    apart = float(np.linalg.norm(np.ravel(after) - np.ravel(before)))
    return apart / size if apart > _LITTLE * size else 0.0


def _continued(
    near: Plan, problem: PlanningProblem, avoidance: Constraints | None
) -> tuple[NlpSolution, float] | None:
    """Return the continued optimum and its jump, by steps in parameters and smallest tensions.

    The defect is that of the plan. The jump is 0 if the tensions change continuously. None if a
    step fails.
    """
    blocks = avoidance.blocks(problem.arm) if avoidance else ()
    origin = near.optimum
    n = problem.arm.n_tendons
    if origin is None:
        return None
    # The clamp of a moving base is a parameter: both problems have the same one.
    at_origin = problem.at_base(origin.instance.problem.base_joints)
    instance = ProgramInstance(at_origin, near.problem.options, blocks)
    begin = current = replace(origin.with_adjoint(), instance=instance)
    first, last = (of.parameters(defect=origin.defect) for of in (origin.instance, instance))
    lbx, ubx, lbg, ubg = instance.bounds
    rise = np.zeros(lbx.size)
    rise[:n] = (np.array(instance.limits.lower) - near.problem.limits.lower) / instance.unit
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
