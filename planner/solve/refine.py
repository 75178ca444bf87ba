"""From an optimum of a coarse mesh to one whose settled shape is as accurate as asked, warm.

The mesh's defect is corrected for, see planner.program.defect; only where it is large the mesh is
made finer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects import Friction
from model.equilibrium.forward import STAGES, collocation_order
from model.errors import OctoplanError
from model.mesh import next_refinement
from model.paths import Array
from model.shape import Shape
from model.time_limit import check_time
from planner.program.defect import defect, size
from planner.program.optimality import multipliers
from planner.program.problem import Bounds, Problem
from planner.program.statement import Statement
from planner.settled import settled
from planner.solve.ipopt import MAGNIFIED, Solution, solve
from planner.solve.search_result import SearchResult, Trial
from planner.solve.task import Task

# Corrections and meshes that are tried; the part of the accuracy that a defect may be off by, and
# what rounding leaves of it.
_CORRECTIONS, _SHARE, _ROUNDING = 8, 100, 1e-12
# Defects above this, over L, ask for a finer mesh; what is farther off comes to another shape.
_ROUGH, _ELSEWHERE = 1e-3, 0.1
# How often bounds that turn out not to hold are let go.
_RELEASED = 4


@dataclass(frozen=True, eq=False)
class Refined:
    """An optimum that is corrected for its mesh's defect, and the shape that the arm comes to.

    That is from rest.
    """

    statement: Statement
    solution: Solution
    tensions: Array
    shape: Shape

    def result(self, task: Task, trials: tuple[Trial, ...], jump: float = 0.0) -> SearchResult:
        """Return what a search ends with."""
        free = self.solution.free(task.problem(self.statement))
        lam_x, lam_g = tuple(free.lam_x.tolist()), tuple(free.lam_g.tolist())
        tensions = task.arm.by_section(self.tensions)
        return SearchResult(self.statement, tensions, lam_x, lam_g, trials, jump=jump)


def refine(
    task: Task, statement: Statement, solution: Solution, known: Array | None = None
) -> Refined | None:
    """Return the optimum whose settled shape is what its program measures, to the last digits.

    To a part of the accuracy. None where the optimum is lost on the way, and where the arm comes to
    another shape from rest. A solution that is polished already comes with the defect that is
    `known` to its program.
    """
    try:
        return _refined(task, statement, solution, known)
    except (OctoplanError, np.linalg.LinAlgError):
        return None


def _refined(
    task: Task, statement: Statement, solution: Solution, known: Array | None
) -> Refined | None:
    """Return what refine does; raises where the arm does not settle, and where it buckles."""
    for _ in range(_CORRECTIONS):
        check_time()
        problem = task.problem(statement)
        T = problem.tensions(solution.x, task.allowed)
        shape = settled(task.arm, T, task.scene, task.accuracy, task.machine_code)
        found = defect(problem, solution.x, task.targets, shape)
        if known is not None and size(problem, found - known) <= max(
            task.accuracy / _SHARE, _ROUNDING
        ):
            stated = statement.but(solver=solution.solver, iterations=solution.iterations)
            return Refined(stated, solution, T, shape)
        rough = size(problem, found)
        if not rough <= _ELSEWHERE:
            return None
        known = found
        if rough > _ROUGH:
            order = collocation_order(STAGES, task.scene.has(Friction))
            finer = next_refinement(statement.refinement, rough, _ROUGH, order)
            if not finer:
                return None
            statement = statement.but(refinement=finer)
            solution = carried(task, problem, statement, solution)
            problem = task.problem(statement)
            known = defect(problem, solution.x, task.targets, shape)
        p, bounds = task.parameters(statement, defect=known), task.bounds(statement)
        solution = polish(problem, solution, p, bounds)
        if not (solution.met and solution.finite):
            return None
    return None


def carried(task: Task, problem: Problem, statement: Statement, solution: Solution) -> Solution:
    """Return a solution as a guess on another mesh, with its multipliers."""
    other, p = task.problem(statement), task.parameters(statement)
    x = other.carried(solution.x, problem, task.allowed, p)
    return with_multipliers(other, replace(solution, x=x).free(problem), x, p)


def with_multipliers(problem: Problem, free: Solution, x: Array, p: Array) -> Solution:
    """Return unknowns x with the multipliers that a solution without states has."""
    lam_g, _ = multipliers(problem, problem.program.evaluate(x, p), free.lam_g)
    lam_x = np.concatenate([free.lam_x, np.zeros(x.size - problem.n_free)])
    return replace(free, x=x, lam_x=lam_x, lam_g=lam_g)


def polish(
    problem: Problem, solution: Solution, p: Array, bounds: Bounds, warm: bool = False
) -> Solution:
    """Return the optimum to the last digits: tensions at their bounds are there exactly.

    An interior-point method stops a little inside of them. Those whose multipliers exceed their
    distance are fixed there, and the program is solved once more, warm; multipliers of the wrong
    sign tell which are let go again. All are where too few are left to meet the targets; where even
    that leads nowhere it is solved afresh, unless the start is to stay `warm`, and if that fails
    the last optimum is kept.
    """
    n = problem.arm.n_tendons
    lbx, ubx, lbg, ubg = bounds
    x, pull = solution.x[:n], solution.lam_x[:n] * MAGNIFIED
    at_low, at_high = x - lbx[:n] < -pull, ubx[:n] - x < pull
    even, begun = lbx[:n] == ubx[:n], solution
    for _ in range(_RELEASED):
        low, high = lbx.copy(), ubx.copy()
        high[:n] = np.where(at_low, lbx[:n], ubx[:n])
        low[:n] = np.where(at_high & ~at_low, ubx[:n], lbx[:n])
        guess = np.clip(solution.x, low, high)
        lam = solution.lam_x, solution.lam_g
        found = solve(problem, guess, p, (low, high, lbg, ubg), lam, "polish")
        if not (found.met and found.finite):
            if not (at_low | at_high).any():
                last = found if warm else solve(problem, solution.x, p, bounds)
                return last if last.met or solution is begun else solution
            at_low[:] = at_high[:] = False
            continue
        held = at_low | at_high | even
        _, slope = multipliers(
            problem, problem.program.evaluate(found.x, p), found.lam_g[: problem.n_outer]
        )
        lam_x = found.lam_x.copy()
        lam_x[:n] = np.where(held, -slope[:n], lam_x[:n])
        count = solution.iterations + found.iterations
        solution = replace(found, lam_x=lam_x, iterations=count, solver=solution.solver)
        wrong = ~even & ((at_low & (lam_x[:n] > 0)) | (at_high & (lam_x[:n] < 0)))
        if not wrong.any():
            break
        at_low, at_high = at_low & ~wrong, at_high & ~wrong
    return solution
