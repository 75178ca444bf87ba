"""The search for plans in contact: load paths, optima on a rough mesh, the best on a fine one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite
from time import monotonic

import numpy as np

from model.errors import OctoplanError
from model.loads import without_friction
from model.paths import Array
from model.progress import tell
from model.time_limit import OutOfTime, check_time, end, time_limit
from planner.contact.descent import STEPS
from planner.contact.finishing import ABOUT, CLOSER, Finishing, lacks_stability
from planner.contact.load_path import LoadPath, rubs
from planner.contact.optima import LocalOptimum, agree, best_of, met
from planner.contact.program import Program
from planner.contact.sqp import solve
from planner.contact.starts import starts
from planner.contact.stated import FINE, ROUGH, along, program_of
from planner.program.statement import Mode
from planner.solve.search_result import SearchResult, Trial
from planner.solve.task import Task

# The share of a time limit that the search may take; the rest is for the mesh that is asked for.
_SEARCHED = 0.6
# With friction, how far beyond what would do without it, of the way there.
_SLID = (1.0, 1.5, 2.5)
# Steps of a start beyond those that led to the best so far, and how many times its effort starts
# may take.
_FEW, _DEARER = 20, 5.0


@dataclass(frozen=True, eq=False)
class ContactSearch:
    """The search for the least tensions of an arm in contact.

    Attributes
    ----------
    task : Task
    begin : tuple of (n_tendons,) or None
        The load path to an equilibrium nearby, its tensions last; it is tried before others, and
        with friction, that acts against the motion from there, alone.
    """

    task: Task
    begin: LoadPath | None = None

    def run(self, seconds: float | None) -> SearchResult:
        """Return the best optimum from the starts, or the best so far after so long.

        Where none stands as well as is asked, from the starts once more, held to that from there.
        """
        with time_limit(seconds):
            found, best, stopped = self._searched()
            if best is not None and not stopped and lacks_stability(self.task, best):
                held = replace(self, task=self.task.held(0.0))
                again = held._searched()
                if again[1] is not None and met([again[1]], self._close):
                    return held._result(*again)
        return self._result(found, best, stopped)

    def _searched(self) -> tuple[list[LocalOptimum], LocalOptimum | None, bool]:
        """Return optima on the rough mesh, the best on a fine one, whether time ended it."""
        found = list[LocalOptimum]()
        stopped, best = False, None
        left = end() - monotonic()
        try:
            with time_limit(_SEARCHED * left if isfinite(left) else None):
                for load_path in self._load_paths():
                    found += self._from(load_path, found)
                    goes_on = load_path == self.begin and met(found, self._close)
                    if goes_on or agree(found, self._close):
                        break
                check_time()
        except OutOfTime:
            stopped = True
        try:
            best = Finishing(self.task, self.begin).best(found) if found else None
            check_time()
        except OutOfTime:
            stopped, best = True, best or best_of(found, self._close)
        return found, best, stopped

    def _result(
        self, found: list[LocalOptimum], best: LocalOptimum | None, stopped: bool
    ) -> SearchResult:
        """Return what is told of the best; of where the search began where there is none."""
        ends = [own.optimum for own in found]
        trials = tuple(Trial(own.effort, own.lacks < self._close, 0) for own in ends)
        exact = best is not None and best.optimum.lacks < self._close
        mode: Mode = "exact" if exact else "nearest"
        statement = self.task.statement.but(mode=mode, refinement=FINE)
        if best is None:
            *way, last = self.begin or (self.task.allowed.lower,)
            T = self.task.arm.by_section(np.array(last))
            return SearchResult(statement, T, (), (), trials, stopped, load_path=tuple(way))
        end = best.optimum
        T = self.task.arm.by_section(end.terms.tensions)
        if best.floor is not None:
            statement = statement.but(modes=1, floor=best.floor)
        held = end.lam_equality
        if statement.modes:
            held = np.append(held, end.lam_inequality[end.terms.inequalities - 1])
        lam = tuple(end.lam_bounds.tolist()), tuple(held.tolist())
        return SearchResult(statement, T, *lam, trials, stopped, load_path=best.load_path)

    @property
    def _close(self) -> float:
        return self.task.accuracy

    def _load_paths(self) -> Iterator[LoadPath]:
        """Yield load paths to begin with: to what is near, then straight ones from rest."""
        most = self.task.starts
        if self.begin is not None and rubs(self.task.scene):
            for T in self._slid(self.begin)[:most]:
                yield (*self.begin, tuple(T.tolist()))
            return
        if self.begin is not None:
            yield self.begin
            most = most and most - 1
        if most != 0:
            for T in starts(self.task, self._rough)[:most]:
                yield (tuple(T.tolist()),)

    def _from(self, load_path: LoadPath, before: list[LocalOptimum]) -> list[LocalOptimum]:
        """Return the optimum that a load path leads to; none where the arm comes to no rest.

        Or as far as it looks like coming to less than those `before`.
        """
        tell("initial guesses")
        check_time()
        program, known, most = self._rough, np.inf, STEPS
        last = np.clip(load_path[-1], program.lower, program.upper)
        if best := best_of(met(before, self._close), self._close):
            known = program.objective(best.optimum.terms)
            most = _FEW + len(best.optimum.steps)
            if np.linalg.norm(last) > _DEARER * best.optimum.effort:
                return []
        try:
            start = along(program, (*load_path[:-1], tuple(last.tolist())))
            end = solve(program, start, CLOSER * self.task.accuracy, ABOUT, known, most)
        except OctoplanError:
            return []
        if self.begin is not None and program.has_history:
            return [LocalOptimum(end, self.begin)]
        return [LocalOptimum(end, (*load_path[:-1], tuple(last.tolist())))]

    @cached_property
    def _rough(self) -> Program:
        return program_of(self.task, ROUGH, self.begin)

    def _slid(self, begin: LoadPath) -> list[Array]:
        """Return tensions as far as, and beyond, what the target takes without friction.

        Where the arm still sticks no tensions tell how to move it.
        """
        smooth = replace(self.task, scene=without_friction(self.task.scene))
        before = np.array(begin[-1])
        found = ContactSearch(replace(smooth, starts=1), begin).run(None)
        if found.statement.mode != "exact":
            found = ContactSearch(smooth).run(None)
        way = np.ravel(found.tensions) - before
        return [np.maximum(before + share * way, 0.0) for share in _SLID]
