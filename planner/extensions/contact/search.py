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
from octoplan.model.extensions.contact.effects import without_friction
from octoplan.model.extensions.contact.sharp import close
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.support.errors import OctoplanError, UnsettledContactError
from octoplan.model.support.progress import OutOfTime, check_time, report, reserve
from octoplan.planner.certificate import Optimality
from octoplan.planner.extensions.contact.load_path import (
    ON_THE_PATH,
    LoadPath,
    from_rest,
    rubs,
    settled_along,
)
from octoplan.planner.extensions.contact.optimum import MET, ContactOptimum, first_order, optimum
from octoplan.planner.extensions.contact.program import TensionProgram
from octoplan.planner.extensions.contact.touching import arms_that_touch
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.solution import Solution, Trial, n_equal_optima
from octoplan.planner.solve.guesses import initial_guesses
from octoplan.planner.solve.multistart import N_EQUAL_OPTIMA

# Refinement of the search's mesh.
COARSE = 1
# Refinement of the mesh of plans.
FINE = 2 * COARSE
# Refinements of the meshes on which an optimum has to meet the constraints, in this order, until
# the constraints are met without a further optimum.
_FINER = 2 * FINE, 4 * FINE, 8 * FINE
# Time for shape and certificate, which are more accurate, over the time for one step of the load
# path in the search. The path itself is not settled again.
CERTIFICATE_TIME = 6.0
# Largest rotation of frames between two meshes for the same equilibrium [rad].
_SAME = 0.1
# Numbers of legs of the load paths that are tried if the straight path leads elsewhere. The
# certificate settles each leg.
_LEGS = (1, 3, 8)
# Smallest share of a wrench; the factor from one share to the next at first, of which the root is
# taken if a share cannot be balanced; the factor at which the growth ends.
_LEAST_SHARE, _GROWTH, _SLOWEST = 0.05, 4.0, 1.5
# Largest number of guesses that are left because they press against the wrench.
_MOST_LEFT = 4
# Violation, over the size of the share, with which a share of a wrench counts as balanced.
_BALANCED = 1e-2
# Shares of the change of tensions to the optimum without friction.
_SLID = (1.0, 1.5, 2.5)


def _trials(optima: Sequence[ContactOptimum]) -> tuple[Trial, ...]:
    """Return one trial for each optimum."""
    return tuple(Trial(end.cost[-1], end.is_optimal, 0) for end in optima)


