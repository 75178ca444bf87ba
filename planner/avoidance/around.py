"""Plans that keep clear: searched as if nothing was in the way, then led around what is.

Optima of the search that touch nothing are as good as before. Others get inequalities where they
come too near, and are solved again from where they are; that is repeated, with inequalities added
at new places, until none is violated in between either. Optima are tried by effort, until none
that is left can be better. Where none leads around, other initial guesses are, then arms that touch
nothing and come near to the target; from the latter the nearest shape that keeps clear is found
where the target cannot be met.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import islice
from time import monotonic

import numpy as np

from model.clearance import clearances
from model.paths import Array
from model.progress import tell
from model.time_limit import OutOfTime, time_limit
from planner.avoidance.clear import clear_arms, keeping, line_of
from planner.avoidance.places import near_places, updated, watched_places
from planner.avoidance.rows import Avoidance, avoidance_of
from planner.avoidance.surroundings import Surroundings, nearest_in_words
from planner.program.statement import Mode
from planner.solve.ipopt import Candidate
from planner.solve.refine import refine
from planner.solve.search import Search
from planner.solve.task import SearchResult, Task, Trial

# Optima that are led around, and those of other guesses that are enough.
_OPTIMA, _ENOUGH = 8, 2
# Times that inequalities are added, on the coarse mesh and on the fine one.
_ADDED, _CORRECTED = 10, 6
# A place is clear that lacks so little of what is kept to spare.
_CLEAR = 0.6


class Around:
    """A planning question with surroundings; `searched` tells whether all guesses were tried."""

    def __init__(self, task: Task, surroundings: Surroundings) -> None:
        self.task, self.surroundings = task, surroundings
        self.trials: list[Trial] = []
        self.searched = False

    def run(self, seconds: float | None, near: SearchResult | None = None) -> SearchResult:
        """Return the best that keeps clear.

        Where a plan that is near is given, it is led around, and only if it cannot be is searched.
        """
        began = monotonic()
        if near is not None:
            led = self._near(near)
            if led is not None:
                return led
        search, self.searched = Search(self.task), True
        result = search.run(seconds)
        if result.stopped:
            return result
        self.task = search.task
        try:
            with time_limit(seconds and max(seconds - (monotonic() - began), 1e-3)):
                in_the_way = self._in_the_way(result)
                if in_the_way is None:
                    return result
                led = self._led(search, result)
        except OutOfTime:
            return replace(result, stopped=True)
        reached = result.statement.mode == "exact" and led.statement.mode != "exact"
        return replace(led, in_the_way=in_the_way) if reached else led

    def _in_the_way(self, result: SearchResult) -> str | None:
        """Return what a plan comes nearest to in words, None where it keeps clear."""
        line = line_of(self.task, result.statement, np.ravel(result.tensions), finished=True)
        if line is None:
            return ""
        if self.surroundings.keeps(line):
            return None
        return nearest_in_words(
            clearances(line, self.surroundings.obstacles, self.surroundings.least)
        )

    def _near(self, near: SearchResult) -> SearchResult | None:
        """Return a plan that keeps clear near one without surroundings."""
        if self._in_the_way(near) is None:
            return near
        clear = self.coarse(np.ravel(near.tensions), "exact")
        return None if clear is None else self.fine(clear)

    def _led(self, search: Search, result: SearchResult) -> SearchResult:
        """Return the best of what is led around."""
        mode, task = result.statement.mode, self.task
        optima = [np.ravel(result.tensions)]
        optima += [optimum.tensions for optimum in search.met]
        optima = _distinct(optima)[:_OPTIMA]
        possible = mode == "nearest" or self.surroundings.allows(task.arm, task.targets)
        best, clear = None, list[Array]()
        if possible:
            best = self._best(optima, mode, self._effort(np.ravel(result.tensions)))
            best = best or self._best(islice(search.guesses(), 1, None), mode)
        if best is None:
            clear = clear_arms(task, self.surroundings)
        if best is None and possible:
            best = self._best(clear, mode)
        if best is None and mode != "nearest":
            best = self._best([*clear, *optima[:1]], "nearest")
        return result if best is None else best

    def _best(
        self, starts: Iterable[Array], mode: Mode, least: float | None = None
    ) -> SearchResult | None:
        """Return the best that is led around from starts; from optima, if a least is given."""
        done: list[tuple[float, SearchResult]] = []
        for T in starts:
            tell(f"around obstacles, {mode}", len(self.trials))
            best = min((f for f, _ in done), default=np.inf)
            if least is not None and mode == "exact" and self._effort(T) > best:
                break
            clear = self.coarse(T, mode)
            result = None if clear is None else self.fine(clear)
            if clear is not None and result is not None:
                done.append((clear.f, result))
            if least is None and len(done) >= _ENOUGH:
                break
        return min(done, key=lambda pair: pair[0])[1] if done else None

    def _effort(self, T: Array) -> float:
        """Return the objective of tensions (n_tendons,), as the program counts it."""
        problem = self.task.problem(self.task.coarse("exact"))
        return float(problem.program.evaluate(problem.guess(T), problem.parameters()).f)

    def coarse(self, T: Array, mode: Mode) -> Candidate | None:
        """Return the optimum that keeps clear, on the coarse mesh, where tensions lead to one."""
        avoidance: Avoidance | None = None
        clear: Candidate | None = None
        for _ in range(_ADDED):
            line = line_of(self.task, self.task.coarse(mode), T)
            if line is None:
                return None
            near = (watched_places if clear is None else near_places)(line, self.surroundings)
            enough = avoidance is None or all(row.is_lasting for row in avoidance.rows)
            if clear is not None and enough and all(place.gap >= self._enough for place in near):
                return clear
            avoidance = updated(avoidance, near, line, self.surroundings)
            clear = self._solved(avoidance, T, mode, clear is not None)
            if clear is None:
                return None
            T = clear.tensions
        return None

    def fine(self, clear: Candidate) -> SearchResult | None:
        """Return the refined plan, verified to keep clear; None where it is not."""
        for _ in range(_CORRECTED):
            fine = refine(clear, self.task.accuracy)
            if fine is None:
                return None
            line = line_of(self.task, fine.statement, fine.tensions, finished=True)
            if line is None:
                return None
            if self.surroundings.keeps(line):
                return SearchResult.at(fine, self.trials)
            near, before = near_places(line, self.surroundings), avoidance_of(fine.problem.targets)
            clear = self._with_more(fine, updated(before, near, line, self.surroundings))
        return None

    def _with_more(self, fine: Candidate, avoidance: Avoidance) -> Candidate:
        """Return a refined optimum, with its multipliers, as a guess with other inequalities."""
        problem = fine.problem.but(targets=keeping(self.task, avoidance).targets)
        lam, parts = fine.lam_g, list[Array]()
        for row, other in zip(fine.problem.rows, problem.rows, strict=True):
            one, lam = lam[: row.size], lam[row.size :]
            parts.append(one if row.size == other.size else np.zeros(other.size))
        return replace(fine, problem=problem, lam_g=np.concatenate(parts))

    def _solved(self, avoidance: Avoidance, T: Array, mode: Mode, near: bool) -> Candidate | None:
        """Return what tensions lead to with inequalities, held to its stability where need be.

        An optimum `near` them, of the same with fewer inequalities, if they are one.
        """
        search = Search(keeping(self.task, avoidance))
        end = search.from_tensions(mode, T, near)
        self.trials += search.trials
        return end

    @property
    def _enough(self) -> float:
        return self.surroundings.clearance + _CLEAR * self.surroundings.spare(self.task.arm)


def _distinct(tensions: list[Array]) -> list[Array]:
    """Return tensions without those that are like one before."""
    kept: list[Array] = []
    for T in tensions:
        if all(np.abs(T - other).max() > 1e-3 * np.abs(T).max() for other in kept):
            kept.append(T)
    return kept
