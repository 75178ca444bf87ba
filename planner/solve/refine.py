"""From an optimum of a coarse mesh to that of a mesh as fine as the accuracy asks for, warm."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects import Friction
from model.equilibrium.forward import STAGES, collocation_order
from model.errors import OctoplanError
from model.mesh_refinement import next_refinement
from model.paths import Array
from model.shape import Shape
from model.time_limit import check_time
from planner.measure import compliances_along, measure
from planner.program.optimality import multipliers
from planner.program.problem import Bounds, Problem
from planner.program.statement import Statement
from planner.program.terms import stations_of
from planner.settled import settled
from planner.solve.ipopt import MAGNIFIED, Solution, solve
from planner.solve.search_result import SearchResult, Trial
from planner.solve.task import Task

# Meshes that are tried; the part of the accuracy that a plan's mesh may take, and the part that a
# finer one is chosen for.
_MESHES, _SHARE, _AIM = 8, 4, 100
# What targets measure of the arm from rest is no farther off, or it comes to another shape.
_ELSEWHERE = 0.1
# How often bounds that turn out not to hold are let go.
_RELEASED = 4


@dataclass(frozen=True, eq=False)
class Refined:
    """An optimum on a mesh that is fine enough, and the shape that the arm comes to from rest."""

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
    task: Task, statement: Statement, solution: Solution, polished: bool = False
) -> Refined | None:
    """Return the optimum on a mesh that is fine enough, to the last digits.

    What targets measure on it is that of the settled shape, to a part of the accuracy. None where
    the optimum is lost on a finer mesh, and where the arm comes to another shape from rest. What is
    `polished` already is not once more, on a mesh that is fine enough.
    """
    fine = task.accuracy / _SHARE
    for _ in range(_MESHES):
        check_time()
        problem = task.problem(statement)
        T = problem.tensions(solution.x, task.allowed)
        try:
            shape = settled(task.arm, T, task.scene, task.accuracy, task.machine_code)
            gap = _apart(task, problem, solution.x, shape)
        except (OctoplanError, np.linalg.LinAlgError):
            return None
        if gap <= fine and polished:
            found = statement.but(solver="ipopt", iterations=solution.iterations)
            return Refined(found, solution, T, shape)
        if not gap <= _ELSEWHERE:
            return None
        if gap > fine:
            order, aim = collocation_order(STAGES, task.scene.has(Friction)), task.accuracy / _AIM
            finer = next_refinement(statement.refinement, gap, aim, order)
            if not finer:
                return None
            statement = statement.but(refinement=finer)
            solution = carried(task, problem, statement, solution)
        p, bounds = task.parameters(statement), task.bounds(statement)
        solution, polished = polish(task.problem(statement), solution, p, bounds), True
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
    lam_g, _ = multipliers(problem, x, p, free.lam_g)
    lam_x = np.concatenate([free.lam_x, np.zeros(x.size - problem.n_free)])
    return replace(free, x=x, lam_x=lam_x, lam_g=lam_g)


def polish(
    problem: Problem, solution: Solution, p: Array, bounds: Bounds, warm: bool = False
) -> Solution:
    """Return the optimum to the last digits: tensions at their bounds are there exactly.

    An interior-point method stops a little inside of them. Those whose multipliers exceed their
    distance are fixed there, and the program is solved once more, warm; multipliers of the wrong
    sign tell which are let go again. All are where too few are left to meet the targets; where even
    that leads nowhere it is solved afresh, unless the start is to stay `warm`.
    """
    n = problem.arm.n_tendons
    lbx, ubx, lbg, ubg = bounds
    x, lam = solution.x[:n], solution.lam_x[:n] * MAGNIFIED
    at_low, at_high = x - lbx[:n] < -lam, ubx[:n] - x < lam
    even = lbx[:n] == ubx[:n]
    for _ in range(_RELEASED):
        low, high = lbx.copy(), ubx.copy()
        high[:n] = np.where(at_low, lbx[:n], ubx[:n])
        low[:n] = np.where(at_high & ~at_low, ubx[:n], lbx[:n])
        guess = np.clip(solution.x, low, high)
        found = solve(problem, guess, p, (low, high, lbg, ubg), (solution.lam_x, solution.lam_g))
        if not (found.met and found.finite):
            if not (at_low | at_high).any():
                return found if warm else solve(problem, solution.x, p, bounds)
            at_low[:] = at_high[:] = False
            continue
        held = at_low | at_high | even
        _, slope = multipliers(problem, found.x, p, found.lam_g[: problem.n_outer])
        lam_x = found.lam_x.copy()
        lam_x[:n] = np.where(held, -slope[:n], lam_x[:n])
        solution = replace(found, lam_x=lam_x, iterations=solution.iterations + found.iterations)
        wrong = ~even & ((at_low & (lam_x[:n] > 0)) | (at_high & (lam_x[:n] < 0)))
        if not wrong.any():
            break
        at_low, at_high = at_low & ~wrong, at_high & ~wrong
    return solution


def _apart(task: Task, problem: Problem, x: Array, shape: Shape) -> float:
    """Return how far what targets measure in unknowns x is from what they do of a shape."""
    arm, targets = task.arm, task.targets
    stations = np.array(stations_of(arm, targets))
    directions = problem.directions(task.targets)
    here = measure(arm, targets, problem.poses(x), problem.compliances(x, directions))
    there = measure(arm, targets, shape.poses(stations), compliances_along(arm, targets, shape))
    pairs = ((a[name], b[name]) for a, b in zip(here, there, strict=True) for name in a)
    return max((float(np.abs(a - b).max(initial=0.0)) for a, b in pairs), default=0.0)
