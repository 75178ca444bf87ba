"""The search for plans in contact: optima from several guesses, the best of them on a fine mesh."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from math import isfinite
from time import monotonic

import numpy as np

from model.contact.forward import TouchingMap
from model.equilibrium.forward import STAGES
from model.equilibrium.linearised import Linearised
from model.errors import InputError, OctoplanError
from model.loads import contacts, is_loaded, without_friction
from model.paths import Array
from model.progress import tell
from model.scene import Scene
from model.shape import Shape
from model.time_limit import OutOfTime, check_time, end, time_limit
from planner.contact.load_path import LoadPath, rubs
from planner.contact.optimum import Equilibria, Optimum
from planner.initial_guess.guesses import initial_guesses
from planner.initial_guess.many_arms import bend_coordinates, many_places
from planner.program.limits import natural_tensions
from planner.program.statement import Mode
from planner.program.terms import compliance_requests
from planner.solve.task import SearchResult, Task, Trial
from planner.targets.base import Target
from planner.targets.hold import Hold
from planner.targets.wrap import Wrap

# Meshes for the search and for the best optimum; the relative difference in effort of one optimum.
ROUGH, FINE, _SAME = 1, 2, 1e-3
# The fraction of a time limit that the search may take, the rest is for the fine mesh.
_SEARCHED = 0.6
# Where the arm would snap it is held to so much stability.
_FLOOR = 1e-2
# How far the tip may be from where a load path leads, over the arm's length.
_ELSEWHERE = 1e-2
# The fraction of a stability margin that an optimum has to have.
_CLOSE = 1 - 1e-6
# What is taken of the way to tensions without friction, and beyond.
_SLID = (1.0, 1.5, 2.5)
# Bends towards targets, in natural tensions, and towards what is held, harder and harder.
_BENDS, _HARDER = (0.3, 1.0, 2.0), 0.25 * 1.5 ** np.arange(8)
# Arms that are drawn, and those that are tried, no deeper in what they hold, over their length.
_DRAWN, _TRIED, _DEEP = 3000, 8, 0.2


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
    TouchingMap(task.arm, task.scene, STAGES, ROUGH)


def check_holds(targets: tuple[Target, ...], scene: Scene) -> None:
    """Raise InputError for what is held and is no contact of the scene."""
    bodies = [contact.obstacle for contact in contacts(scene)]
    for target in targets:
        if isinstance(target, Hold) and target.obstacle not in bodies:
            allowed = "an obstacle that the scene has as a Contact"
            raise InputError("Hold.obstacle", target.obstacle, allowed)


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
        self.optima = list[Local]()

    def run(self, seconds: float | None) -> SearchResult:
        """Return the best optimum from the guesses, or the best so far after so long."""
        stopped, best = False, None
        with time_limit(seconds):
            try:
                left = end() - monotonic()
                with time_limit(_SEARCHED * left if isfinite(left) else None):
                    self._slide() if rubs(self.task.scene) else self._search()
                    check_time()
            except OutOfTime:
                stopped = True
            try:
                best = self._best()
                check_time()
            except OutOfTime:
                stopped = True
        return self._result(best, stopped)

    def _slide(self) -> None:
        """Find optima against friction, by what the targets take without.

        Where the arm still sticks no tensions tell how to move it: steps begin at those that it
        takes without friction, and beyond.
        """
        assert self.begin is not None
        scene = without_friction(self.task.scene)
        smooth, T = replace(self.task, scene=scene, starts=1), np.array(self.begin[-1])
        free = T
        for begin in (self.begin, None):
            smooth_plan = ContactSearch(smooth, begin).run(None)
            free = np.ravel(smooth_plan.tensions)
            if smooth_plan.statement.mode == "exact" or smooth_plan.stopped:
                break
        fine, low = Equilibria(self.task, FINE), np.array(self.task.allowed.lower)
        here = fine.along(self.begin)
        for factor in _SLID[: self.task.starts]:
            with suppress(OctoplanError):
                start = np.maximum(T + factor * (free - T), low)
                self.optima.append(Local(fine.optimum(here, start), self.begin))

    def _search(self) -> None:
        """Find optima until two agree on the best, or there are as many as are asked for."""
        rough, ends = Equilibria(self.task, ROUGH), list[tuple[Array, Local | None]]()
        close = _SAME * float(np.max(natural_tensions(self.task.arm)))
        for tried, (before, T) in enumerate(self._begun(rough), 1):
            tell("initial guesses", tried - 1, self.task.most)
            tried_before = [local for begin, local in ends if np.abs(begin - T).max() < close]
            local = (
                tried_before[0] if tried_before else self._from(rough, (*before, tuple(T.tolist())))
            )
            ends.append((T, local))
            if local is not None:
                self.optima.append(local)
            met = sorted(one.optimum.effort for one in self.optima if not one.optimum.violation)
            agreed = len(met) > 1 and met[1] < met[0] * (1 + _SAME)
            followed = self.begin is not None and tried == len(met) == 1
            if followed or (agreed and self.task.starts is None) or tried == self.task.most:
                return

    def _begun(self, rough: Equilibria) -> Iterator[tuple[LoadPath, Array]]:
        """Yield load paths and the tensions at their ends: what is near, then others from rest."""
        if self.begin is not None:
            yield self.begin[:-1], np.array(self.begin[-1])
        yield from (((), T) for T in guesses(self.task, rough))

    def _from(self, rough: Equilibria, load_path: LoadPath) -> Local | None:
        """Return the optimum that a load path leads to; None where the arm comes to no rest."""
        least = max(self.task.statement.margin, _FLOOR)
        try:
            here = rough.along(load_path)
            optimum = rough.optimum(here)
            if optimum.stability < least and not self._is_stable(optimum):
                optimum = rough.optimum(here, least=least)
        except OctoplanError:
            return None
        return Local(optimum, load_path[:-1])

    def _is_stable(self, optimum: Optimum) -> bool:
        """Return whether an optimum meets the targets and is as stable as it has to be."""
        margin = max(self.task.statement.margin * _CLOSE, 0.0)
        return not optimum.violation and optimum.stability >= margin

    def _best(self) -> Local | None:
        """Return the best optimum on the fine mesh to which a load path leads."""
        order = sorted(
            self.optima, key=lambda local: (local.optimum.violation, local.optimum.effort)
        )
        if rubs(self.task.scene):
            return order[0] if order else None
        fine = Equilibria(self.task, FINE) if order else None
        for rough in order:
            assert fine is not None
            for path in rough.load_paths():
                local = self._on_fine(fine, rough, path)
                if local is not None:
                    return local
        return order[0] if order else None

    def _on_fine(self, fine: Equilibria, rough: Local, path: LoadPath) -> Local | None:
        """Return the optimum on the fine mesh if a load path leads there."""
        old, far = rough.optimum, _ELSEWHERE * self.task.arm.length
        try:
            start = fine.along((*path, old.steps[-1]))
            optimum = (
                fine.optimum(start, least=old.least) if _apart(start, old.here) < far else None
            )
            if optimum is None or bool(optimum.violation) != bool(old.violation):
                return None
            there = fine.along((*path, optimum.steps[-1]))
        except OctoplanError:
            return None
        return Local(optimum, path) if _apart(there, optimum.here) < far else None

    def _result(self, best: Local | None, stopped: bool) -> SearchResult:
        """Return what is told of the best; of where the search began where there is none."""
        ends = [local.optimum for local in self.optima]
        trials = tuple(Trial(optimum.effort, not optimum.violation, 0) for optimum in ends)
        exact = best is not None and not best.optimum.violation
        mode: Mode = "exact" if exact else "nearest"
        statement = self.task.statement.but(mode=mode, refinement=FINE)
        if best is None:
            *way, last = self.begin or (self.task.allowed.lower,)
            T = self.task.arm.by_section(np.array(last))
            return SearchResult(statement, T, (), (), trials, stopped, load_path=tuple(way))
        optimum = best.optimum
        lam_g = (optimum.optimality.lam_stability,) if optimum.least else ()
        statement = statement.but(
            modes=int(optimum.least > 0), floor=optimum.least or statement.floor
        )
        T = self.task.arm.by_section(np.clip(optimum.here.tensions, *self._limits))
        lam_x = tuple(optimum.optimality.lam_bounds.tolist())
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
    fine = Equilibria(task, FINE)
    try:
        if rubs(task.scene):
            end = fine.near(fine.along(load_path))(tensions)
            return fine.optimality(end[0], lambda _: end, 0.0).residual
        here, least = fine.map.solve(tensions, shape.known), task.statement.least
        least *= task.statement.modes
        return fine.optimality(here, fine.near(here), least).residual
    except OctoplanError:
        return np.inf


def guesses(task: Task, rough: Equilibria) -> Iterator[Array]:
    """Yield tensions (n_tendons,) [N], the likeliest first."""
    towards = _towards(task)
    if any(isinstance(target, Hold) for target in task.targets):
        yield from _pressing(task, rough, towards)
        return
    question = task.arm, task.simple.scene, task.targets, task.allowed, task.machine_code
    yield from initial_guesses(*question, is_loaded(task.simple.scene))
    yield from (factor * tensions for tensions in towards for factor in _BENDS)


def _pressing(task: Task, rough: Equilibria, towards: list[Array]) -> Iterator[Array]:
    """Yield tensions of arms that press on what they hold."""
    low, high = np.array(task.allowed.lower), np.array(task.allowed.upper)
    holds = [target for target in task.targets if isinstance(target, Hold)]
    yield from (
        _pressed(rough, [np.clip(c * natural, low, high) for c in _HARDER]) for natural in towards
    )
    for hold in holds:
        yield from _reaching(task, hold)


def _pressed(rough: Equilibria, row: list[Array]) -> Array:
    """Return those of growing tensions that leave least of the wrenches, up to where it snaps."""
    trials, here = [(np.inf, row[0])], None
    with suppress(OctoplanError):
        for T in row:
            check_time()
            here = rough.settled(T, here)
            trials.append((rough.wrench_left(here), T))
    return min(trials, key=lambda trial: trial[0])[1]


def _reaching(task: Task, hold: Hold) -> list[Array]:
    """Return tensions of arms without loads that free would reach into what is held.

    First those that would be pressed apart from it along what balances the wrench, within the cone
    of friction; of these the least tensions first.
    """
    arm, body = task.arm, hold.obstacle
    tendons = frozenset(j for j in range(arm.n_tendons) if task.allowed.upper[j] > 0)
    bends = bend_coordinates(arm, tendons, task.allowed)
    tensions = bends.tensions(bends.draw(_DRAWN))
    points, radius = many_places(arm, task.simple.scene, tensions, task.machine_code)
    gap = body.distance(points.reshape(-1, 3)).reshape(points.shape[:2]) - radius
    gap[np.isnan(gap)] = np.inf
    deepest = gap.argmin(axis=1)
    depth = -gap[np.arange(_DRAWN), deepest]
    reach = np.flatnonzero((depth > 0) & (depth < _DEEP * arm.length))
    force = np.array(hold.wrench[:3])
    against = body.gradient(points[reach, deepest[reach]]) @ force if reach.size else np.zeros(0)
    against = against / max(float(np.linalg.norm(force)), 1e-300)
    effort = np.linalg.norm(tensions[reach], axis=1)
    within = np.minimum(against, 1 / np.hypot(1.0, hold.friction)).round(1)
    return [tensions[i] for i in reach[np.lexsort((effort, -within))][:_TRIED]]


def _towards(task: Task) -> list[Array]:
    """Return the natural tensions of the tendons on the sides of what targets are about."""
    arm, tensions = task.arm, list[Array]()
    natural = np.minimum(natural_tensions(arm), np.array(task.allowed.upper))
    frame = np.array(arm.base_frame)
    angles = np.array([phi for _, phi in arm.tendons])
    for target in task.targets:
        point = target.guess_towards(arm)
        if point is not None:
            n, b = (point - np.array(arm.base_position)) @ frame[:, 1:]
            along = (np.cos(angles) * n + np.sin(angles) * b) / max(np.hypot(n, b), 1e-12)
            tensions.append(natural * np.maximum(along, 0.0))
    return tensions
