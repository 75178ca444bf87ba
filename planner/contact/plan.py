"""Plans in scenes with contact: from free plans and bends towards the targets to least effort."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from model.contact.forward import TouchingMap, without_friction
from model.effects import Contact
from model.equilibrium.forward import STAGES
from model.errors import InputError, OctoplanError, SnapError
from model.loads import contacts
from model.paths import Array
from model.progress import tell
from model.scene import Scene
from model.time_limit import OutOfTime, check_time, time_limit
from planner.avoidance.around import Around
from planner.avoidance.asked import Surroundings
from planner.contact.load_path import LoadPath, followed, rubs
from planner.contact.program import Optimum, Program, lacking
from planner.contact.quadratic import optimum_at
from planner.contact.settled_terms import SettledTerms, Settling
from planner.contact.sqp import solve
from planner.program.limits import natural_tensions
from planner.program.statement import Mode
from planner.program.terms import compliance_requests
from planner.solve.search import Search
from planner.solve.search_result import SearchResult, Trial
from planner.solve.task import Task
from planner.targets.base import Target
from planner.targets.hold import Hold
from planner.targets.wrap import Wrap

# Meshes on which a plan is searched for and finished.
_ROUGH, _FINE = 1, 2
# How close optimum and targets are asked to be, over the accuracy.
_CLOSER = 0.1
# First guesses of the free arm, and bends towards a target by so many times the natural tensions.
_FREE, _BENDS = 3, (0.3, 1.0, 2.0)
# Bends that may press on what is held, harder and harder; how many are begun with.
_HARDER, _PRESSED = tuple((0.25 * 1.5 ** np.arange(12)).tolist()), 4
# With friction, how far beyond what would do without it, of the way there.
_SLID = (1.0, 1.5, 2.5)
# Efforts of optima that are one: starts are enough where two lead there. The residual of an optimum
# on the rough mesh.
_SAME, _ABOUT = 1e-3, 1e-5


def check_contact(task: Task, avoids: bool) -> None:
    """Raise InputError for what is not stated in scenes with contact."""
    if compliance_requests(task.targets):
        raise InputError("target", "a stiffness", "shapes alone, in a scene with contact")
    if task.statement.norm != "2":
        raise InputError("norm", task.statement.norm, '"2", in a scene with contact')
    if rubs(task.scene) and any(isinstance(target, Hold | Wrap) for target in task.targets):
        allowed = "places and poses alone where contacts have friction; 0 for holds and wraps"
        raise InputError("Contact.friction", "above 0", allowed)
    if avoids:
        allowed = "none in a scene with contact: there they are effects"
        raise InputError("obstacles", "given", allowed)
    if task.limits.strokes is not None:
        raise InputError("stroke_max", "given", "none in a scene with contact")
    # Refuses an arm that is inside of an obstacle at rest, which every start would meet.
    TouchingMap(task.arm, task.scene, STAGES, _ROUGH)


def check_holds(targets: tuple[Target, ...], scene: Scene) -> None:
    """Raise InputError for what is held and is no contact of the scene."""
    touched = [contact.obstacle for contact in contacts(scene)]
    for target in targets:
        if isinstance(target, Hold) and target.obstacle not in touched:
            allowed = "an obstacle that the scene has as a Contact"
            raise InputError("Hold.obstacle", target.obstacle, allowed)


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
        """Return the best optimum from the starts, or the best so far after so long."""
        found = list[LocalOptimum]()
        stopped, best = False, None
        try:
            with time_limit(seconds):
                for load_path in self._load_paths():
                    found += self._from(load_path)
                    if (load_path == self.begin and self._met(found)) or self._agree(found):
                        break
                best = self._finished(found) if found else None
        except OutOfTime:
            stopped, best = True, self._best(found)
        ends = [own.optimum for own in found]
        trials = tuple(Trial(own.effort, own.lacks < self._close, 0) for own in ends)
        exact = best is not None and best.optimum.lacks < self._close
        mode: Mode = "exact" if exact else "nearest"
        statement = self.task.statement.but(mode=mode, scheme="gauss6", refinement=_FINE)
        if best is None:
            T = np.array(self.task.allowed.lower)
            return SearchResult(statement, self.task.arm.by_section(T), (), (), trials, stopped)
        end = best.optimum
        T = self.task.arm.by_section(end.terms.tensions)
        lam = tuple(end.lam_bounds.tolist()), tuple(end.lam_equality.tolist())
        return SearchResult(statement, T, *lam, trials, stopped, load_path=best.load_path)

    @property
    def _close(self) -> float:
        return self.task.accuracy

    def _met(self, found: list[LocalOptimum]) -> list[LocalOptimum]:
        return [own for own in found if own.optimum.lacks < self._close]

    def _agree(self, found: list[LocalOptimum]) -> bool:
        """Return whether two starts own to one optimum, the best so far."""
        efforts = sorted(own.optimum.effort for own in self._met(found))
        return len(efforts) > 1 and efforts[1] <= efforts[0] * (1 + _SAME)

    def _best(self, found: list[LocalOptimum]) -> LocalOptimum | None:
        """Return the optimum of least effort of those that meet the targets, else the nearest."""
        if met := self._met(found):
            return min(met, key=lambda own: own.optimum.effort)
        return min(found, key=lambda own: own.optimum.lacks, default=None)

    def _load_paths(self) -> list[LoadPath]:
        """Return load paths to begin with: to what is near, then straight ones from rest."""
        own = [] if self.begin is None else [self.begin]
        if self.begin is not None and rubs(self.task.scene):
            slid = self._slid(self.begin)[: self.task.starts]
            return [(*self.begin, tuple(T.tolist())) for T in slid]
        most = max(self.task.starts - len(own), 0) if self.task.starts else None
        return own + [(tuple(T.tolist()),) for T in self._starts()[:most]]

    def _from(self, load_path: LoadPath) -> list[LocalOptimum]:
        """Return the optimum that a load path leads to; none where the arm comes to no rest."""
        tell("initial guesses")
        check_time()
        program = self._program(_ROUGH)
        last = np.clip(load_path[-1], program.lower, program.upper)
        try:
            start = _along(program, (*load_path[:-1], tuple(last.tolist())))
            end = solve(program, start, _CLOSER * self.task.accuracy, _ABOUT)
        except OctoplanError:
            return []
        if self.begin is not None and program.has_history:
            return [LocalOptimum(end, self.begin)]
        return [LocalOptimum(end, (*load_path[:-1], tuple(last.tolist())))]

    def _finished(self, found: list[LocalOptimum]) -> LocalOptimum | None:
        """Return the best optimum on a fine mesh, where a load path leads to it."""
        left, program = list(found), self._program(_FINE)
        while left:
            best = self._best(left)
            assert best is not None
            ways = [best.load_path] if rubs(self.task.scene) else best.load_paths()
            for load_path in ways:
                start = self._there(program, load_path, best.optimum.terms)
                if start is not None:
                    end = solve(program, start, _CLOSER * self.task.accuracy)
                    own = LocalOptimum(end, load_path)
                    if self._there(program, load_path, end.terms) is not None:
                        return own
            left.remove(best)
        return self._best(found)

    def _program(self, refinement: int) -> Program:
        return _program(self.task, refinement, self.begin)

    def _there(
        self, program: Program, load_path: LoadPath, terms: SettledTerms
    ) -> SettledTerms | None:
        """Return the terms under these tensions on a load path; None if it leads elsewhere."""
        try:
            found = _along(program, (*load_path, tuple(terms.tensions.tolist())))
        except OctoplanError:
            return None
        off = np.abs(_tip(found) - _tip(terms)).max()
        return found if off < 0.01 * self.task.arm.length else None

    def _starts(self) -> list[Array]:
        """Return tensions to begin with: of the free arm, and bends towards targets."""
        task, found = self.task, list[Array]()
        natural = np.minimum(natural_tensions(task.arm), np.array(task.allowed.upper))
        towards = self._towards(natural)
        if any(isinstance(target, Hold) for target in task.targets):
            found += self._pressing(towards)
        if not all(isinstance(target, Hold) for target in task.targets):
            with suppress(OctoplanError):
                found.append(self._free())
        return found + [share * own for own in towards for share in _BENDS]

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

    def _free(self) -> Array:
        """Return the tensions of the arm that meets the targets without contact."""
        task = self.task
        effects = (e for e in task.scene.effects if not isinstance(e, Contact))
        free = replace(task, scene=Scene(*effects), starts=_FREE)
        bodies = tuple(own.obstacle for own in contacts(task.scene))
        if any(isinstance(target, Wrap) for target in task.targets):
            return np.ravel(Around(free, Surroundings(bodies)).run(None)[0].tensions)
        return np.ravel(Search(free).run().tensions)

    def _pressing(self, directions: list[Array]) -> list[Array]:
        """Return the bends that press on what is held so that least is lacking.

        Each direction is followed from rest, harder and harder, up to where the arm jumps: beyond
        it has slipped off.
        """
        program, found = self._program(_ROUGH), list[tuple[float, Array]]()
        for own in directions:
            near: SettledTerms | None = None
            for share in _HARDER:
                check_time()
                T = np.clip(share * own, program.lower, program.upper)
                try:
                    near = program.evaluate(T, near, None)
                except OctoplanError:
                    break
                found.append((lacking(near), T))
        return [T for _, T in sorted(found, key=lambda one: one[0])[:_PRESSED]]

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


@dataclass(frozen=True, eq=False)
class LocalOptimum:
    """An optimum, and the load path to where its steps began."""

    optimum: Optimum
    load_path: LoadPath

    def load_paths(self) -> list[LoadPath]:
        """Return load paths to the optimum: from rest alone, then by more and more of the steps."""
        steps = [tuple(T.tolist()) for T in self.optimum.steps]
        parts = [steps[:: len(steps) // 2**n] for n in range(len(steps).bit_length())]
        return [(), self.load_path, *((*self.load_path, *part[1:]) for part in parts)]


def _along(program: Program, load_path: LoadPath) -> SettledTerms:
    """Return the terms at the end of a load path; raises what settling does."""
    if program.has_history:
        return program.evaluate(np.array(load_path[-1]), None, None)
    here: SettledTerms | None = program.evaluate(np.array(load_path[0]), None, None)
    for T in load_path[1:]:
        assert here is not None
        here = followed(np.array(T), here, partial(_near, program))
        if here is None:
            raise SnapError(1.0, "the arm jumps on its load path")
    assert here is not None
    return here


def _near(program: Program, tensions: Array, here: SettledTerms) -> SettledTerms | None:
    try:
        return program.evaluate(tensions, here, None)
    except OctoplanError:
        return None


def _program(task: Task, refinement: int, history: LoadPath | None = None) -> Program:
    """Return the program on meshes of a refinement; with friction from the end of a load path."""
    before = (history or ()) if rubs(task.scene) else ()
    asked = task.arm, task.scene, task.targets, refinement, task.machine_code
    settling = Settling(*asked, before)
    units = natural_tensions(task.arm)
    total = np.inf if task.limits.total is None else task.limits.total
    low, high = np.array(task.allowed.lower), np.array(task.allowed.upper)
    return Program(settling.at, low, high, total, float(units.max()), units, bool(before))


def _tip(terms: SettledTerms) -> Array:
    system = terms.here.system
    return np.asarray(terms.here.states[system.of.nodes[-1, 4:7]])


def optimality_of(task: Task, tensions: Array, load_path: LoadPath = ()) -> float:
    """Return the residual of the first-order conditions at tensions (n_tendons,), scaled.

    Where a load path leads to.
    """
    program = _program(task, _FINE, load_path)
    try:
        return optimum_at(program, _along(program, (*load_path, tuple(tensions.tolist())))).kkt
    except OctoplanError:
        return np.inf
