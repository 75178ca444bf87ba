"""The best optimum of a search in contact on a fine mesh, where a load path leads to it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.contact.stability import held_stability
from model.errors import OctoplanError
from model.time_limit import OutOfTime
from planner.contact.descent import descended
from planner.contact.load_path import LoadPath, rubs
from planner.contact.optima import LocalOptimum, agree, best_of, met
from planner.contact.program import Program
from planner.contact.settled_terms import SettledTerms
from planner.contact.sqp import OPTIMAL, solve
from planner.contact.stated import FINE, ROUGH, along, program_of, tip_of
from planner.contact.steadying import steadied
from planner.solve.task import Task

# How close optimum and targets are asked to be, over the accuracy: while searching, at last.
CLOSER, _CLOSEST = 0.1, 0.01
# The residual of an optimum on the rough mesh, on the fine one.
ABOUT, _DONE = 1e-5, 3 * OPTIMAL
# The stability to which an optimum is held at least where the arm would snap; then what touches
# presses as well.
_FLOOR = 1e-2
# Of a margin what is as good as all of it.
_NEARLY = 1 - 1e-6


@dataclass(frozen=True, eq=False)
class Finishing:
    """What finishes a search.

    Attributes
    ----------
    task : Task
    begin : tuple of (n_tendons,) or None
        The load path that friction acts from.
    """

    task: Task
    begin: LoadPath | None

    def best(self, found: list[LocalOptimum]) -> LocalOptimum | None:
        """Return the best optimum on a fine mesh, of those that were found on a rough one.

        With a margin of stability others are held to it as long as they cost less without.
        """
        left, done, edge = list(found), None, None
        while left:
            rough = best_of(left, self._close)
            assert rough is not None
            if done is not None and rough.optimum.effort >= done.optimum.effort:
                break
            try:
                own = self._sharpened(rough)
            except OutOfTime:
                if done is None:
                    raise
                break
            left = [
                one for one in left if one is not rough and not agree([one, rough], self._close)
            ]
            if own is not None and not met([own], self._close):
                return done or edge or own
            if own is not None and self._lacks(own):
                edge = edge or own
            elif own is not None:
                done = best_of([own] if done is None else [own, done], self._close)
                if not self._margin:
                    break
        return done or edge or best_of(found, self._close)

    @property
    def _close(self) -> float:
        return self.task.accuracy

    @property
    def _margin(self) -> float:
        return self.task.statement.margin

    def _lacks(self, own: LocalOptimum) -> bool:
        """Return whether what meets the targets is at an edge, or does not stand well enough."""
        return own.optimum.kkt >= _DONE or lacks_stability(self.task, own)

    def _sharpened(self, rough: LocalOptimum) -> LocalOptimum | None:
        """Return the optimum on the fine mesh next to a rough one, if a load path leads to one.

        Held to stand better where it lacks that, or is at an edge beyond which the arm snaps.
        """
        own = self._on_fine(self.task, rough)
        missed = not met([rough if own is None else own], self._close)
        if missed or self.task.statement.modes or (own is not None and not self._lacks(own)):
            return own
        is_edge = own is None or own.optimum.kkt >= _DONE
        task = self.task.held(_FLOOR if is_edge else 0.0)
        program = program_of(task, ROUGH, self.begin)
        held = steadied(program, rough, CLOSER * self.task.accuracy, ABOUT)
        if held is None:
            return own
        return self._on_fine(task, replace(held, floor=task.statement.floor)) or own

    def _on_fine(self, task: Task, rough: LocalOptimum) -> LocalOptimum | None:
        """Return the optimum of a task on the fine mesh, if a load path leads to it."""
        program, close = program_of(task, FINE, self.begin), _CLOSEST * self.task.accuracy
        for way in [rough.load_path] if rubs(self.task.scene) else rough.load_paths():
            start = self._there(program, way, rough.optimum.terms)
            if start is not None:
                end = descended(program, start, close, OPTIMAL)
                if end.kkt >= OPTIMAL:
                    end = solve(program, end.terms, close)
                if self._there(program, way, end.terms) is not None:
                    return replace(rough, optimum=end, load_path=way)
        return None

    def _there(
        self, program: Program, load_path: LoadPath, terms: SettledTerms
    ) -> SettledTerms | None:
        """Return the terms under these tensions on a load path; None if it leads elsewhere."""
        try:
            found = along(program, (*load_path, tuple(terms.tensions.tolist())))
        except OctoplanError:
            return None
        off = np.abs(tip_of(found) - tip_of(terms)).max()
        return found if off < 0.01 * self.task.arm.length else None


def lacks_stability(task: Task, own: LocalOptimum) -> bool:
    """Return whether an optimum stands less well than by the margin that is asked for."""
    margin = task.statement.margin
    return margin > 0 and held_stability(own.optimum.terms.here) < margin * _NEARLY
