"""Search for the optimum of a planning problem, in five steps.

1. Multistart: solve the program on a coarse mesh from one initial guess after another, until enough
   solutions are equal.
2. Refine the best optimum: warm solves on the mesh that the accuracy requires.
3. If no guess meets the targets, relax them: the same two steps for the nearest shape, by least
   squares of residuals and slacks.
4. If the nearest shape meets the targets but for the weight of the effort in least squares, solve
   the exact program on the same mesh, corrected by the defect of the mesh, from that shape.
5. If the nearest shape misses the targets, sample shapes over the limits, and solve from the
   nearest of these.

Optima under loads may be unstable. They are solved again with a lower bound on the eigenvalue of
the least stable mode.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from heapq import merge
from itertools import chain, islice, tee
from operator import attrgetter, itemgetter

import numpy as np

from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.uniqueness import has_unique_equilibrium
from octoplan.model.loads import is_loaded
from octoplan.model.paths import Array
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import OutOfTime, check_time, report
from octoplan.planner.block import Block
from octoplan.planner.nlp_options import Mode
from octoplan.planner.nlp_solution import KKT_TOLERANCE, NlpSolution
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.problem import FINAL_WEIGHT, SEARCH_WEIGHT, Problem
from octoplan.planner.solution import Solution, Trial, n_equal_optima
from octoplan.planner.solve.guesses import POINT, beside, drawn_arms, initial_guesses
from octoplan.planner.solve.ipopt import Purpose, solve
from octoplan.planner.solve.refine import COARSE_RTOL, CORRECTIONS, on_mesh, refine
from octoplan.planner.solve.samples import Samples, sample
from octoplan.planner.solve.stable_descent import descend
from octoplan.planner.targets.target_set import LOW_PRIORITY

# Number of equal optima after which a multistart ends; one more for relaxed targets, and for exact
# targets of a point or more, which arms meet in several ways. If guesses come in the order of their
# effort, the multistart also ends after this number of guesses that do not improve the optimum. A
# quick multistart ends after this number and one more.
N_EQUAL_OPTIMA = 2
# Largest difference of the scaled unknowns of equal optima [-].
SAME_OPTIMUM = 1e-4
# Largest objective of least squares for targets within reach [-]. Least squares miss such targets,
# because the effort has a weight: the objective is at most FINAL_WEIGHT times the effort (half the
# sum of squares in its unit) of the tensions that meet the targets. No plan has a larger effort.
ATTAINABLE = 1e3 * FINAL_WEIGHT
# Number of sampled shapes that are solved from before targets count as missed. The distance has
# many local minima at limits: for 22 of 25 tips of an arm with a helical tendon, four samples find
# the best one.
N_SAMPLED = 8
# Lower bounds on the stability, tried in this order, if the arm takes another shape under the
# tensions of all optima [-]; 1 is an arm at rest.
STABILITY_FLOORS = (0.3, 0.5)
# Largest number of optima that are solved again with a lower bound on their stability.
MAX_ENFORCED = 4
# Largest number of stable shapes to descend from if optima that meet the targets are unstable.
MAX_DESCENTS = 4
_PHASES: dict[Mode, str] = {
    "exact": "trials that meet the targets",
    "closest": "trials for the nearest shape, equalities met",
    "nearest": "trials for the nearest shape",
}


def solve_from_guess(problem: Problem, T: Array, defect: Array | None = None) -> NlpSolution:
    """Solve a program from tensions (n_tendons,) [N], corrected by the defect of its mesh."""
    # Least squares do not converge from an arm far from the equilibrium under its weight.
    is_relaxed = problem.options.mode != "exact"
    x = problem.guess(T, settled=is_relaxed)
    purpose: Purpose = "search" if defect is None else "meet"
    solution = solve(problem, x, problem.parameters(SEARCH_WEIGHT, defect), purpose=purpose)
    check_time()
    return solution


@dataclass(eq=False)
class RelaxationStage:
    """The multistart in one mode of the targets, with its guesses and optima.

    Attributes
    ----------
    task : PlanningProblem
    mode : "exact", "closest" or "nearest"
    guesses : iterator of (n_tendons,)
        Initial tensions that were not yet solved from [N].
    blocks : tuple of Block
        Further blocks of the program, such as clearances.
    trials : list of Trial
        One for each initial guess.
    stable : list of NlpSolution
        Optima with the required stability.
    unstable : list of NlpSolution
        Other optima.
    rejected : list of NlpSolution
        Optima that finer meshes do not have.
    below_margin : list of NlpSolution
        Unstable optima without an optimum near them that has the required stability.
    starts : list of Equilibrium
        Stable shapes on the coarse mesh to descend from, in place of unstable optima.
    descended : list of NlpSolution
        Stable optima from these shapes.
    last : NlpSolution or None
        Solution from the last guess.
    corrected : NlpSolution or None
        An optimum with the defect of its mesh, which corrects the programs of all guesses. Without
        it, programs are on the coarse mesh and not corrected.
    refined : NlpSolution or None
        The refined optimum of the result.
    """

    task: PlanningProblem
    mode: Mode
    guesses: Iterator[Array] = field(default_factory=lambda: iter(()))
    blocks: tuple[Block, ...] = ()
    trials: list[Trial] = field(default_factory=list)
    stable: list[NlpSolution] = field(default_factory=list)
    unstable: list[NlpSolution] = field(default_factory=list)
    rejected: list[NlpSolution] = field(default_factory=list)
    below_margin: list[NlpSolution] = field(default_factory=list)
    starts: list[Equilibrium] = field(default_factory=list)
    descended: list[NlpSolution] = field(default_factory=list)
    last: NlpSolution | None = None
    corrected: NlpSolution | None = None
    refined: NlpSolution | None = None

    @property
    def optima(self) -> list[NlpSolution]:
        """All optima of the coarse mesh, sorted by their objectives."""
        return sorted([*self.stable, *self.unstable], key=attrgetter("f"))

    @property
    def is_nearly_met(self) -> bool:
        """Whether the least squares of some optimum vanish within the tolerance."""
        return any(optimum.f <= KKT_TOLERANCE for optimum in self.optima)

    @property
    def is_missed(self) -> bool:
        """Whether targets are relaxed, and the least squares of no stable optimum vanish."""
        return self.mode != "exact" and not any(each.f <= KKT_TOLERANCE for each in self.stable)

    def multistart(
        self, most: int | None = None, until_met: bool = False, until_equal: bool = True
    ) -> None:
        """Solve from guesses.

        Parameters
        ----------
        most : int
            Largest number of guesses; all unless given.
        until_met : bool
            Whether to end at an optimum whose least squares vanish.
        until_equal : bool
            Whether to end after enough equal optima, see `multistart_done`.
        """
        problem, defect = self._problem(), None
        if self.corrected is not None:
            problem, defect = self.corrected.problem, self.corrected.defect
        for T in islice(self.guesses, most):
            if until_equal and self.multistart_done():
                return
            if until_met and self.is_nearly_met:
                return
            report(_PHASES[self.mode], len(self.trials), self.task.max_guesses)
            self._record(solve_from_guess(problem, T, defect))

    def multistart_done(self) -> bool:
        """Return whether enough optima are equal, or enough guesses did not improve the best one.

        The latter counts if guesses come in the order of their effort and the targets are met: the
        distance of a nearest shape does not depend on this order. One unstable optimum that nearly
        meets the targets is enough if there are stable shapes to descend from.
        """
        if self.task.guesses is not None:
            return False
        if self.starts and self.is_nearly_met:
            return True
        trials, mode, n_conditions = self.trials, self.mode, self.task.target_set.conditions
        objectives = [trial.objective if trial.met else np.inf for trial in trials]
        best = min(objectives, default=np.inf)
        missed = mode == "nearest" or (mode == "closest" and best > KKT_TOLERANCE)
        needs_more = missed or (n_conditions >= POINT and mode == "exact")
        is_by_effort = best < np.inf and n_conditions > POINT
        n_since_best = len(trials) - 1 - objectives.index(best) if is_by_effort else 0
        is_equal = n_equal_optima(trials) >= N_EQUAL_OPTIMA + needs_more
        return is_equal or (mode == "exact" and n_since_best >= N_EQUAL_OPTIMA)

    def confirms(self, optimum: NlpSolution) -> bool:
        """Return whether no guess leads to a better optimum, until enough optima are equal.

        An optimum without the required stability is not confirmed.
        """
        self._record(optimum)
        self.multistart()
        best = min((each.f for each in self.stable), default=np.inf)
        return optimum in self.stable and optimum.f <= (1 + COARSE_RTOL) * best

    def solve_from(self, T: Array) -> NlpSolution | None:
        """Return the optimum from tensions (n_tendons,) [N], with the required stability."""
        return self._with_required_stability(solve_from_guess(self._problem(), T))

    def resolve_with(self, optimum: NlpSolution) -> NlpSolution | None:
        """Return the optimum of the stage's blocks, from one for the same targets and other blocks.

        The start is warm if both programs have the same unknowns; otherwise only the tensions are
        the guess.
        """
        before = optimum.problem
        problem = Problem(self.task, before.options, self.blocks)
        if problem.program.size != optimum.x.size:
            return self.solve_from(optimum.tensions)
        old, new = before.program.row_kinds, problem.program.row_kinds
        lam_g = np.zeros(new.size)
        for kind in np.unique(old):
            if np.sum(old == kind) == np.sum(new == kind):
                lam_g[new == kind] = optimum.lam_g[old == kind]
        p, multipliers = problem.parameters(SEARCH_WEIGHT), (optimum.lam_x, lam_g)
        solution = solve(problem, optimum.x, p, multipliers=multipliers, purpose="near")
        check_time()
        return self._with_required_stability(solution)

    def _problem(self) -> Problem:
        """Return the problem on the coarse mesh."""
        return Problem(self.task, self.task.coarse(self.mode), self.blocks)

    def _with_required_stability(self, solution: NlpSolution) -> NlpSolution | None:
        """Return the solution if it is a stable optimum, or one near it that is; otherwise None."""
        self._record(solution)
        near = (x for optimum in self.unstable for _, x in self._enforce_margin(optimum) if x)
        return next(chain(self.stable, near), None)

    def _record(self, solution: NlpSolution) -> None:
        """Add a trial, and its solution to the optima if it converged."""
        is_rejected = any(_is_same(solution, each) for each in self.rejected)
        is_optimum = solution.converged and not is_rejected
        self.trials.append(Trial(solution.f, is_optimum, solution.iterations))
        if solution.is_finite:
            self.last = solution
        if is_optimum:
            self.classify(solution)

    def classify(self, optimum: NlpSolution) -> None:
        """Add a new optimum to the stable or the unstable ones."""
        margin = self.task.options.margin
        if not any(_is_same(optimum, other) for other in self.optima):
            tolerance = COARSE_RTOL * (margin > 0)
            is_stable = optimum.problem.is_stable(optimum.x, margin - tolerance)
            (self.stable if is_stable else self.unstable).append(optimum)

    def reject(self) -> None:
        """Reject all stable optima, because the settled arm does not have them.

        Under strong loads the arm may take another shape under the tensions of an optimum. The
        equilibria of these shapes are the next guesses.
        """
        if not has_unique_equilibrium(self.task.arm, self.task.scene):
            self.guesses = chain([optimum.tensions for optimum in self.stable], self.guesses)
        self.rejected = [*self.rejected, *self.stable]
        self.stable = []
        self.trials = [replace(trial, met=False) for trial in self.trials]

    def best(self, limit: float = np.inf) -> Solution | None:
        """Return the best optimum that can be refined, if its objective is at most `limit`.

        Unstable optima are solved again with a bound on their stability, which increases their
        objective, unless a stable optimum is better.
        """
        lost, unstable = np.inf, {float(f"{each.f:.3g}"): each for each in self.unstable}
        streams = [self._enforce_margin(unstable[f]) for f in sorted(unstable)[:MAX_ENFORCED]]
        if self.starts and unstable:
            streams = [self._descend(min(unstable))]
        stable = sorted(((each.f, each) for each in self.stable), key=itemgetter(0))
        for f, optimum in merge(stable, *streams, key=itemgetter(0)):
            if f > limit:
                return None
            refined = None if optimum is None else refine(optimum)
            if refined is not None:
                saving = 1 - float(np.sqrt(lost / refined.f)) if lost < refined.f else 0.0
                saving = saving if saving > 10 * COARSE_RTOL else 0.0
                self.refined = refined
                return refined.result(self.trials, lost=saving)
            if optimum in self.stable:
                lost = min(lost, f)
        return None

    def best_of_more_stable(self) -> Solution | None:
        """Return a result near rejected optima with more stability than required, or None.

        Under strong loads the arm may have several shapes under the tensions of an optimum, and
        take another one. The arm more often takes shapes with more stability.
        """
        if has_unique_equilibrium(self.task.arm, self.task.scene):
            return None
        for floor in STABILITY_FLOORS:
            optima = [each for each in self.optima[:MAX_ENFORCED] if each not in self.below_margin]
            for optimum in optima:
                for _, stable in self._enforce_margin(optimum, floor):
                    refined = None if stable is None else refine(stable)
                    if refined is not None:
                        return refined.result(self.trials)
        return None

    def _descend(self, bound: float) -> Iterator[tuple[float, NlpSolution | None]]:
        """Yield a lower bound of the objective with None, then stable optima from the starts.

        Descents end after a number of equal optima.
        """
        yield bound, None
        problem = self._problem().replace(modes=1)
        for start in self.starts:
            optimum = descend(problem, start)
            self.descended += [] if optimum is None else [optimum]
            best = min((each.f for each in self.descended), default=np.inf)
            n_equal = sum(each.f <= (1 + COARSE_RTOL) * best for each in self.descended)
            if n_equal >= N_EQUAL_OPTIMA:
                break
        for optimum in sorted(self.descended, key=attrgetter("f")):
            yield optimum.f, optimum

    def _enforce_margin(
        self, optimum: NlpSolution, floor: float = 0.0
    ) -> Iterator[tuple[float, NlpSolution | None]]:
        """Yield the objective of an optimum with None, then that with an optimum near it, if any.

        The optimum near it has the stability that the options require, and at least `floor`. Its
        objective is not smaller than the first, so that it need not be solved if another optimum is
        better. One mode is constrained; if another mode is then below the bound, that mode is
        constrained next.
        """
        yield optimum.f, None
        near, bound = optimum, max(self.task.options.stability_bound, floor)
        with suppress(OctoplanError, np.linalg.LinAlgError):
            for _ in range(CORRECTIONS):
                problem = near.problem.replace(modes=1, floor=bound)
                states = near.problem.linearised(near.x).states
                x = problem.complete(near.tensions, states)
                near = solve(problem, x, problem.parameters(SEARCH_WEIGHT))
                check_time()
                if not near.converged:
                    break
                if problem.is_stable(near.x, bound - COARSE_RTOL * bound):
                    yield near.f, near
                    return
        self.below_margin.append(optimum)


def _is_same(one: NlpSolution, other: NlpSolution) -> bool:
    """Return whether two optima have equal unknowns, apart from those of constrained modes."""
    size = min(one.x.size, other.x.size)
    return bool(np.abs(one.x[:size] - other.x[:size]).max() <= SAME_OPTIMUM)


class Search:
    """The search for the solution of one planning problem.

    Attributes
    ----------
    task : PlanningProblem
        The problem; samples may require a finer coarse mesh.
    stage : RelaxationStage
        The last stage.
    samples : Samples or None
        Sampled shapes, after step 5.
    """

    def __init__(self, task: PlanningProblem) -> None:
        self.task = task
        self.stage = RelaxationStage(task, "exact")
        self.samples: Samples | None = None
        self._source = initial_guesses(task, is_loaded(task.scene))

    def run(self) -> Solution:
        """Return the best solution, or the best so far if the time limit is reached."""
        try:
            result = self._run()
        except OutOfTime:
            result = self._best_so_far()
        return replace(result, sampled=self.samples.count if self.samples else 0)

    def _run(self) -> Solution:
        """Return the best optimum of the first mode of the targets that has one.

        The exact mode is first tried from few guesses (quick). If these have no optimum, the
        relaxed modes are solved. If the nearest shape then nearly meets the targets, the exact mode
        is solved from that shape, and from more guesses.
        """
        unstable = False
        quick_stage: RelaxationStage | None = None
        for mode in self._modes():
            n_sampled = self._n_sampled if mode != "exact" and self.task.guesses else 0
            n_tried = len(quick_stage.trials) if quick_stage else 1
            guesses = self.guesses(n_tried, n_sampled)
            stage = RelaxationStage(self.task, mode, guesses, last=self.stage.last)
            self.stage = stage
            quick = mode == "exact" and self.task.guesses is None
            n_guesses = N_EQUAL_OPTIMA + 1 if quick else None
            stage.multistart(n_guesses, until_met=quick_stage is not None)
            if quick and not stage.optima:
                quick_stage = stage
                continue
            if stage.is_missed and self._n_sampled:
                stage = self.stage = self._with_samples(stage)
            stages = [stage]
            unstable |= stage.is_missed and stage.is_nearly_met
            if quick_stage is not None and stage.is_nearly_met and not stage.starts:
                quick_stage.task = stage.task
                nearest = stage.optima[0].tensions
                quick_stage.guesses = chain([nearest], quick_stage.guesses)
                stages = [quick_stage, stage]
                quick_stage = None
            for self.stage in stages:
                result = self._best_of_stage()
                if result is not None:
                    result = self._exact_near(result)
                    is_relaxed = result.options.mode != "exact"
                    return replace(result, unstable=unstable and is_relaxed)
                unstable |= bool(self.stage.unstable)
            quick_stage = stage if quick else quick_stage
        return replace(self._best_so_far(stopped=False), unstable=unstable)

    def _modes(self) -> list[Mode]:
        """Return the modes in the order in which they are solved.

        The exact mode requires as many tendons that can pull as conditions; "closest" requires soft
        residuals or inequalities of low priority.
        """
        terms, limits = self.task.target_set.terms, self.task.allowed
        can_pull = np.greater(limits.upper, limits.lower)
        modes: list[Mode] = ["nearest"]
        if terms.names[1] or LOW_PRIORITY in terms.inequality_weights:
            modes.insert(0, "closest")
        if terms.count <= can_pull.sum():
            modes.insert(0, "exact")
        return modes

    @property
    def _n_sampled(self) -> int:
        """The number of sampled shapes to solve from; half of the guesses, if a number is given."""
        return N_SAMPLED if self.task.guesses is None else self.task.guesses // 2

    def _with_samples(self, stage: RelaxationStage) -> RelaxationStage:
        """Return a stage after solves from the nearest of the sampled shapes.

        If the samples require a finer mesh, the best optima of the coarse mesh are solved again.
        """
        if self.samples is None:
            self.samples = sample(self.task, self._n_sampled)
        distinct = islice(self.samples.distinct(), self._n_sampled)
        guesses: Iterator[Array] = (point.tensions for point in distinct)
        if self.samples.task is not self.task:
            self.task = self.samples.task
            trials = [replace(trial, met=False) for trial in stage.trials]
            best = stage.optima[:N_EQUAL_OPTIMA]
            guesses = chain((each.tensions for each in best), guesses)
            stage = RelaxationStage(self.task, stage.mode, trials=trials, last=stage.last)
        stage.guesses = guesses
        if stage.mode == "nearest":
            stage.starts = self.samples.stable(MAX_DESCENTS, self.task.options.stability_bound)
        stage.multistart(until_met=True, until_equal=False)
        return stage

    def _best_of_stage(self) -> Solution | None:
        """Return the best refined optimum of the stage, or None.

        If no stable optimum of the coarse mesh can be refined, the optima are rejected, and the
        multistart continues. A shape that meets the targets with less than the default margin of
        stability is preferred to a shape that misses them.
        """
        stage = self.stage
        stage.task = self.task
        while True:
            stage.multistart()
            nearly_met = stage.mode != "exact" and any(
                each.f <= KKT_TOLERANCE for each in stage.unstable
            )
            limit = KKT_TOLERANCE if nearly_met and self.task.best_margin else np.inf
            result = stage.best(limit)
            if result is None and stage.mode == "exact":
                result = stage.best_of_more_stable()
            if result is not None or nearly_met or not stage.stable:
                break
            stage.reject()
        if result is not None or not stage.unstable or not self.task.best_margin:
            return result
        return self._best_without_margin(stage)

    def _best_without_margin(self, stage: RelaxationStage) -> Solution | None:
        """Return the best refined optimum that is stable, without the default margin."""
        options = self.task.options.replace(margin=0.0)
        self.task = replace(self.task, options=options, best_margin=False)
        starts = stage.starts
        if stage.descended:
            best = min(stage.descended, key=attrgetter("f"))
            starts = [best.problem.linearised(best.x)]
        self.stage = replace(stage, task=self.task, stable=[], unstable=[], starts=starts)
        for optimum in stage.optima:
            problem = optimum.problem.replace(margin=0.0)
            self.stage.classify(replace(optimum, problem=problem))
        return self.stage.best()

    def _exact_near(self, result: Solution) -> Solution:
        """Return the best solution that meets all targets, or the given result if there is none.

        If the least squares of the result vanish but for the weight of the effort, exact programs
        are solved, corrected by the defect of its mesh: from its tensions, from tensions beside
        these, and from initial guesses.
        """
        stage, task = self.stage, self.stage.task
        refined = stage.refined
        if stage.mode == "exact" or refined is None or refined.f > ATTAINABLE:
            return result
        mesh = refined.problem.options.refinement
        problem = Problem(task, task.coarse("exact").replace(refinement=mesh))
        try:
            with suppress(OctoplanError, np.linalg.LinAlgError):
                corrected = on_mesh(refined, problem, task.settled(refined.tensions))
                guesses = chain([refined.tensions], beside(corrected), self.guesses())
                limited = islice(guesses, task.max_guesses)
                exact = RelaxationStage(task, "exact", limited, corrected=corrected)
                if stage.starts:
                    forward = Problem(task, task.coarse("exact")).forward
                    known = task.settled(refined.tensions).known
                    exact.starts = [forward.solve(refined.tensions, known)]
                exact.multistart()
                return exact.best() or result
        except OutOfTime:
            return replace(result, stopped=True)
        return result

    def guesses(self, n_tried: int = 1, n_sampled: int = 0) -> Iterator[Array]:
        """Yield initial guesses, tensions (n_tendons,) [N].

        The number of guesses is at most that of the problem minus the `n_sampled` sampled shapes.
        The first guess comes first, and the other `n_tried` guesses of an earlier mode last,
        because another mode seldom succeeds from these. If the earlier mode failed with equalities
        alone, guesses are fitted again without regard to effort; with inequalities, fits end at the
        same violations.
        """
        self._source, again = tee(self._source)
        before = list(islice(again, n_tried))
        yield from before[:1]
        targets = self.task.target_set
        if n_tried > 1 and targets.conditions > POINT and not targets.terms.names[2]:
            again = initial_guesses(self.task, is_loaded(self.task.scene), missed=True)
        yield from islice(again, max(self.task.max_guesses - n_tried - n_sampled, 0))
        yield from before[1:]

    def _best_so_far(self, stopped: bool = True) -> Solution:
        """Return the optimum of least effort so far, or the nearest sample if there is none.

        Without samples, the last solution, or a drawn arm.
        """
        optima = [*self.stage.stable, *self.stage.rejected]
        best = min(optima, key=attrgetter("f"), default=self.stage.last)
        if not optima and self.samples and self.samples.points:
            options = self.task.coarse("nearest")
            T = self.task.arm.by_section(self.samples.points[0].tensions)
            return Solution(options, T, (), (), tuple(self.stage.trials), stopped)
        if best is None:
            *_, T = islice(drawn_arms(self.task), 2)
            options = self.task.coarse("nearest")
            return Solution(options, self.task.arm.by_section(T), (), (), (), stopped)
        return best.result(self.stage.trials, stopped=stopped)
