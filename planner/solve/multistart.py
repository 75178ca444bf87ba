"""One stage of the search: the multistart in one mode of the targets, on the coarse mesh.

A stage solves the program from one initial guess after another, tests the stability of the optima,
and refines the best one. Optima below the required stability are solved again with a lower bound on
the eigenvalue of the least stable mode. If loads act before tensions, solves descend from stable
shapes (both in octoplan.planner.solve.stable_descent).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from heapq import merge
from itertools import chain, islice
from operator import attrgetter, itemgetter

import numpy as np

from octoplan.model.loads import has_unique_equilibrium
from octoplan.model.paths import Array
from octoplan.model.support.progress import check_time, report
from octoplan.planner.block import Block
from octoplan.planner.planning_problem import Mode, PlanningProblem
from octoplan.planner.program_instance import SEARCH_WEIGHT, ProgramInstance
from octoplan.planner.solution import NlpSolution, Solution, Trial, n_equal_optima
from octoplan.planner.solve.guesses import POINT
from octoplan.planner.solve.ipopt import Purpose, solve
from octoplan.planner.solve.refine import COARSE_RTOL, refine

# Number of equal optima after which a multistart ends. Least squares need one more, and so do
# exact targets of a point or more, which arms meet in several ways. If guesses come in the order of
# effort, the multistart also ends after this number of guesses without a better optimum.
N_EQUAL_OPTIMA = 2
# Largest least-squares objective of targets that are nearly met: misses of about 1e-3 [-].
NEARLY_MET = 1e-6
# Largest difference of the scaled unknowns of equal optima [-].
SAME_OPTIMUM = 1e-4
# Number of steps after which a multistart of two or more descents ends if there is an optimum: five
# descents of about 40 steps.
MAX_STEPS = 200
# Largest number of optima that are solved again with a lower bound on the stability.
MAX_ENFORCED = 4
_PHASES: dict[Mode, str] = {
    "exact": "trials that meet the targets",
    "closest": "trials for the nearest shape, equalities met",
    "nearest": "trials for the nearest shape",
}


def solve_from_guess(
    instance: ProgramInstance,
    controls: Array,
    defect: Array | None = None,
    known: Sequence[NlpSolution] = (),
) -> NlpSolution:
    """Solve a program from tensions [N], and base joints if any, corrected by a defect.

    If loads act before tensions, descend from the last stable shape on the way to the tensions.
    `known` are optima from other guesses, whose shapes the arm takes.
    """
    tensions, joints = np.split(controls, [instance.arm.n_tendons])
    problem = instance.problem.at_base(tuple(joints.tolist())) if joints.size else instance.problem
    forward = instance.forward_at(problem.arm)
    if forward.loads_first:
        from octoplan.planner.solve.stable_descent import descend_from_guess

        solution = descend_from_guess(instance, forward, tensions, defect, known)
        if solution is not None:
            return solution
    # Least squares do not converge from an arm far from the equilibrium under the weight.
    is_least_squares = instance.options.mode != "exact"
    x = instance.guess(controls, settled=is_least_squares)
    purpose: Purpose = "search" if defect is None else "meet"
    solution = solve(instance, x, instance.parameters(SEARCH_WEIGHT, defect), purpose=purpose)
    check_time()
    return solution


@dataclass(eq=False)
class Multistart:
    """The multistart in one mode of the targets, with guesses and optima.

    Attributes
    ----------
    problem : PlanningProblem
    mode : "exact", "closest" or "nearest"
    guesses : iterator of (n_tendons,)
        Initial tensions [N], and base joints if any, that were not yet solved from.
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
        Unstable optima without a nearby optimum of the required stability.
    last : NlpSolution or None
        Solution from the last guess.
    corrected : NlpSolution or None
        An optimum with a defect, which corrects the programs of all guesses. With None, programs
        are on the coarse mesh and not corrected.
    refined : NlpSolution or None
        The refined optimum of the result.
    """

    problem: PlanningProblem
    mode: Mode
    guesses: Iterator[Array] = field(default_factory=lambda: iter(()))
    blocks: tuple[Block, ...] = ()
    trials: list[Trial] = field(default_factory=list)
    stable: list[NlpSolution] = field(default_factory=list)
    unstable: list[NlpSolution] = field(default_factory=list)
    rejected: list[NlpSolution] = field(default_factory=list)
    below_margin: list[NlpSolution] = field(default_factory=list)
    last: NlpSolution | None = None
    corrected: NlpSolution | None = None
    refined: NlpSolution | None = None
    _coarse: ProgramInstance | None = field(default=None, init=False, repr=False)

    @property
    def optima(self) -> list[NlpSolution]:
        """All optima of the coarse mesh, sorted by objective."""
        return sorted([*self.stable, *self.unstable], key=attrgetter("f"))

    @property
    def some_optimum_meets(self) -> bool:
        """Whether the least squares of some optimum vanish within the tolerance."""
        return any(optimum.f <= NEARLY_MET for optimum in self.optima)

    @property
    def no_stable_optimum_meets(self) -> bool:
        """Whether targets are least squares, and those of no stable optimum vanish."""
        return self.mode != "exact" and not any(each.f <= NEARLY_MET for each in self.stable)

    def solve_guesses(
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
            Whether to end after enough equal optima, see `is_done`.
        """
        instance, defect = self._instance(), None
        if self.corrected is not None:
            instance, defect = self.corrected.instance, self.corrected.defect
        for T in islice(self.guesses, most):
            if until_equal and self.is_done(instance.forward.loads_first):
                return
            if until_met and self.some_optimum_meets:
                return
            report(_PHASES[self.mode], len(self.trials), self.problem.max_guesses)
            self._record(solve_from_guess(instance, T, defect, self.optima))

    def is_done(self, descends: bool = False) -> bool:
        """Return whether enough optima are equal, or enough guesses did not improve the best one.

        The latter counts if guesses come in the order of effort and the targets are met: the
        distance of a nearest shape does not depend on this order. If solves are descents, one more
        optimum has to be equal: arms whose loads act first have more local optima, and three of
        them were equal where the fourth took 10 % less effort. The number of steps is limited, too.
        """
        if self.problem.guesses is not None:
            return False
        trials, mode, n_conditions = self.trials, self.mode, self.problem.target_set.conditions
        objectives = [trial.objective if trial.met else np.inf for trial in trials]
        best = min(objectives, default=np.inf)
        missed = mode == "nearest" or (mode == "closest" and best > NEARLY_MET)
        needs_more = missed or (n_conditions >= POINT and mode == "exact")
        is_by_effort = best < np.inf and n_conditions > POINT
        n_since_best = len(trials) - 1 - objectives.index(best) if is_by_effort else 0
        is_equal = n_equal_optima(trials) >= N_EQUAL_OPTIMA + needs_more + descends
        n_steps = sum(trial.iterations for trial in trials)
        if descends and best < np.inf and len(trials) > 1 and n_steps > MAX_STEPS:
            return True
        return is_equal or (mode == "exact" and n_since_best >= N_EQUAL_OPTIMA)

    def confirms(self, optimum: NlpSolution) -> bool:
        """Return whether no guess leads to a better optimum, until enough optima are equal.

        An optimum without the required stability is not confirmed.
        """
        self._record(optimum)
        self.solve_guesses()
        best = min((each.f for each in self.stable), default=np.inf)
        return optimum in self.stable and optimum.f <= (1 + COARSE_RTOL) * best

    def solve_from(self, T: Array) -> NlpSolution | None:
        """Return the optimum from tensions (n_tendons,) [N], with the required stability."""
        return self._with_required_stability(solve_from_guess(self._instance(), T))

    def resolve_with(self, optimum: NlpSolution) -> NlpSolution | None:
        """Return the optimum of the stage's blocks, from one for the same targets and other blocks.

        The start is warm if both programs have the same unknowns; otherwise only the tensions are
        the guess.
        """
        before = optimum.instance
        instance = ProgramInstance(self.problem, before.options, self.blocks)
        if instance.program.size != optimum.x.size:
            return self.solve_from(optimum.controls)
        old, new = before.program.row_kinds, instance.program.row_kinds
        lam_g = np.zeros(new.size)
        for kind in np.unique(old):
            if np.sum(old == kind) == np.sum(new == kind):
                lam_g[new == kind] = optimum.lam_g[old == kind]
        p, multipliers = instance.parameters(SEARCH_WEIGHT), (optimum.lam_x, lam_g)
        solution = solve(instance, optimum.x, p, multipliers=multipliers, purpose="near")
        check_time()
        return self._with_required_stability(solution)

    def _instance(self) -> ProgramInstance:
        """Return the problem on the coarse mesh."""
        if self._coarse is None or self._coarse.problem is not self.problem:
            self._coarse = ProgramInstance(
                self.problem, self.problem.coarse(self.mode), self.blocks
            )
        return self._coarse

    def _with_required_stability(self, solution: NlpSolution) -> NlpSolution | None:
        """Return the solution if stable, otherwise a stable optimum nearby, or None."""
        self._record(solution)
        near = (x for optimum in self.unstable for _, x in self._enforce_margin(optimum) if x)
        return next(chain(self.stable, near), None)

    def _record(self, solution: NlpSolution) -> None:
        """Add a trial, and add the solution to the optima if converged."""
        is_rejected = any(_is_same(solution, each) for each in self.rejected)
        is_optimum = solution.converged and not is_rejected
        self.trials.append(Trial(solution.f, is_optimum, solution.iterations))
        if solution.is_finite:
            self.last = solution
        if is_optimum:
            self.classify(solution)

    def classify(self, optimum: NlpSolution) -> None:
        """Add a new optimum to the stable or the unstable ones."""
        margin = self.problem.options.margin
        if not any(_is_same(optimum, other) for other in self.optima):
            tolerance = COARSE_RTOL * (margin > 0)
            is_stable = optimum.instance.is_stable(optimum.x, margin - tolerance)
            (self.stable if is_stable else self.unstable).append(optimum)

    def reject(self) -> None:
        """Reject all stable optima, because the settled arm has other shapes.

        Under strong loads the arm may take another shape under the tensions of an optimum. The
        tensions of the rejected optima are the next guesses.
        """
        if not has_unique_equilibrium(self.problem.arm, self.problem.scene):
            self.guesses = chain([optimum.controls for optimum in self.stable], self.guesses)
        self.rejected = [*self.rejected, *self.stable]
        self.stable = []
        self.trials = [replace(trial, met=False) for trial in self.trials]

    def best(self, limit: float = np.inf) -> Solution | None:
        """Return the best optimum that can be refined, up to the objective `limit`.

        Optima that are better on the coarse mesh than the best refined one are refined, too.
        Unstable optima are solved again with a bound on the stability, which increases the
        objective, unless a stable optimum is better.
        """
        lost, unstable = np.inf, {float(f"{each.f:.3g}"): each for each in self.unstable}
        streams = [self._enforce_margin(unstable[f]) for f in sorted(unstable)[:MAX_ENFORCED]]
        stable = sorted(((each.f, each) for each in self.stable), key=itemgetter(0))
        for f, optimum in merge(stable, *streams, key=itemgetter(0)):
            if f > limit or (self.refined and f > self.refined.f):
                break
            refined = None if optimum is None else self._refined(optimum)
            if refined is not None:
                self.refined = min(self.refined or refined, refined, key=attrgetter("f"))
            elif optimum in self.stable:
                lost = min(lost, f)
        if self.refined is None:
            return None
        saving = 1 - float(np.sqrt(lost / self.refined.f)) if lost < self.refined.f else 0.0
        saving = saving if saving > 10 * COARSE_RTOL else 0.0
        return self.refined.result(self.trials, lost=saving)

    def _refined(self, optimum: NlpSolution) -> NlpSolution | None:
        """Return the refined optimum with the required stability, or None.

        Near folds the stability on finer meshes may be less than on the coarse one. The optimum
        then counts as unstable, and is solved again with a bound on the stability.
        """
        refined = refine(optimum)
        margin = self.problem.options.margin
        if refined is None or refined.instance.options.modes or not margin:
            return refined
        if refined.instance.is_stable(refined.x, margin):
            return refined
        self.stable = [each for each in self.stable if each is not optimum]
        self.unstable.append(optimum)
        bounded = next((near for _, near in self._enforce_margin(optimum) if near), None)
        return None if bounded is None else refine(bounded)

    def best_of_more_stable(self) -> Solution | None:
        """Return a result near rejected optima with more stability than required, or None.

        Under strong loads the arm may have several shapes under the tensions of an optimum, and
        take another one. The arm more often takes shapes with more stability.
        """
        if has_unique_equilibrium(self.problem.arm, self.problem.scene):
            return None
        from octoplan.planner.solve.stable_descent import STABILITY_FLOORS

        for floor in STABILITY_FLOORS:
            optima = [each for each in self.optima[:MAX_ENFORCED] if each not in self.below_margin]
            for optimum in optima:
                for _, stable in self._enforce_margin(optimum, floor):
                    refined = None if stable is None else refine(stable)
                    if refined is not None:
                        return refined.result(self.trials)
        return None

    def _enforce_margin(
        self, optimum: NlpSolution, floor: float = 0.0
    ) -> Iterator[tuple[float, NlpSolution | None]]:
        """Yield the objective of an optimum and None, then objective and optimum with the margin.

        The second optimum has the stability that the options require, and at least `floor`. The
        second objective is not smaller than the first. The caller therefore does not solve for the
        second optimum if another optimum is better.
        """
        from octoplan.planner.solve.stable_descent import enforce_margin

        yield optimum.f, None
        bound = max(self.problem.options.stability_bound, floor)
        near = enforce_margin(optimum, bound)
        if near is None:
            self.below_margin.append(optimum)
        else:
            yield near.f, near


def _is_same(one: NlpSolution, other: NlpSolution) -> bool:
    """Return whether two optima have equal unknowns; modes are not compared."""
    size = min(one.x.size, other.x.size)
    return bool(np.abs(one.x[:size] - other.x[:size]).max() <= SAME_OPTIMUM)
