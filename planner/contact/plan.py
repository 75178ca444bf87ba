"""Plans in scenes with contact: from free plans and bends towards the targets to least effort."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from model.effects import Contact
from model.errors import InputError, OctoplanError
from model.paths import Array
from model.progress import tell
from model.scene import Scene
from model.time_limit import OutOfTime, check_time, time_limit
from planner.contact.settled_terms import SettledTerms, Settling
from planner.contact.sqp import Optimum, Program, kkt_residual, solve
from planner.program.limits import natural_tensions
from planner.program.statement import Mode
from planner.program.terms import compliance_requests
from planner.solve.search import Search
from planner.solve.search_result import SearchResult, Trial
from planner.solve.task import Task

# Meshes on which a plan is searched for and finished.
_ROUGH, _FINE = 1, 3
# How close optimum and targets are asked to be, over the accuracy.
_CLOSER = 0.1
# First guesses of the free arm, and bends towards a target by so many times the natural tensions.
_FREE, _BENDS = 3, (0.3, 1.0, 2.0)


def check_contact(task: Task, avoids: bool) -> None:
    """Raise InputError for what is not stated in scenes with contact."""
    if compliance_requests(task.targets):
        raise InputError("target", "a stiffness", "shapes alone, in a scene with contact")
    if task.statement.norm != "2":
        raise InputError("norm", task.statement.norm, '"2", in a scene with contact')
    if avoids:
        allowed = "none in a scene with contact: there they are effects"
        raise InputError("obstacles", "given", allowed)
    if task.limits.strokes is not None:
        raise InputError("stroke_max", "given", "none in a scene with contact")


@dataclass(frozen=True, eq=False)
class ContactSearch:
    """The search for the least tensions of an arm that leans on things."""

    task: Task

    def run(self, seconds: float | None) -> SearchResult:
        """Return the best optimum from the starts, or the best so far after so long."""
        found = list[Optimum]()
        stopped = False
        try:
            with time_limit(seconds):
                for T in self._starts()[: self.task.starts]:
                    found += self._from(T)
                best = self._finished(found) if found else None
        except OutOfTime:
            stopped, best = True, self._best(found)
        trials = tuple(Trial(own.effort, own.lacks < self._close, 0) for own in found)
        exact = best is not None and best.lacks < self._close
        mode: Mode = "exact" if exact else "nearest"
        statement = self.task.statement.but(mode=mode, scheme="gauss6", refinement=_FINE)
        if best is None:
            T = np.array(self.task.allowed.lower)
            return SearchResult(statement, self.task.arm.by_section(T), (), (), trials, stopped)
        T = self.task.arm.by_section(best.terms.tensions)
        lam = tuple(best.lam_bounds.tolist()), tuple(best.lam_match.tolist())
        return SearchResult(statement, T, *lam, trials, stopped)

    @property
    def _close(self) -> float:
        return self.task.accuracy

    def _best(self, found: list[Optimum]) -> Optimum | None:
        """Return the optimum of least effort of those that meet the targets, else the nearest."""
        met = [own for own in found if own.lacks < self._close]
        if met:
            return min(met, key=lambda own: own.effort)
        return min(found, key=lambda own: own.lacks, default=None)

    def _from(self, T: Array) -> list[Optimum]:
        """Return the optimum that a start leads to; none where the arm comes to no rest."""
        tell("initial guesses")
        check_time()
        program = _program(self.task, _ROUGH)
        try:
            start = program.evaluate(np.clip(T, program.lower, program.upper), None)
            return [solve(program, start, _CLOSER * self.task.accuracy)]
        except OctoplanError:
            return []

    def _finished(self, found: list[Optimum]) -> Optimum | None:
        """Return the best optimum on a fine mesh, as the arm comes to it from rest."""
        left, program = list(found), _program(self.task, _FINE)
        while left:
            best = self._best(left)
            assert best is not None
            start = self._from_rest(program, best.terms)
            if start is not None:
                return solve(program, start, _CLOSER * self.task.accuracy)
            left.remove(best)
        return self._best(found)

    def _from_rest(self, program: Program, terms: SettledTerms) -> SettledTerms | None:
        """Return the terms under the same tensions from rest; None if the arm comes elsewhere."""
        try:
            found = program.evaluate(terms.tensions, None)
        except OctoplanError:
            return None
        off = np.abs(_tip(found) - _tip(terms)).max()
        return found if off < 0.01 * self.task.arm.length else None

    def _starts(self) -> list[Array]:
        """Return tensions to begin with: of the free arm, and bends towards targets."""
        task, found = self.task, list[Array]()
        effects = (e for e in task.scene.effects if not isinstance(e, Contact))
        free = replace(task, scene=Scene(*effects), starts=_FREE)
        with suppress(OctoplanError):
            found.append(np.ravel(Search(free).run().tensions))
        natural = np.minimum(natural_tensions(task.arm), np.array(task.allowed.upper))
        return found + [share * own for own in self._towards(natural) for share in _BENDS]

    def _towards(self, natural: Array) -> list[Array]:
        """Return the natural tensions of the tendons on the sides of what targets are about."""
        arm, found = self.task.arm, list[Array]()
        frame = np.array(arm.base_frame)
        for target in self.task.targets:
            point = target.guess_towards(arm)
            if point is None:
                continue
            n, b = (point - np.array(arm.base_position)) @ frame[:, 1:]
            angles = np.array([phi for _, phi in arm.tendons])
            along = (np.cos(angles) * n + np.sin(angles) * b) / max(np.hypot(n, b), 1e-12)
            found.append(natural * np.maximum(along, 0.0))
        return found


def _program(task: Task, refinement: int) -> Program:
    """Return the program on meshes of a refinement."""
    settling = Settling(task.arm, task.scene, task.targets, refinement, task.machine_code)
    scale = float(natural_tensions(task.arm).max())
    total = np.inf if task.limits.total is None else task.limits.total
    low, high = np.array(task.allowed.lower), np.array(task.allowed.upper)
    return Program(settling.at, low, high, total, scale)


def _tip(terms: SettledTerms) -> Array:
    system = terms.here.system
    return np.asarray(terms.here.states[system.of.nodes[-1, 4:7]])


def optimality_of(task: Task, tensions: Array) -> float:
    """Return the residual of the first-order conditions at tensions (n_tendons,), scaled."""
    program = _program(task, _FINE)
    try:
        return kkt_residual(program, program.evaluate(tensions, None))
    except OctoplanError:
        return np.inf