class ContactSearch:
    """The search for the least tensions of an arm in contact.

    `begin` is the load path to an equilibrium nearby, with its tensions last, or None for an arm at
    rest. The search begins there. With friction, which acts against the motion from there, it tries
    no other start.
    """

    def __init__(self, problem: PlanningProblem, begin: LoadPath | None = None) -> None:
        self.problem, self.begin = problem, begin
        self.optima = list[ContactOptimum]()
        self.best: ContactOptimum | None = None

    def run(self) -> Solution:
        """Return the best optimum from the guesses, or the best so far if the time is over.

        The tensions at which the search began if there is no optimum.
        """
        stopped, nearby = False, [] if self.begin is None else [self.begin]
        try:
            self._search_with_friction() if rubs(self.problem.scene) else self._search(nearby)
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
        options = self.problem.options.replace(
            mode="exact" if exact else "nearest", refinement=mesh
        )
        if best is None:
            path = self.begin or (self.problem.allowed.lower,)
            T = self.problem.arm.by_section(np.array(path[-1]))
            return Solution(options, T, (), (), trials, stopped, load_path=path)
        T, multipliers = self.problem.arm.by_section(best.point.tensions), (best.lam_x, best.lam_g)
        options, way = options.replace(modes=len(best.lam_g)), best.load_path
        return Solution(options, T, *multipliers, trials, stopped, load_path=way)

    def _search_with_friction(self) -> None:
        """Find optima with friction, from the optimum without friction.

        While the arm sticks, its shape does not depend on the tensions. Therefore the starts are
        the tensions of the optimum without friction, and beyond.
        """
        if self.begin is None:
            lower = np.array(self.problem.allowed.lower)
            self.begin = from_rest(self.problem.arm, lower, self.problem.scene)
        # The optimum without friction, from the begin of the motion.
        smooth = replace(self.problem, scene=without_friction(self.problem.scene), guesses=2)
        free = np.ravel(ContactSearch(smooth, self.begin).run().tensions)
        program = TensionProgram(self.problem, FINE, load_path=self.begin)
        assert program.begin is not None
        for factor in _SLID[: self.problem.guesses]:
            T = program.begin.tensions
            start = np.maximum(T + factor * (free - T), self.problem.allowed.lower)
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
        problem, stated = self.problem, self.problem.options
        hasty = problem.best_margin and stated.margin > stated.floor
        coarse = TensionProgram(problem, COARSE, stated.stability_bound)
        fine = TensionProgram(problem, FINE, stated.stability_bound)
        from_all = np.inf if problem.guesses else N_EQUAL_OPTIMA + bool(coarse.holds)
        guesses: Iterator[tuple[LoadPath, Equilibrium | None]]
        guesses = (((tuple(T.tolist()),), None) for T in initial_guesses(problem))
        if coarse.holds:
            guesses = chain.from_iterable(arms_that_touch(coarse, hold) for hold in coarse.holds)
        begun = ((load_path, None) for load_path in nearby)
        n_left = 0
        for tried, (load_path, touching) in enumerate(chain(begun, guesses), 1):
            report("initial guesses", tried - 1, problem.max_guesses)
            is_from_rest = tried > len(nearby)
            with suppress(OctoplanError):
                point = touching or coarse.along(load_path)
                if n_left < _MOST_LEFT and presses_against(coarse, point):
                    n_left += 1
                    continue
                begin, grown = with_growing_wrench(coarse, point)
                end = optimum(coarse, begin)
                end = replace(end, load_path=(*load_path, *grown, *end.load_path))
                cheapest = all(end.cost < each.cost for each in self.optima)
                self.optima.append(end)
                if not end.violation and cheapest and n_equal_optima(_trials(self.optima)) < 2:
                    self.best = self._refined_optimum(fine, end)
            enough = n_equal_optima(_trials(self.optima)) >= (from_all if is_from_rest else needed)
            missed = hasty and self.best is None and len(self.optima) > N_EQUAL_OPTIMA
            if enough or missed or tried == problem.max_guesses:
                break
        ends = sorted(self.optima, key=attrgetter("cost"))
        if hasty and self.best is None:
            self.problem = replace(problem, options=stated.replace(margin=0.0), best_margin=False)
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
        arm, scene, T = self.problem.arm, self.problem.scene, end.point.tensions
        for way in _short_paths(end.load_path):
            with suppress(OctoplanError):
                begun = time.monotonic()
                path = (*way, tuple(T.tolist()))
                shape = settled_along(arm, path, T, scene, ON_THE_PATH, self.problem.machine_code)
                per_step = (time.monotonic() - begun) / len(path)
                there = fine.settled(T, shape.collocated)
                if close(there, end.point, _SAME):
                    refined = self._on_finer_mesh(fine, optimum(fine, there))
                    if bool(refined.violation) == bool(end.violation):
                        reserve(CERTIFICATE_TIME * per_step)
                        return replace(refined, load_path=path)
        raise UnsettledContactError(1.0, "the arm does not come to the optimum")

    def _on_finer_mesh(self, program: TensionProgram, end: ContactOptimum) -> ContactOptimum:
        """Return an optimum that meets the constraints on a mesh of twice the elements, too.

        Wrenches of contact forces, and positions of heavy neo-Hookean arms, converge more slowly
        than other positions.
        """
        if end.violation:
            return end
        with suppress(OutOfTime):
            for refinement in _FINER:
                finer = TensionProgram(self.problem, refinement, program.least)
                there = finer.settled(end.point.tensions, end.point)
                violation = finer.at(end.point.tensions / finer.unit, there).violation
                if violation <= MET * self.problem.accuracy:
                    break
                end = optimum(finer, there)
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
    """Return the equilibrium in which an arm about holds the wrenches, and the tensions before.

    A guess touches the object in about the right direction, but presses too little. Least
    violation of all of the wrench may lead to another edge or side of the object. Therefore the
    wrench grows from the size of the forces of the guess, and each share is balanced in turn. The
    growth slows down if a share cannot be balanced, and ends if a slow growth fails as well.
    """
    path: LoadPath = ()
    if not program.holds:
        return begin, path
    still = program.at(begin.tensions / program.unit, begin).grasp.still
    arm = program.problem.arm
    wrench = np.concatenate([hold.scaled(arm) / hold.size(arm) for hold in program.holds])
    share = float(np.linalg.norm(still - wrench) / np.linalg.norm(wrench))
    share = min(max(share, _LEAST_SHARE), 1.0)
    held, growth = 0.0, _GROWTH
    while held < 1 and growth > _SLOWEST:
        end: ContactOptimum | None = None
        with suppress(OctoplanError):
            end = optimum(program.with_wrenches(share), begin, enough=_BALANCED)
        if end is not None and end.violation <= _BALANCED:
            begin, path = end.point, (*path, *end.load_path, tuple(end.point.tensions.tolist()))
            held = share
        elif not held:
            break
        else:
            growth = np.sqrt(growth)
        share = min(held * growth, 1.0)
    return begin, path


def _short_paths(load_path: LoadPath) -> Iterator[LoadPath]:
    """Yield load paths to the end of a long one, from the shortest: straight, then in few legs."""
    yield ()
    for legs in sorted({min(each, len(load_path)) for each in _LEGS} - {0}):
        kept = np.linspace(0, len(load_path), legs, endpoint=False).astype(int)
        yield tuple(load_path[i] for i in kept)


def optimality_of(
    problem: PlanningProblem, tensions: Array, shape: Shape, load_path: LoadPath = ()
) -> Optimality:
    """Return the first-order conditions at tensions (n_tendons,), of the shape of a load path."""
    with suppress(OctoplanError):
        bound = problem.options.stability_bound * problem.options.modes
        program = TensionProgram(problem, problem.options.refinement, bound, load_path)
        # Twice: the gap's curvature at contact points is that of the mesh it comes from.
        on_mesh = program.begin or program.map.solve(tensions, shape.collocated)
        begin = program.begin or program.settled(tensions, on_mesh)
        at = program.at(tensions / program.unit, begin)
        return first_order(program, at)
    return Optimality(np.inf)
