"""Solving a task on the coarse mesh from one start after another, and what is known by then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from model.loads import is_loaded
from model.paths import Array
from model.progress import told
from model.time_limit import check_time
from planner.program.collocated import moved_at_rest
from planner.program.problem import TRACES, Problem
from planner.program.statement import Mode, Statement
from planner.program.terms import compliance_requests
from planner.solve.continuation import continued_targets
from planner.solve.ipopt import Solution, solve
from planner.solve.search_result import Trial, agreed
from planner.solve.sqp import solve_quadratic
from planner.solve.task import Task

# Starts before agreement counts: five do for points, more where optima are many and close.
_FEW, _MORE = 5, 8
# Enough where least squares over more numbers than there are tendons come to nothing: that fixes
# the shape, and with it the tensions.
_FIXED, _NOTHING = 3, 1e-6
# Other scenes than the paper's start from its optima, among which the search was; loaded arms from
# two more before it is said that none of the starts meets the targets.
_FEWEST, _STRONGER, _CARRIED = 2, 2, 1
# Loads that move the tip farther, over the arm's length, as it is planned or at rest, ask for as
# many starts as agree: those that bend an arm at rest by most of its length may reach for it.
_HEAVY, _HEAVY_AT_REST, _MORE_IF_HEAVY = 0.3, 0.75, 4
# Other statics that change the least effort squared by more than this may rank optima otherwise.
_MISLED = 0.3
# Tried besides the fits that meet what is wanted.
_BESIDE = 2
# Starts that ipopt takes on before it is left: where it meets nothing from so many, least squares
# tell sooner what can be had. Where a stiffness is wanted each costs as much as ten others, and
# quadratic programs tell at once how much of it can be had.
_IPOPT_TRIES, _IPOPT_TRIES_IF_STIFF = 6, 0
# How much of the effort the search for the stiffest shape sees: less is hard to tell from none.
_TRACE_IF_STIFF = 1e-3
# From so many starts at most: the stiffest shapes are few.
_MOST_IF_STIFF = 4
_INSIDE = 0.005
LITTLE = 1e-5
# What is told of how far trials are, by how the targets are read.
_PHASES: dict[Mode, str] = {
    "exact": "trials that meet the targets",
    "closest": "trials as near as the limits allow",
    "nearest": "the targets are out of reach, trials for the nearest shape",
}
# So many starts ipopt takes on though others are met: those that quadratic programs left with less
# effort, and so near to what is wanted.
_PROMISING, _CLOSE = 2, 0.05
# More stable than this an arm under light loads has one shape.
_FIRM = 0.5
# What a margin may lack.
_SLACK = 1e-3


class Multistart:
    """The solves of one task.

    Attributes
    ----------
    n_likely : int
        Among how many of the first starts the best optimum is, 0 where that is not known.
    carried : list of ((n_tendons,), Solution)
        Optima of a simpler scene to begin with, best first, without their states.
    ipopt_tries : int
        From how many starts ipopt may yet try in vain to meet the targets.
    seen : list of (Statement, Solution)
        Every solution with finite numbers, in order.
    toppled : list of (Statement, Solution)
        What meets the targets but is less stable than it has to be.
    standing : list of (Statement, Solution)
        What meets the targets and is as stable; starts that led to one of them are that solution.
    """

    def __init__(self, task: Task, n_likely: int = 0) -> None:
        self.task, self.n_likely = task, n_likely
        self.carried: list[tuple[Array, Solution]] = []
        self.seen: list[tuple[Statement, Solution]] = []
        self.toppled: list[tuple[Statement, Solution]] = []
        self.standing: list[tuple[Statement, Solution]] = []
        self.loaded = is_loaded(task.scene)
        self.simple = task.scene == task.simple.scene
        self.stiff = bool(compliance_requests(task.targets))
        self.ipopt_tries = _IPOPT_TRIES_IF_STIFF if self.stiff else _IPOPT_TRIES
        self.fewest = self.by_itself = _FEW if task.is_point else _MORE
        if not self.simple:
            self.fewest = _FEWEST if self.loaded else _CARRIED

    @cached_property
    def heavy(self) -> bool:
        """Whether loads move the initial guess's tip, or the rest's, so far that they mislead."""
        if not self.loaded or not self.carried:
            return self.loaded
        best, _ = self.carried[0]
        task, length = self.task, self.task.arm.length
        at_rest = (task.arm, task.scene, task.allowed.lower, task.machine_code)
        return (
            moved_at_rest(*at_rest) > _HEAVY_AT_REST * length
            or task.problem(task.coarse("exact")).moved_by_loads(best) > _HEAVY * length
        )

    @property
    def first(self) -> int:
        """How many starts are tried before it is said that none meets the targets."""
        if self.task.starts is not None:
            return self.task.starts
        heavier = (_MORE_IF_HEAVY if self.heavy else _STRONGER) if self.loaded else 0
        return max(self.fewest, self.n_likely) + heavier

    def _enough(self, mode: Mode, records: list[Trial], found: list[Solution]) -> bool:
        """Return whether the best optimum is among what was found, as far as can be told."""
        if self.task.starts is not None:
            return len(records) >= self.task.starts
        if self.stiff and mode == "closest":
            return bool(found) and (agreed(records) >= 2 or len(records) >= _MOST_IF_STIFF)
        if not self.task.can_be_exact and any(s.f <= _NOTHING for s in found):
            return len(records) >= _FIXED and agreed(records) >= 2
        if self.heavy:
            return len(records) >= self.first and agreed(records) >= 2
        misled = self._misled(found)
        if self.n_likely and not self.simple and not misled:
            return len(records) >= max(self.fewest, self.n_likely) and bool(found or self.toppled)
        if self.n_likely:
            fewest = self.by_itself if misled else self.fewest
            return len(records) >= max(fewest, self.n_likely + _BESIDE)
        return len(records) >= self.fewest and agreed(records) >= 2

    def _misled(self, found: list[Solution]) -> bool:
        """Return whether an arm without loads takes another effort than the simpler optima did."""
        if self.loaded or not self.carried or not found:
            return False
        before, now = self.carried[0][1].f, min(solution.f for solution in found)
        return abs(now - before) > _MISLED * before

    def from_starts(
        self,
        starts: list[Array],
        statement: Statement,
        records: list[Trial],
        before: Sequence[Solution] = (),
    ) -> list[Solution]:
        """Return what is met before and from each start, until that is enough; append records.

        By quadratic programs first: ipopt takes on what they leave where they meet nothing, and
        what may be better than all that they meet.
        """
        found, left = [*before], list[tuple[int, Array, Solution]]()
        exact = statement.mode == "exact"
        for T in told(_PHASES[statement.mode], starts):
            if self._enough(statement.mode, records, found):
                break
            solution = self.solve(statement, T, not exact and not found, found)
            records.append(record(solution))
            if self.stood(statement, solution):
                found.append(solution)
            elif exact and not solution.met:
                left.append((len(records) - 1, T, solution))
        promising = _PROMISING
        for place, T, solution in left:
            if found and (not promising or not self._is_promising(statement, solution, found)):
                continue
            if not found and self.ipopt_tries <= 0:
                break
            promising -= bool(found)
            better = self.solve(statement, T)
            self.ipopt_tries -= not found and not better.met
            records[place] = record(better)
            if self.stood(statement, better):
                found.append(better)
        return found

    def stood(self, statement: Statement, solution: Solution) -> bool:
        """Return whether a solution is met and stands; what topples is kept apart."""
        if not solution.met:
            return False
        for other, known in self.standing:
            if other == statement and known.x is solution.x:
                return True
        stands = self.stands(statement, solution)
        (self.standing if stands else self.toppled).append((statement, solution))
        return stands

    def _is_promising(
        self, statement: Statement, solution: Solution, found: list[Solution]
    ) -> bool:
        """Return whether a solution that does not meet the targets yet may be the best."""
        if statement.mode != "exact" or solution.met or not solution.finite:
            return False
        _, _, low, high = self.task.problem(statement).bounds(self.task.allowed)
        own = slice(0, solution.g.size)
        off = np.maximum(np.maximum(low[own] - solution.g, solution.g - high[own]), 0)
        return solution.f < min(s.f for s in found) and float(off.max(initial=0.0)) <= _CLOSE

    def stands(self, statement: Statement, solution: Solution) -> bool:
        """Return whether a solution is as stable as it has to be, and where the arm comes to.

        Under loads that move it far an arm may have several shapes that stand.
        """
        T, margin = self.task.tensions(solution), self.task.statement.margin
        problem = self.task.problem(statement)
        least = problem.stability(solution.x, T)
        if least < margin - _SLACK:
            return False
        alone = least > _FIRM and not self.heavy
        return alone or problem.is_from_rest(solution.x, T)

    def by_continuation(
        self, starts: list[Array], statement: Statement, records: list[Trial]
    ) -> list[Solution]:
        """Return the first optimum that a way from what a start attains leads to, if there is one.

        Records are made of it alone.
        """
        for T in told("continuation in the target", starts):
            problem, x, p = self.stated(statement, T)
            solution = continued_targets(problem, x, p, problem.bounds(self.task.allowed))
            if solution is not None:
                self.seen.append((statement, solution))
                records.append(record(solution))
                return [solution]
        return []

    def solve(
        self,
        statement: Statement,
        T: Array,
        by_ipopt: bool = True,
        found: Sequence[Solution] = (),
    ) -> Solution:
        """Return what tensions (n_tendons,) [N] lead to.

        What sequential quadratic programming does not meet soon, ipopt takes on if `by_ipopt`; what
        comes near to an optimum of the same statement that was found is taken for it.
        """
        known = next((s for own, s in self.carried if np.array_equal(own, T)), None)
        lam = None if known is None or statement.mode != "exact" else known.lam_g
        problem, x, p = self.stated(statement, T)
        bounds, free = problem.bounds(self.task.allowed), problem.free_bounds(self.task.allowed)
        lam = lam if lam is not None and lam.shape == free[2].shape else None
        if self.stiff and statement.mode == "closest":
            solution = self._stiffest(problem, x, p)
        else:
            solution = solve_quadratic(problem, x, p, free, lam, found)
        if solution is None or (by_ipopt and not solution.met):
            solution = solve(problem, x, p, bounds)
        if solution.finite:
            self.seen.append((statement, solution))
        check_time()
        return solution

    def _stiffest(self, problem: Problem, x: Array, p: Array) -> Solution | None:
        """Return what comes nearest to a stiffness, from unknowns x; see solve_quadratic."""
        task = self.task
        seen = problem.parameters(task.targets, task.allowed, _TRACE_IF_STIFF)
        found = solve_quadratic(problem, x, seen, problem.free_bounds(task.allowed))
        return found and replace(found, f=problem.condensed.value(found.x, p)[0])

    def stated(self, statement: Statement, T: Array) -> tuple[Problem, Array, Array]:
        """Return the program, its unknowns for tensions a little inside the limits, parameters."""
        task = self.task
        problem, limits = task.problem(statement), task.allowed
        p = problem.parameters(task.targets, limits, TRACES[0])
        bounds, x = problem.bounds(limits), problem.unknowns(T, limits, p)
        n = task.arm.n_tendons
        x[:n] = np.clip(np.maximum(x[:n], _INSIDE), bounds[0][:n], bounds[1][:n])
        return problem, x, p


def record(solution: Solution) -> Trial:
    """Return what is kept of a solution."""
    return Trial(solution.f, solution.met, solution.iterations)
