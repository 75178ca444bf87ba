"""The search for plans in contact: optima, from several guesses, that the arm comes to."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from operator import attrgetter

import numpy as np

from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.extensions.contact.effects import contacts, without_contacts, without_friction
from octoplan.model.extensions.contact.sharp import close
from octoplan.model.extensions.obstacles.base import Convex
from octoplan.model.paths import Array, Mask
from octoplan.model.shape import Shape
from octoplan.model.support.errors import OctoplanError, UnsettledContactError
from octoplan.model.support.progress import OutOfTime, check_time, report, reserve
from octoplan.planner.certificate import Optimality
from octoplan.planner.extensions.contact.hold import Hold
from octoplan.planner.extensions.contact.load_path import (
    ON_THE_PATH,
    LoadPath,
    from_rest,
    rubs,
    settled_along,
)
from octoplan.planner.extensions.contact.optimum import MET, ContactOptimum, first_order, optimum
from octoplan.planner.extensions.contact.program import TensionProgram
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.solution import Solution, Trial, n_equal_optima
from octoplan.planner.solve.guesses import BendCoordinates, initial_guesses, many_places
from octoplan.planner.solve.relaxation_stage import N_EQUAL_OPTIMA, RelaxationStage
from octoplan.planner.targets.backbone import Backbone

# Refinement of the search's mesh.
COARSE = 1
# Refinement of the mesh of plans.
FINE = 2 * COARSE
# Time for shape and certificate, which are more accurate, over the time for one step of the load
# path in the search. The path itself is not settled again.
CERTIFICATE_TIME = 4.0
# Largest rotation of frames between two meshes for the same equilibrium [rad].
_SAME = 0.1
# Numbers of legs of the load paths that are tried if the straight path leads elsewhere. The
# certificate settles each leg.
_LEGS = (1, 3, 8)
# Smallest share of a wrench, the factor from one share to the next, and the share from which the
# next is all of the wrench.
_LEAST_SHARE, _GROWTH, _NEARLY = 1e-3, 2.5, 0.7
# Largest number of guesses that are left because they press against the wrench.
_MOST_LEFT = 4
# Violation, over the size of the share, with which a share of a wrench counts as balanced.
_BALANCED = 1e-2
# Shares of the change of tensions to the optimum without friction.
_SLID = (1.0, 1.5, 2.5)
# Number of arms that are drawn for a hold; number of the nearest of these, around which as many
# arms are drawn again; spread of the logarithms of their bends.
_DRAWN, _NEAREST, _SPREAD = 3000, 150, 0.3


def _trials(optima: Sequence[ContactOptimum]) -> tuple[Trial, ...]:
    """Return one trial for each optimum."""
    return tuple(Trial(end.cost[-1], end.is_optimal, 0) for end in optima)


class ContactSearch:
    """The search for the least tensions of an arm in contact.

    `begin` is the load path to an equilibrium nearby, with its tensions last, or None for an arm at
    rest. The search begins there. With friction, which acts against the motion from there, it tries
    no other start.
    """

    def __init__(self, task: PlanningProblem, begin: LoadPath | None = None) -> None:
        self.task, self.begin = task, begin
        self.optima = list[ContactOptimum]()
        self.best: ContactOptimum | None = None

    def run(self) -> Solution:
        """Return the best optimum from the guesses, or the best so far if the time is over.

        The tensions at which the search began if there is no optimum.
        """
        stopped, nearby = False, [] if self.begin is None else [self.begin]
        try:
            self._search_with_friction() if rubs(self.task.scene) else self._search(nearby)
            check_time()
        except OutOfTime:
            stopped = True
        best = self.best or min(self.optima, key=attrgetter("cost"), default=None)
        if best is not None and self.best is None:
            # The certificate has no time for all steps of a search that was cut short.
            legs = max(len(self.begin or ()), 1)
            best = replace(best, load_path=best.load_path[:legs])
        trials, exact = _trials(self.optima), best is not None and not best.violation
        mesh = FINE if best is None else max(best.refinement, FINE)
        options = self.task.options.replace(mode="exact" if exact else "nearest", refinement=mesh)
        if best is None:
            path = self.begin or (self.task.allowed.lower,)
            T = self.task.arm.by_section(np.array(path[-1]))
            return Solution(options, T, (), (), trials, stopped, load_path=path)
        T, multipliers = self.task.arm.by_section(best.point.tensions), (best.lam_x, best.lam_g)
        options, way = options.replace(modes=len(best.lam_g)), best.load_path
        return Solution(options, T, *multipliers, trials, stopped, load_path=way)

    def _search_with_friction(self) -> None:
        """Find optima with friction, from the optimum without friction.

        While the arm sticks, its shape does not depend on the tensions. Therefore the starts are
        the tensions of the optimum without friction, and beyond.
        """
        if self.begin is None:
            lower = np.array(self.task.allowed.lower)
            self.begin = from_rest(self.task.arm, lower, self.task.scene)
        # The optimum without friction, from the begin of the motion.
        smooth = replace(self.task, scene=without_friction(self.task.scene), guesses=2)
        free = np.ravel(ContactSearch(smooth, self.begin).run().tensions)
        program = TensionProgram(self.task, FINE, load_path=self.begin)
        assert program.begin is not None
        for factor in _SLID[: self.task.guesses]:
            T = program.begin.tensions
            start = np.maximum(T + factor * (free - T), self.task.allowed.lower)
            with suppress(OctoplanError):
                end = replace(optimum(program, program.begin, start), load_path=self.begin)
                self.optima.append(end)
                if end.is_optimal:
                    break

    def _search(self, nearby: Sequence[LoadPath], needed: float = 1) -> None:
        """Find optima until enough are equal to the best, or all guesses are used.

        From load paths nearby, `needed` optima are enough; otherwise two, or three for holds, of
        which two may have many times the least effort. If three guesses miss the targets with the
        default stability margin, the search continues without margin from the nearest of these.
        """
        task, stated = self.task, self.task.options
        hasty = task.best_margin and stated.margin > stated.floor
        coarse = TensionProgram(task, COARSE, stated.stability_bound)
        fine = TensionProgram(task, FINE, stated.stability_bound)
        from_all = np.inf if task.guesses else N_EQUAL_OPTIMA + bool(coarse.holds)
        reaching = chain.from_iterable(_free_arms_reaching(task, hold) for hold in coarse.holds)
        guesses = reaching if coarse.holds else initial_guesses(task)
        from_rest = ((tuple(T.tolist()),) for T in guesses)
        n_left = 0
        for tried, load_path in enumerate(chain(nearby, from_rest), 1):
            report("initial guesses", tried - 1, task.max_guesses)
            with suppress(OctoplanError):
                touching = coarse.along(load_path)
                if n_left < _MOST_LEFT and presses_against(coarse, touching):
                    n_left += 1
                    continue
                begin, grown = with_growing_wrench(coarse, touching)
                end = optimum(coarse, begin)
                end = replace(end, load_path=(*load_path, *grown, *end.load_path))
                cheapest = all(end.cost < each.cost for each in self.optima)
                self.optima.append(end)
                if not end.violation and cheapest and n_equal_optima(_trials(self.optima)) < 2:
                    self.best = self._refined_optimum(fine, end)
            enough = n_equal_optima(_trials(self.optima)) >= (
                from_all if tried > len(nearby) else needed
            )
            missed = hasty and self.best is None and len(self.optima) > N_EQUAL_OPTIMA
            if enough or missed or tried == task.max_guesses:
                break
        ends = sorted(self.optima, key=attrgetter("cost"))
        if hasty and self.best is None:
            self.task = replace(task, options=stated.replace(margin=0.0), best_margin=False)
            self._search([end.load_path for end in ends[:1]], from_all)
            return
        for end in () if self.best else ends:
            with suppress(OctoplanError):
                self.best = self._refined_optimum(fine, end)
                return

    def _refined_optimum(self, fine: TensionProgram, end: ContactOptimum) -> ContactOptimum:
        """Return the optimum on the fine mesh that the arm reaches by a short load path.

        Raises UnsettledContactError if the arm does not reach the optimum.
        """
        arm, scene, T = self.task.arm, self.task.scene, end.point.tensions
        for way in _short_paths(end.load_path):
            with suppress(OctoplanError):
                begun = time.monotonic()
                shape = settled_along(arm, way, T, scene, ON_THE_PATH, self.task.machine_code)
                per_step = (time.monotonic() - begun) / (len(way) + 1)
                there = fine.settled(T, shape.collocated)
                if close(there, end.point, _SAME):
                    refined = self._on_finer_mesh(fine, optimum(fine, there))
                    if bool(refined.violation) == bool(end.violation):
                        reserve(CERTIFICATE_TIME * per_step)
                        return replace(refined, load_path=way)
        raise UnsettledContactError(1.0, "the arm does not come to the optimum")

    def _on_finer_mesh(self, program: TensionProgram, end: ContactOptimum) -> ContactOptimum:
        """Return an optimum that meets the constraints on a mesh of twice the elements, too.

        Wrenches of contact forces converge more slowly than positions.
        """
        if not program.holds or end.violation:
            return end
        with suppress(OutOfTime):
            finer = TensionProgram(self.task, 2 * FINE, program.least)
            there = finer.settled(end.point.tensions, end.point)
            violation = finer.at(end.point.tensions / finer.unit, there).violation
            if violation > MET * self.task.accuracy:
                return optimum(finer, there)
        return end


def presses_against(program: TensionProgram, point: Equilibrium) -> bool:
    """Return whether contact forces leave more of the held wrenches than no forces would."""
    if not program.holds:
        return False
    least = program.at(point.tensions / program.unit, point).grasp.least
    return bool(np.linalg.norm(least) > np.sqrt(len(program.holds)))


def with_growing_wrench(
    program: TensionProgram, begin: Equilibrium
) -> tuple[Equilibrium, LoadPath]:
    """Return the equilibrium in which an arm holds nearly all of the wrenches, and the tensions.

    A guess touches the object in about the right direction, but presses too little. Least
    violation of all of the wrench may lead to another edge or side of the object. Therefore the
    wrench grows from the size of the forces of the guess, and each share is balanced in turn. The
    growth ends where a share cannot be balanced.
    """
    path: LoadPath = ()
    if not program.holds:
        return begin, path
    still = program.at(begin.tensions / program.unit, begin).grasp.still
    arm = program.task.arm
    wrench = np.concatenate([hold.scaled(arm) / hold.size(arm) for hold in program.holds])
    share = float(np.linalg.norm(still - wrench) / np.linalg.norm(wrench))
    share = max(share, _LEAST_SHARE)
    while share < _NEARLY:
        with suppress(OctoplanError):
            end = optimum(program.with_wrenches(share), begin, enough=_BALANCED)
            if end.violation > _BALANCED:
                break
            begin, path = end.point, (*path, *end.load_path, tuple(end.point.tensions.tolist()))
            share *= _GROWTH
            continue
        break
    return begin, path


def _short_paths(load_path: LoadPath) -> Iterator[LoadPath]:
    """Yield load paths to the end of a long one, from the shortest: straight, then in few legs."""
    yield ()
    for legs in sorted({min(each, len(load_path)) for each in _LEGS} - {0}):
        kept = np.linspace(0, len(load_path), legs, endpoint=False).astype(int)
        yield tuple(load_path[i] for i in kept)


def _free_arms_reaching(task: PlanningProblem, hold: Hold) -> Iterator[Array]:
    """Yield tensions of free arms that, under their loads, would penetrate the held object.

    The starts are arms without loads that penetrate the object. For each, a plan finds the tensions
    that bring the deepest place there under loads. Arms that are clear of other obstacles come
    first; then arms whose contact force would balance the wrench within the cone of friction, by
    increasing effort. Few drawn arms reach a
    small object; as many again are drawn around the nearest arms.
    """
    arm, body, rng = task.arm, hold.obstacle, np.random.default_rng(0)
    others = [each.obstacle for each in contacts(task.scene) if each.obstacle != body]
    tendons = frozenset(j for j in range(arm.n_tendons) if task.allowed.upper[j] > 0)
    bends = BendCoordinates(arm, tendons, task.allowed)

    def deepest(points: Array) -> tuple[Array, Array, Array, Array, Mask]:
        """Return tensions, and the place of the smallest gap of each arm: position, s and gap.

        Then whether the arm goes through another obstacle.
        """
        tensions = bends.tensions(points)
        places, s = many_places(task, tensions)
        radii = arm.outer_radius(s)[0]

        def gaps_from(obstacle: Convex) -> Array:
            gaps = obstacle.distance(places.reshape(-1, 3)).reshape(places.shape[:2]) - radii
            return np.where(np.isnan(gaps), np.inf, gaps)

        gaps = gaps_from(body)
        through = [gaps_from(other).min(axis=1) < 0 for other in others]
        each, k = np.arange(len(gaps)), gaps.argmin(axis=1)
        hits = np.any([*through, np.zeros(len(gaps), dtype=bool)], axis=0)
        return tensions, places[each, k], s[k], gaps[each, k], hits

    points = bends.draw(_DRAWN)
    *_, gaps, _ = deepest(points)
    nearest = points[np.argsort(gaps, kind="stable")[:_NEAREST]]
    around = np.repeat(nearest, _DRAWN // _NEAREST, axis=0)
    points = np.vstack([points, around * np.exp(_SPREAD * rng.normal(size=around.shape))])
    tensions, places, s, gaps, hits = deepest(points)
    reaches = gaps < 0
    tensions, places, s = tensions[reaches], places[reaches], s[reaches]
    hits = hits[reaches]
    force = np.array(hold.wrench[:3])
    force /= max(float(np.linalg.norm(force)), 1e-300)
    against = body.gradient(places) @ force if len(places) else np.zeros(0)
    within = np.minimum(against, 1 / np.hypot(1.0, hold.friction)).round(1)
    options, scene = task.options.replace(margin=0.0), without_contacts(task.scene)
    for i in np.lexsort((np.linalg.norm(tensions, axis=1), -within, hits)):
        there = Backbone((tuple(places[i].tolist()),), (float(s[i]),))
        free = replace(task, targets=(there,), scene=scene, options=options)
        loaded = RelaxationStage(free, "closest").solve_from(tensions[i])
        yield tensions[i] if loaded is None else loaded.tensions


def optimality_of(
    task: PlanningProblem, tensions: Array, shape: Shape, load_path: LoadPath = ()
) -> Optimality:
    """Return the first-order conditions at tensions (n_tendons,), of the shape of a load path."""
    with suppress(OctoplanError):
        bound = task.options.stability_bound * task.options.modes
        program = TensionProgram(task, task.options.refinement, bound, load_path)
        # Twice: the gap's curvature at contact points is that of the mesh it comes from.
        on_mesh = program.begin or program.map.solve(tensions, shape.collocated)
        begin = program.begin or program.settled(tensions, on_mesh)
        at = program.at(tensions / program.unit, begin)
        return first_order(program, at)
    return Optimality(np.inf)
