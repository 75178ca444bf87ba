"""Search for the optimum of a planning problem.

The modes of the targets are solved in the order exact, closest, nearest; see `Search._modes` for
the modes that a problem has. Each mode takes these steps, and the first refined optimum ends the
search.

1. Multistart: solve the program on a coarse mesh from one initial guess after another, until enough
   optima are equal. The exact mode first has three guesses, unless a number is given. If no guess
   has an optimum, the search goes on to the next mode.
2. Samples, if a mode with least squares misses the targets: sample shapes over the limits, and
   solve from the nearest samples.
3. Return to the exact mode, if a mode with least squares nearly meets the targets: the optimum is
   the first guess, and the guesses that are left come next.
4. Refine the best optimum: correct the program by the defect of the mesh and solve again, warm
   (octoplan.planner.solve.refine). If the arm has none of the optima, first require more stability,
   then reject the optima and continue the multistart.
5. If a refined optimum of least squares misses the targets by no more than the weight of the effort
   explains, solve the exact program nearby, corrected by the same defect.

Optima under loads may be unstable. Unstable optima are solved again with a lower bound on the
eigenvalue of the least stable mode (octoplan.planner.solve.multistart). If loads act before
tensions, each solve descends from a stable shape (octoplan.planner.solve.stable_descent).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import chain, islice, tee
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from octoplan.model.loads import is_coupled
from octoplan.model.paths import Array
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import OutOfTime
from octoplan.planner.block import Constraints
from octoplan.planner.planning_problem import Mode, PlanningProblem
from octoplan.planner.program_instance import FINAL_WEIGHT, ProgramInstance
from octoplan.planner.solution import Solution
from octoplan.planner.solve.guesses import POINT, beside, drawn_arms, initial_guesses
from octoplan.planner.solve.multistart import N_EQUAL_OPTIMA, NEARLY_MET, Multistart
from octoplan.planner.solve.refine import on_mesh
from octoplan.planner.targets.target_set import LOW_PRIORITY

if TYPE_CHECKING:
    from octoplan.planner.solve.samples import Samples

# Number of guesses of the exact mode before modes with least squares are tried.
N_FIRST_GUESSES = N_EQUAL_OPTIMA + 1
# Largest objective of least squares for targets within reach [-]. Least squares miss such targets,
# because the effort has a weight: the objective is at most FINAL_WEIGHT times the effort (half the
# sum of squares in units) of the tensions that meet the targets. No plan has a larger effort.
ATTAINABLE = 1e3 * FINAL_WEIGHT
# Number of sampled shapes that are solved from before targets count as missed. The distance has
# many local minima at limits: for 22 of 25 tips of an arm with a helical tendon, four samples find
# the best one.
N_SAMPLED = 8


class Search:
    """The search for the solution of one planning problem.

    Attributes
    ----------
    problem : PlanningProblem
        The problem; samples may require a finer coarse mesh.
    stage : Multistart
        The last stage.
    constraints : Constraints or None
        Constraints whose blocks every program has.
    samples : Samples or None
        Sampled shapes, after step 2.
    """

    def __init__(self, problem: PlanningProblem, constraints: Constraints | None = None) -> None:
        self.problem = problem
        self.constraints = constraints
        self.blocks = constraints.blocks(problem.arm) if constraints else ()
        self.stage = Multistart(problem, "exact", blocks=self.blocks)
        self.samples: Samples | None = None
        self._source = initial_guesses(problem, is_coupled(problem.arm, problem.scene))

    def run(self) -> Solution:
        """Return the best solution, or the best so far if the time limit is reached."""
        try:
            result = self._run()
        except OutOfTime:
            result = self._best_so_far()
        sampled = self.samples.count if self.samples else 0
        return replace(result, sampled=sampled, avoidance=self.constraints)

    def _run(self) -> Solution:
        """Return the best optimum of the first mode of the targets that has one.

        Unless their number is given, the exact mode first has `N_FIRST_GUESSES` guesses. If no
        guess has an optimum, or if no optimum can be refined, the modes with least squares are
        solved. If one of their optima nearly meets the targets, the exact stage resumes from that
        optimum, and from the guesses that are left.
        """
        unstable = False
        # The exact stage, if it ended without a result and was not resumed.
        suspended: Multistart | None = None
        for mode in self._modes():
            n_sampled = self._n_sampled if mode != "exact" and self.problem.guesses else 0
            n_tried = len(suspended.trials) if suspended else 1
            guesses = self.guesses(n_tried, n_sampled)
            stage = Multistart(
                self.problem, mode, guesses, blocks=self.blocks, last=self.stage.last
            )
            self.stage = stage
            can_resume = mode == "exact" and self.problem.guesses is None
            n_guesses = N_FIRST_GUESSES if can_resume else None
            stage.solve_guesses(n_guesses, until_met=suspended is not None)
            if can_resume and not stage.optima:
                suspended = stage
                continue
            if stage.no_stable_optimum_meets and self._n_sampled:
                stage = self.stage = self._with_samples(stage)
            stages = [stage]
            unstable |= stage.no_stable_optimum_meets and stage.some_optimum_meets
            if suspended is not None and stage.some_optimum_meets:
                suspended.problem = stage.problem
                nearest = stage.optima[0].controls
                suspended.guesses = chain([nearest], suspended.guesses)
                stages = [suspended, stage]
                suspended = None
            for self.stage in stages:
                result = self._best_of_stage()
                if result is not None:
                    result = self._exact_near(result)
                    is_least_squares = result.options.mode != "exact"
                    return replace(result, unstable=unstable and is_least_squares)
                unstable |= bool(self.stage.unstable)
            suspended = stage if can_resume else suspended
        return replace(self._best_so_far(stopped=False), unstable=unstable)

    def _modes(self) -> list[Mode]:
        """Return the modes in the order in which they are solved.

        The exact mode requires as many tendons that can pull and base joints as conditions;
        "closest" requires soft residuals or inequalities of low priority.
        """
        terms = self.problem.target_set.terms
        modes: list[Mode] = ["nearest"]
        if terms.names[1] or LOW_PRIORITY in terms.inequality_weights:
            modes.insert(0, "closest")
        if terms.count <= self.problem.n_controls:
            modes.insert(0, "exact")
        return modes

    @property
    def _n_sampled(self) -> int:
        """The number of sampled shapes to solve from; half of the guesses, if a number is given."""
        return N_SAMPLED if self.problem.guesses is None else self.problem.guesses // 2

    def _with_samples(self, stage: Multistart) -> Multistart:
        """Return a stage after solves from the nearest of the sampled shapes.

        If the samples require a finer mesh, the best optima of the coarse mesh are solved again.
        """
        from octoplan.planner.solve.samples import sample

        if self.samples is None:
            self.samples = sample(self.problem, self._n_sampled)
        distinct = islice(self.samples.distinct(), self._n_sampled)
        guesses: Iterator[Array] = (point.tensions for point in distinct)
        if self.samples.problem is not self.problem:
            self.problem = self.samples.problem
            trials = [replace(trial, met=False) for trial in stage.trials]
            best = stage.optima[:N_EQUAL_OPTIMA]
            guesses = chain((each.controls for each in best), guesses)
            stage = Multistart(
                self.problem, stage.mode, blocks=self.blocks, trials=trials, last=stage.last
            )
        stage.guesses = guesses
        stage.solve_guesses(until_met=True, until_equal=False)
        return stage

    def _best_of_stage(self) -> Solution | None:
        """Return the best refined optimum of the stage, or None.

        If no stable optimum of the coarse mesh can be refined, the optima are rejected, and the
        multistart continues. A shape that meets the targets with less than the default margin of
        stability is preferred to a shape that misses the targets.
        """
        stage = self.stage
        stage.problem = self.problem
        while True:
            stage.solve_guesses()
            nearly_met = stage.mode != "exact" and any(
                each.f <= NEARLY_MET for each in stage.unstable
            )
            limit = NEARLY_MET if nearly_met and self.problem.best_margin else np.inf
            result = stage.best(limit)
            if result is None and stage.mode == "exact":
                result = stage.best_of_more_stable()
            if result is not None or nearly_met or not stage.stable:
                break
            stage.reject()
        if result is not None or not stage.unstable or not self.problem.best_margin:
            return result
        return self._best_without_margin(stage)

    def _best_without_margin(self, stage: Multistart) -> Solution | None:
        """Return the best refined optimum that is stable, without the default margin."""
        from octoplan.planner.solve.stable_descent import descend

        options = self.problem.options.replace(margin=0.0)
        self.problem = replace(self.problem, options=options, best_margin=False)
        self.stage = replace(stage, problem=self.problem, stable=[], unstable=[])
        for optimum in stage.optima:
            instance = optimum.instance.replace(margin=0.0)
            if instance.forward.loads_first:
                self.stage.classify(descend(instance, instance.linearised(optimum.x)))
            else:
                self.stage.classify(replace(optimum, instance=instance))
        return self.stage.best()

    def _exact_near(self, result: Solution) -> Solution:
        """Return the best solution that meets all targets, or the given result if there is none.

        If the least squares of the result vanish but for the weight of the effort, exact programs
        are solved, corrected by the defect of the mesh: from the result's tensions, from tensions
        beside the result, and from initial guesses.
        """
        stage = self.stage
        refined = stage.refined
        if stage.mode == "exact" or refined is None or refined.f > ATTAINABLE:
            return result
        problem = stage.problem.at_base(refined.instance.base_joints(refined.x))
        mesh = refined.instance.options.refinement
        instance = ProgramInstance(
            problem, problem.coarse("exact").replace(refinement=mesh), self.blocks
        )
        try:
            with suppress(OctoplanError, np.linalg.LinAlgError):
                corrected = on_mesh(refined, instance, problem.settled(refined.tensions))
                guesses = chain([refined.controls], beside(corrected), self.guesses())
                limited = islice(guesses, problem.max_guesses)
                exact = Multistart(
                    problem, "exact", limited, blocks=self.blocks, corrected=corrected
                )
                exact.solve_guesses()
                return exact.best() or result
        except OutOfTime:
            return replace(result, stopped=True)
        return result

    def guesses(self, n_tried: int = 1, n_sampled: int = 0) -> Iterator[Array]:
        """Yield initial guesses, tensions (n_tendons,) [N] and base joints if any.

        The number of guesses is at most that of the problem minus the `n_sampled` sampled shapes.
        The first guess comes first, and the other `n_tried` guesses of an earlier mode last,
        because another mode seldom succeeds from an earlier guess. If the earlier mode failed with
        equalities alone, guesses are fitted again without regard to effort; with inequalities, fits
        end at the same violations.
        """
        self._source, again = tee(self._source)
        before = list(islice(again, n_tried))
        yield from before[:1]
        targets = self.problem.target_set
        if n_tried > 1 and targets.conditions > POINT and not targets.terms.names[2]:
            again = initial_guesses(
                self.problem, is_coupled(self.problem.arm, self.problem.scene), missed=True
            )
        yield from islice(again, max(self.problem.max_guesses - n_tried - n_sampled, 0))
        yield from before[1:]

    def _nearest_sample(self, is_checked: bool) -> Array:
        """Return the tensions of the nearest sample, or of the nearest that the arm settles to.

        Samples are shapes on a coarse mesh; the arm itself may snap on the way to some of them.
        """
        assert self.samples is not None
        points = self.samples.points
        for point in points[: N_SAMPLED if is_checked else 0]:
            with suppress(OctoplanError):
                self.problem.settled(point.tensions)
                return point.tensions
        return points[0].tensions

    def _best_so_far(self, stopped: bool = True) -> Solution:
        """Return the optimum of least effort so far, or the nearest sample if there is none.

        Without samples, the last solution, or a drawn arm.
        """
        optima = [*self.stage.stable, *self.stage.rejected]
        best = self.stage.refined or min(optima, key=attrgetter("f"), default=self.stage.last)
        if not optima and self.samples and self.samples.points:
            options = self.problem.coarse("nearest")
            T = self.problem.arm.by_section(self._nearest_sample(is_checked=not stopped))
            trials = tuple(self.stage.trials)
            return Solution(options, T, (), (), trials, stopped, base=self.problem.base_joints)
        if best is None:
            *_, T = islice(drawn_arms(self.problem), 2)
            options = self.problem.coarse("nearest")
            T = self.problem.arm.by_section(T[: self.problem.arm.n_tendons])
            return Solution(options, T, (), (), (), stopped, base=self.problem.base_joints)
        return best.result(self.stage.trials, stopped=stopped)
