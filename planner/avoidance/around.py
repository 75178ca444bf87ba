"""Plans that keep clear: searched as if nothing was in the way, then led around what is.

Optima of the search that touch nothing are as good as before. Others get inequalities where they
come too near, and are solved again from where they are; that is repeated, with inequalities added
at new places, until none is violated in between either. Optima are tried by effort, until none
that is left can be better. Where none leads around, arms that reach the target in other ways are
tried, those first that are farther off, then arms that touch nothing and come near to the target;
from the latter the nearest shape that keeps clear is found where the target cannot be met.
"""

from __future__ import annotations

from dataclasses import replace
from time import monotonic

import numpy as np

from model.paths import Array
from model.progress import told
from model.time_limit import OutOfTime, time_limit
from planner.avoidance.asked import Surroundings
from planner.avoidance.clear import Clear, keeping, line_of
from planner.avoidance.other_starts import clear_arms, other_arms
from planner.avoidance.places import lasting, near_places, updated, watched_places
from planner.avoidance.rows import Avoidance
from planner.initial_guess.curled import distinct
from planner.program.statement import Mode, Statement
from planner.solve.ipopt import Solution
from planner.solve.multistart import Multistart, record
from planner.solve.refine import refine
from planner.solve.search import Search
from planner.solve.search_result import SearchResult, Trial
from planner.solve.steadying import steadied
from planner.solve.task import Task

# Optima that are led around, and those of other arms that are enough.
_OPTIMA, _ENOUGH = 8, 2
# Times that inequalities are added, on the coarse mesh and on the fine one.
_ADDED, _CORRECTED = 10, 6
# A place is clear that lacks so little of what is kept to spare.
_CLEAR = 0.6


