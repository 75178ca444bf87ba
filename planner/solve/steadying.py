"""Shapes that stand, where what meets the targets with the least effort topples."""

from __future__ import annotations

import numpy as np

from model.paths import Array
from model.progress import told
from model.time_limit import check_time
from planner.program.problem import TRACES
from planner.program.statement import Mode, Statement
from planner.solve.ipopt import Solution, solve
from planner.solve.multistart import Multistart, record
from planner.solve.search_result import Trial
from planner.solve.task import Task

# Optima that do not stand from which one that does is looked for.
_STEADIED = 4
# By so much of the most that tendons of a section pull all of them are tightened where none stands.
_TIGHTENED = 0.5, 1.0, 2.0
# What the least stable mode is held to, more and more where the arm comes to another shape.
_FLOORS = 0.01, 0.1, 0.3


def tightened(trials: Multistart, statement: Statement, records: list[Trial]) -> list[Solution]:
    """Return optima that stand, from what topples with the other tendons tightened, too.

    Append records.
    """
    found = list[Solution]()
    for T in told("trials with all tendons tightened", _tighter(trials)):
        solution = trials.solve(statement, T)
        records.append(record(solution))
        if trials.stood(statement, solution):
            found.append(solution)
    return found


def steadied(trials: Multistart, mode: Mode, best: float) -> list[tuple[Task, Solution]]:
    """Return optima that stand, next to ones that do not and cost less than the best.

    With the least stable mode as an unknown, from the shape that is not stable enough, or else from
    one with all tendons tightened. Each comes with the task whose floor it is held to.
    """
    found = list[tuple[Task, Solution]]()
    different = {float(f"{item[1].f:.4g}"): item for item in trials.toppled}
    cheaper = [own for f, own in sorted(different.items()) if f < best][:_STEADIED]
    for before, toppled in cheaper:
        found += _held(trials, mode, before, toppled.x, best)
    if found or not cheaper:
        return found
    before, _ = cheaper[0]
    for T in _tighter(trials):
        _, x, _ = trials.stated(before, T)
        found += _held(trials, mode, before, x, best)
    return found


def _tighter(trials: Multistart) -> list[Array]:
    """Return the cheapest tensions that topple with all tendons pulled besides, if any do.

    Tendons that pull against each other stiffen an arm.
    """
    if not trials.toppled:
        return []
    _, cheapest = min(trials.toppled, key=lambda item: item[1].f)
    T, arm, allowed = trials.task.tensions(cheapest), trials.task.arm, trials.task.allowed
    section = np.array([i for i, _ in arm.tendons])
    most = np.array([T[section == i].max() for i in range(len(arm.sections))])[section]
    free = np.array(allowed.upper) > allowed.lower
    return [np.minimum(T + part * most * free, allowed.upper) for part in _TIGHTENED]


def _held(
    trials: Multistart, mode: Mode, before: Statement, x: Array, best: float
) -> list[tuple[Task, Solution]]:
    """Return the optimum held to its margin from unknowns x of a statement without, if any.

    To more of it where the arm does not come to that shape from rest; to no less than it has
    already.
    """
    T = trials.task.problem(before).tensions(x, trials.task.allowed)
    least = trials.task.problem(before).stability(x, T)
    for floor in _FLOORS:
        task = trials.task.held(floor)
        if task.statement.least <= least:
            continue
        statement = task.coarse(mode).but(refinement=before.refinement)
        problem, allowed = task.problem(statement), trials.task.allowed
        p = problem.parameters(task.targets, allowed, TRACES[0])
        start = problem.with_modes(trials.task.problem(before), x, allowed, p)
        if start is None:
            return []
        solution = solve(problem, start, p, problem.bounds(allowed))
        check_time()
        if not solution.met or solution.f >= best:
            return []
        if trials.stands(statement, solution):
            return [(task, solution)]
    return []
