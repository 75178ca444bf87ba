"""From a question to tensions: solve from several starts on a coarse mesh, finish the best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.errors import OctoplanError
from model.loaded.forward import unloaded
from model.paths import Array
from model.patience import OutOfTime, check_time, time_limit
from model.progress import tell, told
from model.statics import is_loaded
from planner.program.problem import TRACES
from planner.program.statement import Mode, Statement
from planner.solve.finish import Fine, finish_best
from planner.solve.found import Found, Start, agreed
from planner.solve.guesses import Guesses, first_guesses
from planner.solve.ipopt import Solution, solve
from planner.solve.starts import spread
from planner.solve.task import Task

# Starts before agreement counts: five do for points, more where optima are many and close.
_FEW, _MORE = 5, 8
# Enough where least squares over more numbers than there are tendons come to nothing: that fixes
# the shape, and with it the tensions.
_FIXED = 3
# Loaded arms start from the optima of the unloaded one, among which the search was; one of those
# that cost little more than the best leads to the best with loads.
_FEWEST, _DEARER = 2, 1.2
# Tried besides the fits that meet what is wanted.
_BESIDE = 2
_INSIDE = 0.005
_LITTLE = 1e-5


class Search:
    """One planning question and the steps that answer it."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.least = _FEW if task.is_point else _MORE
        if is_loaded(task.scene):
            self.least = _FEWEST
        self.sure = 0
        self.seen: list[tuple[Statement, Solution]] = []

    def run(self, most: int, seconds: float | None = None) -> Found:
        """Return the best optimum from so many starts, or the best so far after so long."""
        try:
            with time_limit(seconds):
                return self._run(most)
        except OutOfTime:
            return self._so_far()

    def _so_far(self) -> Found:
        """Return the best that was seen before the time was over, on the coarse mesh.

        Of optima the one of least effort, else where the last solve was, else the least tensions.
        """
        records = [_record(solution) for _, solution in self.seen]
        if not self.seen:
            T = np.array(self.task.allowed.lower)
            return self._found(self.task.coarse("exact"), T, None, records, True)
        met = [item for item in self.seen if item[0].mode == "exact" and item[1].met]
        statement, best = min(met, key=lambda item: item[1].f) if met else self.seen[-1]
        return self._found(statement, self.task.tensions(best), best, records, True)

    def _run(self, most: int) -> Found:
        """Try the readings of the targets in turn; planner.program.problem has the three modes."""
        guesses = self._guesses(most)
        starts, self.sure = guesses.starts, guesses.sure
        if self.task.can_be_exact:
            exact = self._exact(starts[: self._first], starts[self._first :])
            if exact is not None:
                return exact
        found, records, mode = self._fallback(starts)
        exact = self._exact_near(min(found, key=lambda s: s.f), starts)
        if exact is not None:
            return exact
        fine = self._finished(found, mode)
        exact = self._exact_near(fine.solution, starts)
        return self._answer(fine, records) if exact is None else exact

    def _exact_near(self, near: Solution, starts: list[Array]) -> Found | None:
        """Return what meets the targets after all, where the nearest shape is as good as there."""
        if not self.task.can_be_exact or near.f > _LITTLE:
            return None
        return self._exact([self.task.tensions(near), *starts[self.least :]], [])

    def _guesses(self, most: int) -> Guesses:
        """Return first guesses; with loads, the optima without them before the others."""
        if is_loaded(self.task.scene):
            return self._without_loads(most)
        return first_guesses(self.task, most)

    def _without_loads(self, most: int) -> Guesses:
        """Return the optima of the unloaded arm, best first: the loaded ones are near.

        Those for the shape alone, if there is one: how stiff it is has to be found with the loads.
        """
        task = self.task
        shape = tuple(target for target in task.targets if target.look() is None) or task.targets
        free = Search(
            replace(
                task,
                scene=unloaded(task.scene),
                statement=task.statement.but(form="condensed"),
                targets=shape,
            )
        )
        guesses = free._guesses(most)
        free.sure = guesses.sure
        mode: Mode = "exact" if free.task.can_be_exact else "closest"
        found = [free._solve(free.task.coarse(mode), T) for T in guesses.starts[: free._first]]
        met = sorted((s for s in found if s.finite), key=lambda s: (not s.met, s.f))
        likely = [s for s in met if s.met and s.f <= _DEARER * met[0].f]
        sure = len(spread([free.task.tensions(s) for s in likely], most))
        first = [free.task.tensions(s) for s in met]
        return Guesses(spread([*first, *guesses.starts], most), sure if guesses.sure else 0)

    def _exact(self, first: list[Array], others: list[Array]) -> Found | None:
        """Return the least effort that meets the targets; others are tried if a first one does."""
        statement = self.task.coarse("exact")
        records: list[Start] = []
        found = self._from_starts(first, statement, records)
        if not found:
            return None
        found += self._from_starts(others, statement, records)
        fine = self._finished(found, "exact")
        if not fine.optimal:
            records, starts = [], [*map(self.task.tensions, found), *first, *others]
            found = self._from_starts(starts, self.task.finer("exact"), records)
            fine = self._finished(found, "exact") if found else fine
        return self._answer(fine, records) if fine.optimal else None

    def _fallback(self, starts: list[Array]) -> tuple[list[Solution], list[Start], Mode]:
        """Return the closest shapes, or the nearest if what has to be met cannot be."""
        closest = self.task.problem(self.task.coarse("closest"))
        closer = closest.terms.numel_out(1) > 0 or closest.n_lack > 0
        modes: tuple[Mode, ...] = ("closest", "nearest") if closer else ("nearest",)
        for mode in modes:
            records: list[Start] = []
            found = self._from_starts(starts, self.task.coarse(mode), records)
            if found:
                return found, records, mode
        tried = (self._solve(self.task.coarse(mode), T) for T in starts)
        finite = [s for s in tried if s.finite]
        if not finite:
            raise OctoplanError("no start led to a shape; check the arm, the limits and the target")
        return finite, records, mode

    def _from_starts(
        self, starts: list[Array], statement: Statement, records: list[Start]
    ) -> list[Solution]:
        """Return what is met from each start, until the best was found twice; append records."""
        found: list[Solution] = []
        for T in told(f"first guesses, {statement.mode}", starts):
            if self._enough(records, found):
                break
            solution = self._solve(statement.but(careful=self.task.statement.careful), T)
            records.append(_record(solution))
            if solution.met:
                found.append(solution)
        return found

    @property
    def _first(self) -> int:
        """How many starts are tried before it is said that none meets the targets."""
        return max(self.least, self.sure)

    def _enough(self, records: list[Start], found: list[Solution]) -> bool:
        """Return whether the best optimum is among what was found, as far as can be told."""
        if not self.task.can_be_exact and any(s.f <= _LITTLE for s in found):
            return len(records) >= _FIXED
        if self.sure:
            return len(records) >= self.sure + _BESIDE
        return len(records) >= self.least and agreed(records) >= 2

    def _solve(self, statement: Statement, T: Array) -> Solution:
        solution = self._solved(statement, T)
        if solution.undefined and self.task.scene != self.task.scene.careful():
            self.task = replace(self.task, statement=self.task.statement.but(careful=True))
            solution = self._solved(statement.but(careful=True), T)
        return solution

    def _solved(self, statement: Statement, T: Array) -> Solution:
        task = self.task
        problem, limits = task.problem(statement), task.allowed
        p = problem.parameters(task.targets, limits, TRACES[0])
        bounds, x = problem.bounds(limits), problem.unknowns(T, limits, p)
        n = task.arm.n_tendons
        x[:n] = np.clip(np.maximum(x[:n], _INSIDE), bounds[0][:n], bounds[1][:n])
        solution = solve(problem, x, p, bounds)
        if solution.finite:
            self.seen.append((statement, solution))
        check_time()
        return solution

    def _finished(self, found: list[Solution], mode: Mode) -> Fine:
        tell("the last digits")
        return finish_best(self.task, found, mode)

    def _answer(self, fine: Fine, records: list[Start]) -> Found:
        T = self.task.problem(fine.statement).tensions(fine.solution.x, self.task.allowed)
        return self._found(fine.statement, T, fine.solution, records)

    def _found(
        self,
        statement: Statement,
        T: Array,
        solution: Solution | None,
        records: list[Start],
        stopped: bool = False,
    ) -> Found:
        none: tuple[float, ...] = ()
        lam_x = tuple(solution.lam_x.tolist()) if solution else none
        lam_g = tuple(solution.lam_g.tolist()) if solution else none
        tensions = self.task.arm.by_section(T)
        return Found(statement, tensions, lam_x, lam_g, tuple(records), stopped)


def _record(solution: Solution) -> Start:
    return Start(solution.f, solution.met, solution.iterations)