class Around:
    """A planning question with surroundings; `searched` tells whether all starts were tried."""

    def __init__(self, task: Task, asked: Surroundings) -> None:
        self.task, self.asked = task, asked
        self.records: list[Trial] = []
        self.searched = False

    def run(
        self, seconds: float | None, near: SearchResult | None = None
    ) -> tuple[SearchResult, Avoidance | None]:
        """Return the best that keeps clear, and the inequalities of its program.

        Where a plan that is near is given, it is led around, and only if it cannot be is searched.
        """
        began = monotonic()
        if near is not None:
            led = self._near(near)
            if led is not None:
                return led
        search, self.searched = Search(self.task), True
        found = search.run(seconds)
        if found.stopped:
            return found, None
        T, problem = np.ravel(found.tensions), self.task.problem(found.statement)
        line = line_of(problem, T, self.task.accuracy, finished=True)
        if line is not None and self.asked.keeps(line):
            return found, None
        self.task = search.task
        try:
            with time_limit(seconds and max(seconds - (monotonic() - began), 1e-3)):
                return self._led(search, found)
        except OutOfTime:
            return replace(found, stopped=True), None

    def _near(self, near: SearchResult) -> tuple[SearchResult, Avoidance | None] | None:
        """Return a plan that keeps clear near one without surroundings."""
        T = np.ravel(near.tensions)
        problem = self.task.problem(near.statement)
        line = line_of(problem, T, self.task.accuracy, finished=True)
        if line is not None and self.asked.keeps(line):
            return near, None
        clear = self.coarse(T, "exact")
        return None if clear is None else self.fine(clear, "exact")

    def _led(self, search: Search, found: SearchResult) -> tuple[SearchResult, Avoidance | None]:
        """Return the best of what is led around."""
        mode = found.statement.mode
        own = [s for statement, s in search.trials.seen if statement.mode == mode and s.met]
        optima = [np.ravel(found.tensions)]
        optima += [self.task.tensions(s) for s in sorted(own, key=lambda s: s.f)]
        optima = distinct(optima, _OPTIMA)
        possible = mode == "nearest" or self.asked.allows(self.task.arm, self.task.targets)
        best = self._best(optima, mode, ordered=True) if possible else None
        if best is None and possible:
            best = self._best(other_arms(self.task, self.asked, self._enough), mode)
        clear = clear_arms(self.task, self.asked) if best is None else []
        if best is None and possible:
            best = self._best(clear, mode)
        if best is None and mode != "nearest":
            best = self._best([*clear, *optima[:1]], "nearest")
        return (found, None) if best is None else best

    def _best(
        self, starts: list[Array], mode: Mode, ordered: bool = False
    ) -> tuple[SearchResult, Avoidance | None] | None:
        """Return the best that is led around from starts; ordered ones are optima, by effort."""
        cleared: list[Clear] = []
        for T in told(f"around obstacles, {mode}", starts):
            least = min((clear.solution.f for clear in cleared), default=np.inf)
            if ordered and mode == "exact" and self._effort(T) > least:
                break
            clear = self.coarse(T, mode)
            if clear is not None:
                cleared.append(clear)
            if not ordered and len(cleared) >= _ENOUGH:
                break
        # What the solver did not come to an end with may look better than it is.
        for clear in sorted(cleared, key=lambda own: (not own.solution.met, own.solution.f)):
            done = self.fine(clear, mode)
            if done is not None:
                return done
        return None

    def _effort(self, T: Array) -> float:
        """Return the objective of tensions (n_tendons,), as the program counts it."""
        problem = self.task.problem(self.task.coarse("exact"))
        p = problem.parameters(self.task.targets, self.task.allowed)
        return float(problem.condensed.first(problem.free(T, self.task.allowed), p).f)

    def coarse(self, T: Array, mode: Mode) -> Clear | None:
        """Return the optimum that keeps clear, on the coarse mesh, where tensions lead to one."""
        avoidance: Avoidance | None = None
        solution: Solution | None = None
        stated = self.task.statement
        for _ in range(_ADDED):
            task = keeping(self.task, avoidance)
            line = line_of(task.problem(task.coarse(mode)), T, self.task.accuracy)
            if line is None:
                return None
            look = watched_places if solution is None else near_places
            near = look(line, self.asked)
            enough = lasting(avoidance, self.task.arm, self.asked)
            if solution is not None and enough and all(place.gap >= self._enough for place in near):
                self.records.append(record(solution))
                return Clear(self.task, avoidance, solution, stated)
            avoidance = updated(avoidance, near, line, self.asked)
            task = keeping(self.task, avoidance)
            solution, stated = self._solved(task, T, mode)
            if not solution.finite or (mode == "exact" and not solution.met):
                self.records.append(record(solution))
                return None
            T = task.tensions(solution)
        return None

    def fine(self, clear: Clear, mode: Mode) -> tuple[SearchResult, Avoidance | None] | None:
        """Return the refined plan, verified to keep clear; None where it is not."""
        for _ in range(_CORRECTED):
            task = clear.stated
            fine = refine(task, clear.solution, mode)
            if mode == "exact" and not fine.optimal:
                return None
            problem = task.problem(fine.statement)
            T = problem.tensions(fine.solution.x, task.allowed)
            line = line_of(problem, T, self.task.accuracy, finished=True)
            if line is None:
                return None
            if self.asked.keeps(line):
                lam = fine.solution.lam_x.tolist(), fine.solution.lam_g.tolist()
                tensions = task.arm.by_section(T)
                multipliers = tuple(lam[0]), tuple(lam[1])
                found = SearchResult(fine.statement, tensions, *multipliers, tuple(self.records))
                return found, clear.avoidance if clear.avoidance and clear.avoidance.rows else None
            near = near_places(line, self.asked)
            avoidance = updated(clear.avoidance, near, line, self.asked)
            before, solution = clear.avoidance, fine.solution
            if before is None or avoidance.structure(task.arm) != before.structure(task.arm):
                solution, stated = self._solved(keeping(self.task, avoidance), T, mode)
                clear = replace(clear, statement=stated)
                if not solution.finite or (mode == "exact" and not solution.met):
                    return None
            clear = replace(clear, avoidance=avoidance, solution=solution)
        return None

    @staticmethod
    def _solved(task: Task, T: Array, mode: Mode) -> tuple[Solution, Statement]:
        """Return what tensions lead to, and the task's statement, held where it has to be."""
        trials, coarse = Multistart(task), task.coarse(mode)
        solution = trials.solve(coarse, T)
        if not solution.met or trials.stands(coarse, solution):
            return solution, task.statement
        trials.toppled.append((coarse, solution))
        for held, steady in steadied(trials, mode, np.inf):
            return steady, held.statement
        return replace(solution, met=False), task.statement

    @property
    def _enough(self) -> float:
        return self.asked.clearance + _CLEAR * self.asked.spare(self.task.arm)
