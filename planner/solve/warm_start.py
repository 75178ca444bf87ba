"""From a plan to that for a target nearby: the same program, warm, with unknowns and multipliers.

The numbers of a target are parameters of the program, so that an optimum moves with them and takes
its multipliers along; so it does with the minima of the tensions. Steps that are too long are
halved. What is followed is one optimum, not the best of all. Where its branch ends, as it may where
a target passes the arm's axis, the optimum beyond is another one, and the jump of the tensions is
told.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.equilibrium.linearised import Linearised
from model.errors import OctoplanError
from model.paths import Array
from model.time_limit import check_time
from planner.program.limits import Limits
from planner.program.problem import Bounds, Problem, units
from planner.program.statement import Statement
from planner.solve.ipopt import Solution
from planner.solve.refine import polish, refine, with_multipliers
from planner.solve.search_result import SearchResult, Trial
from planner.solve.task import Task, allowed
from planner.targets.base import Target

# By so much, over their norm, tensions may change from one target to the next; where more is asked
# of one step, smaller ones tell whether they jump.
_LITTLE = 0.25
_LEAST_STEP = 1 / 64
# What the stability of what is followed may lack.
_SLACK = 1e-5


@dataclass(frozen=True, eq=False)
class Optimum:
    """An optimum to begin with: for which targets and minima, how it was stated, what it is.

    `states` are those of its shape.
    """

    targets: tuple[Target, ...]
    lower: tuple[float, ...]
    statement: Statement
    tensions: Array
    lam_x: tuple[float, ...]
    lam_g: tuple[float, ...]
    states: Linearised | None = None


def warm_start(near: Optimum, task: Task) -> SearchResult | None:
    """Return the optimum for targets of the same structure, None where it cannot be followed.

    Minima of the tensions may be others; maxima are the same. It is also None where the optimum
    nearby does not reach its targets, and where this one is less stable than it has to be.
    """
    same = _structure(near.targets, task) == _structure(task.targets, task)
    if near.statement.mode != "exact" or not same:
        return None
    statement = near.statement.but(iterations=0)
    problem = task.problem(statement)
    before = allowed(task.arm, near.targets, task.limits)
    start = _solution(problem, near, before)
    moved = None if start is None else _moved(problem, start, near, task)
    if moved is None:
        return None
    found, apart = moved
    fine = refine(task, statement, found, polished=True)
    if fine is None:
        return None
    last = task.problem(fine.statement)
    margin, x = task.statement.margin, fine.solution.x
    if last.stability(x, fine.tensions) < (margin - _SLACK if margin else 0.0):
        return None
    return fine.result(task, (Trial(found.f, True, found.iterations),), apart)


def jump(before: Array, after: Array) -> float:
    """Return how far tensions are apart, over their larger norm; 0 where that is little."""
    size = max(float(np.linalg.norm(before)), float(np.linalg.norm(after)))
    apart = float(np.linalg.norm(np.ravel(after) - np.ravel(before)))
    return apart / size if apart > _LITTLE * size else 0.0


def _structure(targets: tuple[Target, ...], task: Task) -> tuple[object, ...]:
    return tuple((target.structure(task.arm), target.tendons(task.arm)) for target in targets)


def _solution(problem: Problem, near: Optimum, limits: Limits) -> Solution | None:
    """Return an optimum as one of the program, None if it is of another."""
    p, lam_g = problem.parameters(near.targets, limits), np.array(near.lam_g)
    lam_x = np.array(near.lam_x)
    if lam_x.size != problem.n_free or lam_g.size != problem.n_outer:
        return None
    try:
        x = problem.settled(np.ravel(near.tensions), limits, p, near.states)
        none = np.zeros(0)
        return with_multipliers(problem, Solution(x, lam_x, lam_g, 0, none, True, "", 0), x, p)
    except (OctoplanError, np.linalg.LinAlgError, RuntimeError):
        return None


def _moved(
    problem: Problem, start: Solution, near: Optimum, task: Task
) -> tuple[Solution, float] | None:
    """Return the optimum for a task, by steps in target numbers and minima from one nearby.

    And by how much the tensions jump, 0 where they change little by little.
    """
    limits, n = task.allowed, problem.arm.n_tendons
    first, last = (problem.parameters(which, limits) for which in (near.targets, task.targets))
    lbx, ubx, lbg, ubg = problem.bounds(limits)
    unit = units(problem.arm, limits)
    rise = np.zeros(lbx.size)
    rise[:n] = (np.array(limits.lower) - near.lower) / unit

    def at(share: float) -> tuple[Array, Bounds]:
        left = (1 - share) * rise
        upper = np.where(lbx == ubx, ubx - left, ubx)
        return first + share * (last - first), (lbx - left, upper, lbg, ubg)

    def stepped(step: float, most: float) -> Solution | None:
        """Follow by steps whose tensions change by no more than `most`; None where that ends."""
        here, share = start, 0.0
        while share < 1:
            check_time()
            trial = min(1.0, share + step)
            p, bounds = at(trial)
            found = polish(problem, here, p, bounds, warm=True)
            apart = float(np.linalg.norm((found.x - here.x)[:n] * unit))
            if found.met and found.finite and apart <= most:
                here, share, step = found, trial, 2 * step
            elif step <= _LEAST_STEP:
                return None
            else:
                step /= 2
        return here

    found = stepped(1.0, np.inf)
    if found is None:
        return None
    ends = [s.x[:n] * unit for s in (start, found)]
    apart = jump(*ends)
    if not apart:
        return found, 0.0
    kept = stepped(0.5, _LITTLE * max(float(np.linalg.norm(T)) for T in ends))
    return (found, apart) if kept is None else (kept, 0.0)
