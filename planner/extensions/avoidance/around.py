"""Search for plans that keep clear: solve without obstacles, then lead the arm around them.

The plan without obstacles comes first. If the arm of this plan is too near to something, clearance
rows are added at the nearest places, and the program is solved again from there. The rows follow
the nearest places of the new arm, until the settled arm keeps clear. The other optima of the search
are led around in the same way, until none of the rest can be better. If this fails, the search
continues from other initial guesses, and then from arms that touch nothing and come near to the
target. If the target cannot be met, such arms also lead to the nearest shape that keeps clear.

Arms that touch nothing are drawn at random: they are starts on the other side of obstacles.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import chain, islice, tee
from operator import attrgetter

import numpy as np

from octoplan.model.centreline import Centreline
from octoplan.model.paths import Array
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import OutOfTime, report
from octoplan.planner.extensions.avoidance.lines import Lines
from octoplan.planner.extensions.avoidance.rows import ClearanceConstraints, avoiding, grid
from octoplan.planner.extensions.avoidance.surroundings import allows, in_the_way
from octoplan.planner.extensions.base_joints.lines import MovingLines
from octoplan.planner.extensions.base_joints.placement import JointPlacement
from octoplan.planner.planning_problem import Mode, PlanningProblem
from octoplan.planner.solution import NlpSolution, Solution, Trial
from octoplan.planner.solve.guesses import drawn_arms
from octoplan.planner.solve.multistart import N_EQUAL_OPTIMA, Multistart
from octoplan.planner.solve.refine import CORRECTIONS, refine
from octoplan.planner.solve.samples import fine_enough, fitted, sample
from octoplan.planner.solve.search import N_SAMPLED, Search

# Largest numbers of drawn arms that are checked for contact, and that are tried.
_LOOKED_AT, _MOST = 100, 6
# Number of sampled shapes that are fitted to the targets, and the miss up to which a fit is tried,
# in lengths and rad: where limits hold a fit may miss by the error of its mesh.
_FITTED, _MET = 60, 1e-2
# Relative difference below which two objectives are the same.
_AGAIN = 1e-3


def line_of(problem: PlanningProblem, T: Array) -> Centreline | None:
    """Return the centreline of a plan's settled shape; None if it does not settle."""
    with suppress(OctoplanError, np.linalg.LinAlgError):
        return problem.settled(T).centreline(grid(problem.arm).tolist())
    return None


def _lines_of(problem: PlanningProblem) -> Lines:
    """Return the centrelines of the arm of a problem on the mesh of the search."""
    at = tuple(grid(problem.arm)[1:].tolist())
    refinement = problem.coarse("exact").refinement
    if isinstance(problem.placement, JointPlacement):
        return MovingLines(problem.placement, problem.scene, refinement, at, problem.machine_code)
    return Lines(problem.arm, problem.scene, refinement, at, problem.machine_code)


