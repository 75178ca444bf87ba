"""From a plan to that for a target nearby: Newton's method on its optimality conditions.

The numbers of a target are parameters of the program, so that an optimum moves with them and takes
its multipliers along; so it does with the minima of the tensions. Steps that the active limits do
not survive go through ipopt, warm; steps that are too long are halved. What is followed is one
optimum, not the best of all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.arm import Arm
from model.errors import OctoplanError
from model.paths import Array
from model.scene import Scene
from model.settle import settle
from planner.program.limits import Limits
from planner.program.problem import Bounds, Problem, build, units
from planner.program.statement import Statement
from planner.solve.finish import solve_again
from planner.solve.found import Found, Start
from planner.solve.ipopt import Solution
from planner.solve.polish import polish
from planner.solve.task import allowed
from planner.solve.walk import walk
from planner.targets.base import Target


@dataclass(frozen=True, eq=False)
class Known:
    """An optimum that was found: for which targets and minima, how it was stated, what it is."""

    targets: tuple[Target, ...]
    lower: tuple[float, ...]
    statement: Statement
    tensions: Array
    lam_x: tuple[float, ...]
    lam_g: tuple[float, ...]


def follow(
    known: Known,
    arm: Arm,
    scene: Scene,
    targets: tuple[Target, ...],
    limits: Limits,
    accuracy: float,
    machine_code: bool = False,
) -> Found | None:
    """Return the optimum for targets of the same structure, None where it cannot be followed.

    Minima of the tensions may be others; maxima are the same. It is also None where the known plan
    did not reach its targets.
    """
    if known.statement.mode != "exact" or _structure(arm, known.targets) != _structure(
        arm, targets
    ):
        return None
    limits = allowed(arm, targets, limits)
    problem = build(arm, targets, scene, known.statement, machine_code)
    problem.condensed.forget()
    start = _solution(problem, known, limits)
    found = None if start is None else _moved(problem, start, known, targets, limits)
    if found is None:
        return None
    statement = _fine_enough(problem, found, limits, accuracy)
    if statement != known.statement:
        problem = build(arm, targets, scene, statement, machine_code)
        p, bounds = problem.parameters(targets, limits), problem.free_bounds(limits)
        found = _near(problem, found, p, bounds, limits)
        if found is None:
            return None
    return Found(
        statement,
        arm.by_section(problem.tensions(found.x, limits)),
        tuple(found.lam_x.tolist()),
        tuple(found.lam_g.tolist()),
        (Start(found.f, True, found.iterations),),
    )


def _structure(arm: Arm, targets: tuple[Target, ...]) -> tuple[object, ...]:
    return tuple((target.structure(arm), target.tendons(arm)) for target in targets)


def _solution(problem: Problem, known: Known, limits: Limits) -> Solution | None:
    """Return the known optimum as one of the program, None if it is of another."""
    p = problem.parameters(known.targets, limits)
    x = problem.free(np.ravel(known.tensions), limits)
    lam_x, lam_g = np.array(known.lam_x)[: x.size], np.array(known.lam_g)
    f, _, g, _ = problem.condensed.first(x, p)
    if lam_x.shape != x.shape or lam_g.size < g.size:
        return None
    return Solution(x, lam_x, lam_g[: g.size], f, g, True, "", 0)


def _moved(
    problem: Problem, start: Solution, known: Known, targets: tuple[Target, ...], limits: Limits
) -> Solution | None:
    """Return the optimum for targets and limits, by steps in target numbers and minima."""
    first, last = (problem.parameters(which, limits) for which in (known.targets, targets))
    lbx, ubx, lbg, ubg = problem.free_bounds(limits)
    rise, unit = np.zeros(start.x.size), units(problem.arm, limits)
    rise[: unit.size] = (np.array(limits.lower) - known.lower) / unit

    def at(near: Solution, share: float) -> Solution | None:
        left = (1 - share) * rise
        upper = np.where(lbx == ubx, ubx - left, ubx)
        p = first + share * (last - first)
        return _near(problem, near, p, (lbx - left, upper, lbg, ubg), limits)

    return walk(start, at)


def _near(
    problem: Problem, start: Solution, p: Array, bounds: Bounds, limits: Limits
) -> Solution | None:
    """Return the optimum near a start by Newton's method, or else by ipopt; None without one."""
    found = polish(problem, start, p, bounds)
    if found is start:
        solved = solve_again(problem, start, p, limits)
        found = polish(problem, solved, p, bounds) if solved.met and solved.finite else start
        if found is start or found is solved:
            return None
    return replace(found, f=problem.condensed.first(found.x, p).f)


def _fine_enough(problem: Problem, found: Solution, limits: Limits, accuracy: float) -> Statement:
    """Return the statement, on a finer mesh if the accuracy asks for one at the new optimum."""
    statement, asked = problem.statement, (problem.scene, accuracy / 10)
    try:
        T = problem.tensions(found.x, limits)
        mesh = settle(problem.arm, T, *asked, compile=problem.machine_code).refinement
    except OctoplanError:
        return statement
    return statement.but(refinement=max(mesh, statement.refinement))
