"""The search for plans in contact: optima from several guesses, the best of them on a fine mesh."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import isfinite
from time import monotonic

import numpy as np

from model.equilibrium.linearised import Linearised
from model.errors import OctoplanError
from model.loads import without_friction
from model.paths import Array
from model.progress import tell
from model.shape import Shape
from model.time_limit import OutOfTime, check_time, end, time_limit
from planner.contact.exchange import Exchange, Optimum
from planner.contact.guesses import guesses
from planner.contact.load_path import LoadPath, rubs
from planner.contact.rubbing import Sliding, against_friction
from planner.program.limits import natural_tensions
from planner.program.statement import Mode
from planner.solve.search_result import SearchResult, Trial
from planner.solve.task import Task

# Meshes on which optima are searched for, and the best is found; which are one, by their efforts.
ROUGH, FINE, _SAME = 1, 2, 1e-3
# The share of a time limit that the search may take, the rest is for the fine mesh.
_SEARCHED = 0.6
# Where the arm would snap it is held to so much stability.
_FLOOR = 1e-2
# How far the tip may be from where a load path leads, over the arm's length.
_ELSEWHERE = 1e-2


@dataclass(frozen=True, eq=False)
class Local:
    """A local optimum, and the load path to where its steps began."""

    optimum: Optimum
    before: LoadPath

    def load_paths(self) -> list[LoadPath]:
        """Return load paths to the optimum: from rest alone, then by more and more of its steps."""
        first, *steps = self.optimum.steps
        return [(), (*self.before, first), (*self.before, first, *steps)]


class ContactSearch:
    """The search for the least tensions of an arm in contact.

    `begin` is the load path to an equilibrium nearby, its tensions last: it is tried first, and
    with friction, that acts against the motion from there, alone.
    """

    def __init__(self, task: Task, begin: LoadPath | None = None) -> None:
        self.task, self.begin = task, begin
        self.found = list[Local]()

    def run(self, seconds: float | None) -> SearchResult:
        """Return the best optimum from the guesses, or the best so far after so long."""
        if rubs(self.task.scene):
            return self._against_friction(seconds)
        stopped, best = False, None
        with time_limit(seconds):
            try:
                left = end() - monotonic()
                with time_limit(_SEARCHED * left if isfinite(left) else None):
                    self._search()
                    check_time()
            except OutOfTime:
                stopped = True
            try:
                best = self._best()
                check_time()
            except OutOfTime:
                stopped = True
        return self._result(best, stopped)

    def _against_friction(self, seconds: float | None) -> SearchResult:
        """Return the plan from where the arm is, by what it takes without friction."""
        assert self.begin is not None
        scene = without_friction(self.task.scene)
        smooth, T = replace(self.task, scene=scene, starts=1), np.array(self.begin[-1])
        with time_limit(seconds):
            for begin in (self.begin, None):
                found = ContactSearch(smooth, begin).run(None)
                T = np.ravel(found.tensions)
                if found.statement.mode == "exact" or found.stopped:
                    break
            return against_friction(self.task, self.begin, T, None)

    def _search(self) -> None:
        """Find optima until two agree on the best, or there are as many as are asked for."""
        rough, ends = Exchange(self.task, ROUGH), list[tuple[Array, Local | None]]()
        close = _SAME * float(np.max(natural_tensions(self.task.arm)))
        for tried, (before, T) in enumerate(self._begun(rough), 1):
            tell("initial guesses", tried - 1, self.task.most)
            known = [own for begun, own in ends if np.abs(begun - T).max() < close]
            own = known[0] if known else self._from(rough, (*before, tuple(T.tolist())))
            ends.append((T, own))
            if own is not None:
                self.found.append(own)
            met = sorted(one.optimum.effort for one in self.found if not one.optimum.lacks)
            agreed = len(met) > 1 and met[1] < met[0] * (1 + _SAME)
            followed = self.begin is not None and tried == len(met) == 1
            if followed or (agreed and self.task.starts is None) or tried == self.task.most:
                return

    def _begun(self, rough: Exchange) -> Iterator[tuple[LoadPath, Array]]:
        """Yield load paths and the tensions at their ends: what is near, then others from rest."""
        if self.begin is not None:
            yield self.begin[:-1], np.array(self.begin[-1])
        yield from (((), T) for T in guesses(self.task, rough))

    def _from(self, rough: Exchange, load_path: LoadPath) -> Local | None:
        """Return the optimum that a load path leads to; None where the arm comes to no rest."""
        try:
            here = rough.along(load_path)
        except OctoplanError:
            return None
        margin, own = self.task.statement.margin, rough.optimum(here)
        snaps = own is None or (not own.lacks and not rough.stands(own))
        held = rough.optimum(here, max(margin, _FLOOR)) if snaps else None
        own = held if held is not None else own
        return None if own is None else Local(own, load_path[:-1])

    def _best(self) -> Local | None:
        """Return the best optimum on the fine mesh to which a load path leads."""
        order = sorted(self.found, key=lambda own: (own.optimum.lacks, own.optimum.effort))
        fine = Exchange(self.task, FINE) if order else None
        for rough in order:
            assert fine is not None
            for path in rough.load_paths():
                own = self._on_fine(fine, rough, path)
                if own is not None:
                    return own
        return order[0] if order else None

    def _on_fine(self, fine: Exchange, rough: Local, path: LoadPath) -> Local | None:
        """Return the optimum on the fine mesh if a load path leads there."""
        old, far = rough.optimum, _ELSEWHERE * self.task.arm.length
        try:
            start = fine.along((*path, old.steps[-1]))
            own = fine.optimum(start, old.least) if _apart(start, old.here) < far else None
            if own is None or bool(own.lacks) != bool(old.lacks):
                return None
            there = fine.along((*path, own.steps[-1]))
        except OctoplanError:
            return None
        return Local(own, path) if _apart(there, own.here) < far else None

    def _result(self, best: Local | None, stopped: bool) -> SearchResult:
        """Return what is told of the best; of where the search began where there is none."""
        ends = [own.optimum for own in self.found]
        trials = tuple(Trial(own.effort, not own.lacks, 0) for own in ends)
        exact = best is not None and not best.optimum.lacks
        mode: Mode = "exact" if exact else "nearest"
        statement = self.task.statement.but(mode=mode, refinement=FINE)
        if best is None:
            *way, last = self.begin or (self.task.allowed.lower,)
            T = self.task.arm.by_section(np.array(last))
            return SearchResult(statement, T, (), (), trials, stopped, load_path=tuple(way))
        own = best.optimum
        lam_g = (own.optimality.lam_stability,) if own.least else ()
        statement = statement.but(modes=int(own.least > 0), floor=own.least or statement.floor)
        T = self.task.arm.by_section(np.clip(own.here.tensions, *self._limits))
        lam_x = tuple(own.optimality.lam_bounds.tolist())
        return SearchResult(statement, T, lam_x, lam_g, trials, stopped, load_path=best.before)

    @property
    def _limits(self) -> tuple[Array, Array]:
        return np.array(self.task.allowed.lower), np.array(self.task.allowed.upper)


def _apart(one: Linearised, other: Linearised) -> float:
    """Return how far the tips of equilibria on two meshes are apart [m]."""
    tips = [here.system.poses(here.states)[-1, 4:] for here in (one, other)]
    return float(np.linalg.norm(tips[0] - tips[1]))


def optimality_of(task: Task, tensions: Array, shape: Shape, load_path: LoadPath = ()) -> float:
    """Return the residual of the first-order conditions at tensions (n_tendons,), scaled.

    Of the shape that a load path leads to.
    """
    try:
        if rubs(task.scene):
            return Sliding(task, load_path).optimality(tensions)[0]
        fine = Exchange(task, FINE)
        here = fine.map.found(tensions, shape.known)
        return fine.optimality(here, task.statement.least * task.statement.modes).residual
    except OctoplanError:
        return np.inf
