"""From a question to tensions: solve from several starts on a coarse mesh, finish the best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.errors import OctoplanError
from model.paths import Array
from model.progress import tell
from model.settle import settle
from model.time_limit import OutOfTime, time_limit
from planner.initial_guess.curled import curled_arms
from planner.mirror import mirror_images
from planner.program.statement import Mode, Statement
from planner.solve.guesses import first_guesses, further_guesses
from planner.solve.ipopt import Solution
from planner.solve.multistart import LITTLE, Multistart, record
from planner.solve.refine import Fine, best_of, refine, refine_best
from planner.solve.search_result import SearchResult, Trial
from planner.solve.steadying import steadied, tightened
from planner.solve.task import Task

# First guesses from which continuation is tried where none leads to the targets by itself.
_CONTINUED = 2
# How well a mirror image is looked for, and what counts as costing no more.
_ROUGH, _NO_DEARER = 1e-4, 1e-6
# By so much of the effort the coarse mesh may be off.
_BLURRED = 0.01


class Search:
    """One planning question and the steps that answer it."""

    def __init__(self, task: Task) -> None:
        self.trials = Multistart(task)

    @property
    def task(self) -> Task:
        """What is asked; what turned out to need care on the way is so."""
        return self.trials.task

    def run(self, seconds: float | None = None) -> SearchResult:
        """Return the best optimum from the starts it takes, or the best so far after so long."""
        try:
            with time_limit(seconds):
                return self._run()
        except OutOfTime:
            return self._so_far()

    def _so_far(self) -> SearchResult:
        """Return the best that was seen before the time was over, on the coarse mesh.

        Of optima the one of least effort, else where the last solve was, else the initial guess
        that is nearest to what is wanted.
        """
        seen = self.trials.seen
        records = [record(solution) for _, solution in seen]
        if not seen:
            return self._found(self.task.coarse("exact"), self._nearest(), None, records, True)
        toppled = {id(solution) for _, solution in self.trials.toppled}
        met = [s for s in seen if s[0].mode == "exact" and s[1].met and id(s[1]) not in toppled]
        statement, best = min(met, key=lambda item: item[1].f) if met else seen[-1]
        return self._found(statement, self.task.tensions(best), best, records, True)

    def _nearest(self) -> Array:
        """Return the initial guess (n_tendons,) that is nearest to what is wanted [N]."""
        simple = self.task.simple
        problem = simple.problem(simple.coarse("exact"))
        found = curled_arms(problem, simple.targets, simple.allowed)
        return min(found, key=lambda guess: guess[0])[1]

    def _run(self) -> SearchResult:
        """Try the readings of the targets in turn; planner.program.problem has the three modes."""
        tell("initial guesses")
        guesses = first_guesses(self.task)
        self.trials.n_likely, self.trials.carried = guesses.n_likely, guesses.carried
        starts, first = guesses.starts, self.trials.first
        if self.task.can_be_exact:
            exact = self._exact(starts[:first], starts[first:])
            if exact is None and not self.trials.toppled and not self.trials.stiff:
                more = further_guesses(self.task).starts
                exact = self._exact(more, []) if more else None
            if exact is not None:
                return exact
            if self.trials.toppled:
                return self._steadied()
        found, records, mode = self._fallback(starts)
        exact = self._exact_near(min(found, key=lambda s: s.f), starts[first:])
        if exact is not None:
            return exact
        fine = best_of(self._finished(found, mode))
        exact = self._exact_near(fine.solution, starts[first:])
        return self._answer(fine, records) if exact is None else exact

    def _steadied(self) -> SearchResult:
        """Return the nearest shape that is stable enough where none that meets the targets is."""
        records = [record(solution) for _, solution in self.trials.toppled]
        for mode in self._readings():
            fines = self._finished([], mode)
            if fines:
                return self._answer(best_of(fines), records)
        statement, cheapest = min(self.trials.toppled, key=lambda item: item[1].f)
        return self._found(statement, self.task.tensions(cheapest), cheapest, records)

    def _exact_near(self, near: Solution, starts: list[Array]) -> SearchResult | None:
        """Return what meets the targets after all, where the nearest shape is as good as there."""
        if not self.task.can_be_exact or near.f > LITTLE:
            return None
        return self._exact([self.task.tensions(near), *starts], [])

    def _exact(self, first: list[Array], others: list[Array]) -> SearchResult | None:
        """Return the least effort that meets the targets; others are tried if a first one does."""
        statement = self.task.coarse("exact")
        records: list[Trial] = []
        found = self.trials.from_starts(first, statement, records)
        if not found and not self.trials.toppled and not self.trials.stiff:
            found = self.trials.by_continuation(first[:_CONTINUED], statement, records)
        if not found and not self.trials.toppled:
            return None
        found = self.trials.from_starts(others, statement, records, found)
        found = found or tightened(self.trials, statement, records)
        fines = self._finished(found, "exact")
        if not any(fine.optimal for fine in fines) or _lost(found, fines):
            records, starts = [], [*map(self.task.tensions, found), *first, *others]
            self.trials.toppled.clear()
            statement = self.task.finer("exact")
            found = self.trials.from_starts(starts, statement, records)
            found = found or tightened(self.trials, statement, records)
            fines += self._finished(found, "exact")
        fine = best_of(fines) if fines else None
        if fine is None or not fine.optimal:
            return None
        lost = _lost(found, fines)
        return replace(self._answer(self._in_plane(fine), records), lost=lost)

    def _in_plane(self, fine: Fine) -> Fine:
        """Return the optimum in a plane of symmetry where one costs no more, else the one given."""
        task, T, by = self.task, self.task.tensions(fine.solution), self.task.machine_code
        asked = (task.arm, task.scene, task.targets, task.limits)
        try:
            shape = fine.shape or settle(task.arm, T, task.scene, _ROUGH, compile=by)
            images = list(mirror_images(*asked, shape, _ROUGH))
        except OctoplanError:
            return fine
        for _, other in images:
            statement = task.coarse("exact")
            solution = self.trials.solve(statement, (T + other) / 2)
            if solution.met and self.trials.stands(statement, solution):
                inside = refine(task, solution, "exact")
                if inside.optimal and inside.solution.f <= fine.solution.f * (1 + _NO_DEARER):
                    return inside
        return fine

    def _readings(self) -> tuple[Mode, ...]:
        """Return how the targets may be read where they cannot be met."""
        closest = self.task.problem(self.task.coarse("closest"))
        closer = closest.terms.numel_out(1) > 0 or closest.n_lack > 0
        return ("closest", "nearest") if closer else ("nearest",)

    def _fallback(self, starts: list[Array]) -> tuple[list[Solution], list[Trial], Mode]:
        """Return the closest shapes, or the nearest if what has to be met cannot be."""
        for mode in self._readings():
            records: list[Trial] = []
            found = self.trials.from_starts(starts, self.task.coarse(mode), records)
            if found:
                return found, records, mode
        tried = (self.trials.solve(self.task.coarse(mode), T) for T in starts)
        finite = [s for s in tried if s.finite]
        if not finite:
            raise OctoplanError("no start led to a shape; check the arm, the limits and the target")
        return finite, records, mode

    def _finished(self, found: list[Solution], mode: Mode) -> list[Fine]:
        """Return the last digits of the best of what was found, and of what had to be steadied."""
        best = min((s.f for s in found), default=np.inf)
        held = steadied(self.trials, mode, best)
        tell("refining the mesh to the accuracy")
        own = [*((self.task, solution) for solution in found), *held]
        return [refine_best(own, mode)] if own else []

    def _answer(self, fine: Fine, records: list[Trial]) -> SearchResult:
        T = self.task.problem(fine.statement).tensions(fine.solution.x, self.task.allowed)
        return self._found(fine.statement, T, fine.solution, records)

    def _found(
        self,
        statement: Statement,
        T: Array,
        solution: Solution | None,
        records: list[Trial],
        stopped: bool = False,
    ) -> SearchResult:
        none: tuple[float, ...] = ()
        free = solution and solution.free(self.task.problem(statement))
        known = free is not None and free.multiplied
        lam_x = tuple(free.lam_x.tolist()) if free and known else none
        lam_g = tuple(free.lam_g.tolist()) if free and known else none
        tensions = self.task.arm.by_section(T)
        statement = statement.but(form=self.task.statement.form)
        return SearchResult(statement, tensions, lam_x, lam_g, tuple(records), stopped)


def _lost(coarse: list[Solution], fines: list[Fine]) -> float:
    """Return by what share of the effort a coarse optimum is cheaper than all fine ones, or 0."""
    cheapest = min((s.f for s in coarse), default=np.inf)
    best = best_of(fines).solution.f if fines else 0.0
    cheaper = 1 - float(np.sqrt(max(cheapest, 0.0) / best)) if best else 0.0
    return cheaper if cheaper > _BLURRED else 0.0