class ObstacleSearch:
    """The search for a problem with an environment.

    Attributes
    ----------
    problem : PlanningProblem
    trials : list of Trial
    searched : bool
        Whether the search tried initial guesses.
    sampled : int
        Number of sampled shapes.
    """

    def __init__(self, problem: PlanningProblem) -> None:
        self.problem, self.surroundings = problem, problem.environment
        self.trials, self.searched, self.sampled = list[Trial](), False, 0
        self._lines = _lines_of(problem)

    def run(self, near: Solution | None = None) -> Solution:
        """Return the best solution that keeps clear, or the best so far if the time is over.

        A solution nearby is led around the obstacles; the search follows only if this fails.
        """
        result = near
        with suppress(OutOfTime):
            if near is not None:
                if self._in_the_way(near) is None:
                    return near
                led = self._exchange(near.controls, "exact")
                if led is not None:
                    return led[1]
            search, self.searched = Search(self.problem), True
            result = search.run()
            body = None if result.stopped else self._in_the_way(result)
            if body is None:
                return result
            self.problem = search.problem
            self._lines = _lines_of(self.problem)
            best = self._detour(search, result)
            best = replace(best, sampled=max(self.sampled, result.sampled))
            reached = result.options.mode == "exact" and best.options.mode != "exact"
            return replace(best, in_the_way=body) if reached else best
        if result is None:
            raise OutOfTime
        return replace(result, stopped=True)

    def led_from(self, controls: Array) -> Solution | None:
        """Return the solution near given tensions that meets the targets and keeps clear.

        Tensions may be followed by base joints. None if there is no such solution, or if the time
        is over.
        """
        with suppress(OutOfTime):
            led = self._exchange(controls, "exact")
            return None if led is None else led[1]
        return None

    def _in_the_way(self, result: Solution) -> str | None:
        """Return a description of the body that is too near; None if the arm keeps clear."""
        line = line_of(self.problem.at_base(result.base), np.ravel(result.tensions))
        return "" if line is None else in_the_way(self.surroundings, line) or None

    def _detour(self, search: Search, result: Solution) -> Solution:
        """Return the best solution around the obstacles, or the solution without obstacles.

        Starts are the optima of the search, further guesses, and arms that touch nothing. The mode
        is that of the solution without obstacles, and then "nearest" from the latter starts.
        """
        mode, T = result.options.mode, result.controls
        met = sorted(search.stage.stable, key=attrgetter("f"))
        optima = [(each.f, each.controls) for each in met] or [(0.0, T)]
        others = ((0.0, guess) for guess in islice(search.guesses(), 1, None))
        drawn = islice(self._clear(islice(drawn_arms(self.problem), _LOOKED_AT)), _MOST)
        clear, again = tee((0.0, arm) for arm in drawn)
        wide, wide_again = tee((0.0, arm) for arm in islice(self._clear_fits(), N_SAMPLED))
        possible = mode == "nearest" or allows(
            self.surroundings, self.problem.arm, self.problem.targets
        )
        best = self._best(mode, optima, others, clear, wide) if possible else None
        if best is None and mode != "nearest":
            best = self._best("nearest", chain(again, [(0.0, T)], wide_again))
        return best or result

    def _clear(self, arms: Iterable[Array]) -> Iterator[Array]:
        """Yield the tensions of arms that touch nothing."""
        for T in arms:
            line = self._lines(T)
            if line is not None and self._avoiding(line, None)[1] >= 0:
                yield T

    def _clear_fits(self) -> Iterator[Array]:
        """Yield tensions of sampled shapes that touch nothing, fits to the targets first.

        Fits come by effort, samples by their distance to the targets.
        """
        samples = sample(self.problem, N_SAMPLED)
        self.sampled = samples.count
        near = np.array([each.tensions for each in islice(samples.distinct(), _FITTED)])
        self.problem = fine_enough(samples.problem, near)
        self._lines = _lines_of(self.problem)
        tensions, misses = fitted(self.problem, near)
        met = tensions[misses <= _MET]
        yield from self._clear(met[np.argsort(np.linalg.norm(met, axis=1), kind="stable")])
        yield from self._clear(near)

    def _best(self, mode: Mode, *sources: Iterable[tuple[float, Array]]) -> Solution | None:
        """Return the best solution from the first source with a start that leads around.

        A start is a lower bound of the objective, and tensions. The source ends once enough starts
        lead around, and once a found objective is below the bound.
        """
        for starts in sources:
            done: list[tuple[float, Solution]] = []
            for least, T in starts:
                report(f"around obstacles, {mode}", len(self.trials))
                if len(done) >= N_EQUAL_OPTIMA or any(f < least for f, _ in done):
                    break
                led = self._exchange(T, mode)
                done += [] if led is None else [led]
            if done:
                return min(done, key=lambda pair: pair[0])[1]
        return None

    def _avoiding(
        self, line: Centreline, before: ClearanceConstraints | None
    ) -> tuple[ClearanceConstraints, float]:
        """Return the clearance rows of an arm, and the smallest gap [m]; see avoiding."""
        moves = self.problem.placement is not None
        return avoiding(line, self.surroundings, before, moves)

    def _exchange(self, T: Array, mode: Mode) -> tuple[float, Solution] | None:
        """Return the objective and the solution that keeps clear, from given tensions."""
        avoidance: ClearanceConstraints | None = None
        optimum: NlpSolution | None = None
        problem, line, objectives = self.problem, self._lines(T), list[float]()
        for _ in range(CORRECTIONS):
            if line is None:
                return None
            is_final = False
            if avoidance is not None and optimum is not None:
                # Tangent planes of a mesh are exchanged until an objective comes again.
                near = np.isclose(objectives, optimum.f, rtol=_AGAIN, atol=0.0)
                is_final = bool(near.any()) or not any(row.is_part for row in avoidance.rows)
                objectives.append(optimum.f)
            kept, (avoidance, gap) = avoidance, self._avoiding(line, avoidance)
            if optimum is not None and is_final and gap >= self.surroundings.clearance:
                fine = refine(optimum)
                line = None if fine is None else line_of(fine.problem, fine.tensions)
                if fine is None or line is None:
                    return None
                if not in_the_way(self.surroundings, line):
                    constraints = kept if kept and kept.rows else None
                    return optimum.f, fine.result(self.trials, avoidance=constraints)
                avoidance, _ = self._avoiding(line, avoidance)
            stage = Multistart(problem, mode, blocks=avoidance.blocks(problem.arm))
            optimum = stage.resolve_with(optimum) if optimum else stage.solve_from(T)
            self.trials += stage.trials
            if optimum is None:
                return None
            point = optimum.instance.linearised(optimum.x)
            line = Centreline.at_states(point.system, point.states)
        return None
