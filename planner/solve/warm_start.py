"""From a plan to that for a target nearby: Newton's method on its optimality conditions.

The numbers of a target are parameters of the program, so that an optimum moves with them and takes
its multipliers along; so it does with the minima of the tensions. Steps that the active limits do
not survive go through ipopt, warm; steps that are too long are halved. What is followed is one
optimum, not the best of all. Where its branch ends, as it may where a target passes the arm's axis,
the optimum that is found beyond is another one, and the jump of the tensions is told.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.arm import Arm
from model.equilibrium.forward import Known as States
from model.errors import OctoplanError
from model.paths import Array
from model.scene import Scene
from planner.program.explicit import Explicit
from planner.program.limits import Limits
from planner.program.problem import Bounds, Problem, build, units
from planner.program.statement import Statement
from planner.settled import settled
from planner.solve.continuation import continuation
from planner.solve.ipopt import Solution
from planner.solve.newton import newton
from planner.solve.refine import solve_again
from planner.solve.search_result import SearchResult, Trial
from planner.solve.sqp import solve_quadratic
from planner.solve.task import allowed
from planner.targets.base import Target

# By so much, over their norm, tensions may change from one target to the next; where more is asked
# of one step, smaller ones tell whether they jump.
_LITTLE = 0.25
# What the stability of what is followed may lack.
_SLACK = 1e-5


@dataclass(frozen=True, eq=False)
class Known:
    """An optimum that was found: for which targets and minima, how it was stated, what it is.

    `states` are those of its shape.
    """

    targets: tuple[Target, ...]
    lower: tuple[float, ...]
    statement: Statement
    tensions: Array
    lam_x: tuple[float, ...]
    lam_g: tuple[float, ...]
    states: States | None = None


def warm_start(
    known: Known,
    arm: Arm,
    scene: Scene,
    targets: tuple[Target, ...],
    limits: Limits,
    accuracy: float,
    machine_code: bool = False,
) -> SearchResult | None:
    """Return the optimum for targets of the same structure, None where it cannot be followed.

    Minima of the tensions may be others; maxima are the same. It is also None where the known plan
    did not reach its targets, and where the optimum is less stable than it has to be.
    """
    if known.statement.mode != "exact" or _structure(arm, known.targets) != _structure(
        arm, targets
    ):
        return None
    limits = allowed(arm, targets, limits)
    problem = build(arm, targets, scene, known.statement, machine_code)
    problem.condensed.forget(known.states)
    start = _solution(problem, known, limits)
    moved = None if start is None else _moved(problem, start, known, targets, limits)
    if moved is None:
        return None
    found: Solution | None
    found, apart = moved
    statement, states = _fine_enough(problem, found, limits, accuracy)
    if statement != known.statement:
        problem = build(arm, targets, scene, statement, machine_code)
        p, bounds = problem.parameters(targets, limits), problem.free_bounds(limits)
        found = _near(problem, found, p, bounds, limits)
        if found is None:
            return None
    T = problem.tensions(found.x, limits)
    if not statement.margin:
        stands = problem.condensed.stands
    else:
        stands = problem.stability(found.x, T, states) >= statement.margin - _SLACK
    if not stands:
        return None
    return SearchResult(
        statement,
        arm.by_section(T),
        tuple(found.lam_x.tolist()),
        tuple(found.lam_g.tolist()),
        (Trial(found.f, True, found.iterations),),
        jump=apart,
    )


def jump(before: Array, after: Array) -> float:
    """Return how far tensions are apart, over their larger norm; 0 where that is little."""
    size = max(float(np.linalg.norm(before)), float(np.linalg.norm(after)))
    apart = float(np.linalg.norm(np.ravel(after) - np.ravel(before)))
    return apart / size if apart > _LITTLE * size else 0.0


def _structure(arm: Arm, targets: tuple[Target, ...]) -> tuple[object, ...]:
    return tuple((target.structure(arm), target.tendons(arm)) for target in targets)


def _solution(problem: Problem, known: Known, limits: Limits) -> Solution | None:
    """Return the known optimum as one of the program, None if it is of another."""
    p = problem.parameters(known.targets, limits)
    x = problem.free(np.ravel(known.tensions), limits)
    lam_x, lam_g = np.array(known.lam_x)[: x.size], np.array(known.lam_g)
    try:
        f, g = problem.condensed.value(problem.condensed.lifted(x, p), p)
    except OctoplanError:
        return None
    if lam_x.shape != x.shape or lam_g.size < g.size:
        return None
    return Solution(x, lam_x, lam_g[: g.size], f, g, True, "", 0)


def _moved(
    problem: Problem, start: Solution, known: Known, targets: tuple[Target, ...], limits: Limits
) -> tuple[Solution, float] | None:
    """Return the optimum for targets and limits, by steps in target numbers and minima.

    And by how much the tensions jump, 0 where they change little by little. Where the first way to
    it may have jumped, one by Newton's steps that change little is tried.
    """
    first, last = (problem.parameters(which, limits) for which in (known.targets, targets))
    lbx, ubx, lbg, ubg = problem.free_bounds(limits)
    rise, unit = np.zeros(start.x.size), units(problem.arm, limits)
    rise[: unit.size] = (np.array(limits.lower) - known.lower) / unit

    def asked(share: float) -> tuple[Array, Bounds]:
        left = (1 - share) * rise
        upper = np.where(lbx == ubx, ubx - left, ubx)
        return first + share * (last - first), (lbx - left, upper, lbg, ubg)

    found = continuation(start, lambda near, share: _near(problem, near, *asked(share), limits))
    if found is None:
        return None
    apart = jump(start.x[: unit.size] * unit, found.x[: unit.size] * unit)
    if not apart:
        return found, 0.0
    most = _LITTLE * max(np.linalg.norm(s.x[: unit.size] * unit) for s in (start, found))

    def little(near: Solution, share: float) -> Solution | None:
        there = newton(problem, near, *asked(share), lifted=True)
        apart = np.linalg.norm((there.x - near.x)[: unit.size] * unit)
        return None if there is near or apart > most else there

    problem.condensed.forget(known.states)
    kept = continuation(start, little, 0.5)
    if kept is None:
        return found, apart
    return replace(kept, f=problem.condensed.first(kept.x, last).f), 0.0


def _near(
    problem: Problem, start: Solution, p: Array, bounds: Bounds, limits: Limits
) -> Solution | None:
    """Return the optimum near a start by Newton's method, or else by ipopt; None without one."""
    found = newton(problem, start, p, bounds, lifted=True)
    if found is not start:
        return found
    begin = _stepped(problem, start, p, bounds)
    found = newton(problem, begin, p, bounds)
    if found is begin:
        solved = solve_again(problem, start, p, limits)
        found = newton(problem, solved, p, bounds) if solved.met and solved.finite else begin
        if found is begin or found is solved:
            return None
    return found


def _stepped(problem: Problem, start: Solution, p: Array, bounds: Bounds) -> Solution:
    """Return a start brought near the optimum by quadratic programs, where there are states.

    These follow, linearised; Newton's method in the tensions alone settles the arm at each step.
    """
    if isinstance(problem.condensed, Explicit):
        return start
    try:
        x = problem.condensed.lifted(start.x, p)
        solved = solve_quadratic(problem, x, p, bounds, start.lam_g)
    except OctoplanError:
        return start
    if solved is None or not solved.met:
        return start
    problem.condensed.begin_at(solved.x, p)
    return solved.free(problem)


def _fine_enough(
    problem: Problem, found: Solution, limits: Limits, accuracy: float
) -> tuple[Statement, States | None]:
    """Return the statement, on a finer mesh if the accuracy asks for one at the new optimum.

    And the states of the shape there.
    """
    statement, T = problem.statement, problem.tensions(found.x, limits)
    try:
        shape = settled(problem.arm, T, problem.scene, accuracy, problem.machine_code)
    except OctoplanError:
        return statement, None
    return statement.but(refinement=max(shape.refinement, statement.refinement)), shape.known
