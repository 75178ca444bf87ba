"""From a question to tensions, in five steps.

1. Solve on a coarse mesh from one initial guess after another, until enough of them agree.
2. Refine the best, warm, on a mesh as fine as the accuracy asks for.
3. If no guess meets the targets, do the same with slacks: solve for the nearest shape.
4. If that shape all but meets the targets, look for one that meets them on the same mesh, corrected
   by its error: least effort with residuals of 0 does not trade them for effort.
5. If it misses the targets, sample shapes over the limits and solve again from the nearest.

Optima under loads may be unstable. These are solved once more with the least stable mode among the
unknowns, held to a margin.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from heapq import merge
from itertools import chain, islice, tee
from operator import attrgetter, itemgetter

import numpy as np

from octoplan.model.equilibrium.uniqueness import has_unique_equilibrium
from octoplan.model.loads import is_loaded
from octoplan.model.paths import Array
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import OutOfTime, check_time, report
from octoplan.planner.nlp_options import Mode
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.program.problem import (
    KKT_TOLERANCE,
    REGULARISATION,
    SEARCHED,
    Candidate,
    Problem,
)
from octoplan.planner.program.terms import LOW_PRIORITY
from octoplan.planner.solution import Solution, Trial, n_equal_optima
from octoplan.planner.solve.guesses import POINT, beside, drawn_arms, initial_guesses
from octoplan.planner.solve.ipopt import Purpose, solve
from octoplan.planner.solve.refine import COARSE, CORRECTIONS, on_mesh, refine
from octoplan.planner.solve.samples import Samples, sample

# Guesses that have to agree; one more where all miss the targets, and where a point or more is to
# be met, which arms meet in several ways.
# Of guesses that come by effort, so many after the one that leads to the best are enough, too; and
# so many and one from which the targets are not met before slacks tell how near they can be had.
AGREED = 2
# Largest difference of the scaled unknowns of one optimum that is found twice.
SAME_OPTIMUM = 1e-4
# Least squares of targets that can be met miss them, too, as effort has a weight there: their
# objective is at most that weight times the effort (half the sum of squares in its unit) of the
# tensions that meet them. No plan takes more effort than this.
ATTAINABLE = 1e3 * REGULARISATION
# Sampled shapes that are tried before targets are said to be missed. Local optima of the distance
# are many where limits hold: of 25 tips of an arm with a helical tendon four find the best of 22.
WIDE = 8
# Stabilities to which optima are held if the arm takes another shape under their tensions: 1 is an
# arm at rest.
STIFFER = (0.3, 0.5)
# Largest number of optima that are held to a stability.
MOST_HELD = 4
_PHASES: dict[Mode, str] = {
    "exact": "trials that meet the targets",
    "closest": "trials for the nearest shape, equalities met",
    "nearest": "trials for the nearest shape",
}


def attempt(problem: Problem, T: Array, defect: Array | None = None) -> Candidate:
    """Solve a program, corrected by a defect of its mesh, from tensions (n_tendons,) [N]."""
    # Least squares come to no end from an arm whose weight is far from being balanced.
    least_squares = problem.options.mode != "exact"
    x = problem.guess(T, least_squares)
    purpose: Purpose = "search" if defect is None else "meet"
    candidate = solve(problem, x, problem.parameters(SEARCHED, defect), purpose=purpose)
    check_time()
    return candidate


@dataclass(eq=False)
class Reading:
    """One way to read the targets of a task, and what became of the guesses that were tried.

    Attributes
    ----------
    guesses : iterator of (n_tendons,)
        Those that are left.
    trials : list of Trial
        One for each initial guess.
    met : list of Candidate
        Optima that are as stable as they have to be.
    unstable : list of Candidate
        Others.
    lost : list of Candidate
        Optima that finer meshes do not have.
    last : Candidate or None
        What the last guess led to.
    corrected : Candidate or None
        An optimum with the defect of its mesh, by which programs are corrected; they are on the
        coarse mesh, without correction, if there is none.
    fine : Candidate or None
        The refined optimum of the result.
    """

    task: PlanningProblem
    mode: Mode
    guesses: Iterator[Array] = field(default_factory=lambda: iter(()))
    trials: list[Trial] = field(default_factory=list)
    met: list[Candidate] = field(default_factory=list)
    unstable: list[Candidate] = field(default_factory=list)
    lost: list[Candidate] = field(default_factory=list)
    last: Candidate | None = None
    corrected: Candidate | None = None
    fine: Candidate | None = None

    @property
    def optima(self) -> list[Candidate]:
        """All of the coarse mesh, by their objectives."""
        return sorted([*self.met, *self.unstable], key=attrgetter("f"))

    @property
    def is_all_but_met(self) -> bool:
        """Whether least squares of the targets come to nothing."""
        return any(optimum.f <= KKT_TOLERANCE for optimum in self.optima)

    @property
    def is_missed(self) -> bool:
        """Whether no stable optimum all but meets the targets, of a reading that allows misses."""
        return self.mode != "exact" and not any(each.f <= KKT_TOLERANCE for each in self.met)

    def search(
        self, most: int | None = None, until_met: bool = False, until_agreed: bool = True
    ) -> None:
        """Solve from guesses until enough of them agree, or from so many.

        Or until one all but meets the targets. From all guesses unless `until_agreed`.
        """
        problem, defect = Problem(self.task, self.task.coarse(self.mode)), None
        if self.corrected is not None:
            problem, defect = self.corrected.problem, self.corrected.defect
        for T in islice(self.guesses, most):
            if until_agreed and self._enough():
                return
            if until_met and self.is_all_but_met:
                return
            report(_PHASES[self.mode], len(self.trials), self.task.max_guesses)
            self._keep(attempt(problem, T, defect))

    def agrees_on(self, optimum: Candidate) -> bool:
        """Return whether guesses lead to none that is better, until enough agree, it among them.

        An optimum that is less stable than it has to be is none of those.
        """
        self._keep(optimum)
        self.search()
        best = min((each.f for each in self.met), default=np.inf)
        return optimum in self.met and optimum.f <= (1 + COARSE) * best

    def led_to(self, T: Array) -> Candidate | None:
        """Return the optimum that tensions lead to, as stable as it has to be."""
        problem = Problem(self.task, self.task.coarse(self.mode))
        return self._stable(attempt(problem, T))

    def exchanged(self, optimum: Candidate) -> Candidate | None:
        """Return the optimum near one of the same targets, among other inequalities.

        Where there were none before poses are unknowns at other places: from its tensions.
        """
        before = optimum.problem
        problem = Problem(self.task, before.options)
        if problem.program.size != optimum.x.size:
            return self.led_to(optimum.tensions)
        old, rows = before.program.rows, problem.program.rows
        lam_g = np.zeros(rows.size)
        for kind in np.unique(old):
            if np.sum(old == kind) == np.sum(rows == kind):
                lam_g[rows == kind] = optimum.lam_g[old == kind]
        start = optimum.x, problem.parameters(SEARCHED), None, (optimum.lam_x, lam_g)
        candidate = solve(problem, *start, "near")
        check_time()
        return self._stable(candidate)

    def _stable(self, candidate: Candidate) -> Candidate | None:
        """Return a candidate if it is an optimum, held to its stability where need be."""
        self._keep(candidate)
        held = (each for optimum in self.unstable for _, each in self._held(optimum) if each)
        return next(chain(self.met, held), None)

    def _keep(self, candidate: Candidate) -> None:
        met = candidate.met and not any(_is_same(candidate, each) for each in self.lost)
        self.trials.append(Trial(candidate.f, met, candidate.iterations))
        if candidate.is_finite:
            self.last = candidate
        if met:
            self.sort(candidate)

    def reject(self) -> None:
        """Reject all optima: the settled arm does not have them.

        Under strong loads the arm may take another shape under the tensions of an optimum. The
        equilibria that it does take are the next guesses.
        """
        if not has_unique_equilibrium(self.task.arm, self.task.scene):
            self.guesses = chain([optimum.tensions for optimum in self.met], self.guesses)
        self.lost = [*self.lost, *self.met]
        self.met = []
        self.trials = [replace(trial, met=False) for trial in self.trials]

    def sort(self, optimum: Candidate) -> None:
        """Keep an optimum with those that are as stable as they have to be, or with the others."""
        x, margin = optimum.x, self.task.options.margin
        if not any(_is_same(optimum, other) for other in self.optima):
            stable = optimum.problem.is_stable(x, margin - COARSE * (margin > 0))
            (self.met if stable else self.unstable).append(optimum)

    def _enough(self) -> bool:
        """Return whether enough guesses led to the best optimum, or later ones to no better one.

        The latter of guesses that come by effort, where the targets are met: how near a shape comes
        has nothing to do with their order.
        """
        if self.task.guesses is not None:
            return False
        trials, mode, count = self.trials, self.mode, self.task.target_set.conditions
        objectives = [trial.objective if trial.met else np.inf for trial in trials]
        best = min(objectives, default=np.inf)
        missed = mode == "nearest" or (mode == "closest" and best > KKT_TOLERANCE)
        hard = missed or (count >= POINT and mode == "exact")
        by_effort = best < np.inf and count > POINT
        since = len(trials) - 1 - objectives.index(best) if by_effort else 0
        return n_equal_optima(trials) >= AGREED + hard or (mode == "exact" and since >= AGREED)

    def best(self, limit: float = np.inf) -> Solution | None:
        """Return the best optimum up to a limit that is stable, and not lost on a finer mesh.

        Unstable ones are held to stability, which makes them dearer, when no other is cheaper.
        """
        lost, unstable = np.inf, {float(f"{each.f:.3g}"): each for each in self.unstable}
        streams = [self._held(unstable[f]) for f in sorted(unstable)[:MOST_HELD]]
        stable = sorted(((each.f, each) for each in self.met), key=itemgetter(0))
        for f, optimum in merge(stable, *streams, key=itemgetter(0)):
            if f > limit:
                return None
            fine = None if optimum is None else refine(optimum)
            if fine is not None:
                cheaper = 1 - float(np.sqrt(lost / fine.f)) if lost < fine.f else 0.0
                cheaper = cheaper if cheaper > 10 * COARSE else 0.0
                self.fine = fine
                return fine.result(self.trials, lost=cheaper)
            if optimum in self.met:
                lost = min(lost, f)
        return None

    def stiffer(self) -> Solution | None:
        """Return a result near rejected optima that is more stable; None if none is found.

        Under strong loads the arm may have other shapes under the tensions of an optimum, and take
        one of them. Shapes that are more stable are more often the ones that it takes.
        """
        if has_unique_equilibrium(self.task.arm, self.task.scene):
            return None
        for floor in STIFFER:
            for optimum in self.optima[:MOST_HELD]:
                for _, held in self._held(optimum, floor):
                    fine = None if held is None else refine(held)
                    if fine is not None:
                        return fine.result(self.trials)
        return None

    def _held(
        self, optimum: Candidate, floor: float = 0.0
    ) -> Iterator[tuple[float, Candidate | None]]:
        """Yield the optimum near another one that is as stable as it has to be, if any is.

        With its objective; first, as no more than that, the objective of the other one alone. The
        stability is at least that of the statement, and at least `floor`. If another mode is less
        stable then, that one is held next.
        """
        yield optimum.f, None
        near, least = optimum, max(self.task.options.least, floor)
        with suppress(OctoplanError, np.linalg.LinAlgError):
            for _ in range(CORRECTIONS):
                problem = near.problem.but(modes=1, floor=least)
                x = problem.closed(near.tensions, near.problem.linearised(near.x).states)
                near = solve(problem, x, problem.parameters(SEARCHED))
                check_time()
                if not near.met:
                    return
                if problem.is_stable(near.x, least - COARSE * least):
                    yield near.f, near
                    return


def _is_same(one: Candidate, other: Candidate) -> bool:
    """Return whether two optima have the same unknowns, but for those of modes that are held."""
    size = min(one.x.size, other.x.size)
    return bool(np.abs(one.x[:size] - other.x[:size]).max() <= SAME_OPTIMUM)


class Search:
    """One planning question and the readings of its targets that answer it; `now` is the last."""

    def __init__(self, task: PlanningProblem) -> None:
        self.task, self.now = task, Reading(task, "exact")
        self._source = initial_guesses(task, is_loaded(task.scene))
        self.samples: Samples | None = None

    def run(self) -> Solution:
        """Return the best optimum from the guesses it takes, or the best so far out of time."""
        try:
            result = self._run()
        except OutOfTime:
            result = self._so_far()
        return replace(result, sampled=self.samples.count if self.samples else 0)

    def _run(self) -> Solution:
        """Return the best optimum of the first reading of the targets that has one.

        Where few guesses meet the targets exactly it is first seen how near they can be had: if
        that is a near miss, exact shapes are looked for from there, and from more guesses.
        """
        unstable, missed = False, None
        terms = self.task.target_set.terms
        can_pull = np.greater(self.task.allowed.upper, self.task.allowed.lower)
        modes: list[Mode] = ["exact"] * bool(terms.count <= can_pull.sum())
        modes += ["closest"] * bool(terms.names[1] or LOW_PRIORITY in terms.inequality_weights)
        for mode in [*modes, "nearest"]:
            wide = self._n_wide if mode != "exact" and self.task.guesses else 0
            guesses = self.guesses(len(missed.trials) if missed else 1, wide)
            near = self.now = Reading(self.task, mode, guesses, last=self.now.last)
            hasty = mode == "exact" and self.task.guesses is None
            near.search(AGREED + 1 if hasty else None, until_met=missed is not None)
            if hasty and not near.optima:
                missed = near
                continue
            if near.is_missed and self._n_wide:
                near = self.now = self._widened(near)
            readings = [near]
            if missed is not None and near.is_all_but_met:
                missed.task = near.task
                missed.guesses = chain([near.optima[0].tensions], missed.guesses)
                readings, missed = [missed, near], None
            for self.now in readings:
                result = self._finished()
                if result is not None:
                    result = self._attained(result)
                    return replace(result, unstable=unstable and result.options.mode != "exact")
                unstable |= bool(self.now.unstable)
            missed = near if hasty else missed
        return replace(self._so_far(stopped=False), unstable=unstable)

    @property
    def _n_wide(self) -> int:
        """The number of sampled shapes to try; they count among the guesses that are asked for."""
        return WIDE if self.task.guesses is None else self.task.guesses // 2

    def _widened(self, reading: Reading) -> Reading:
        """Return a reading that was searched from the nearest of the sampled shapes, too.

        On the mesh of the samples; the optima of a coarser mesh are solved again there.
        """
        if self.samples is None:
            self.samples = sample(self.task, self._n_wide)
        wide: Iterator[Array] = islice(self.samples.distinct(), self._n_wide)
        if self.samples.task is not self.task:
            self.task = self.samples.task
            trials = [replace(trial, met=False) for trial in reading.trials]
            wide = chain((each.tensions for each in reading.optima[:AGREED]), wide)
            reading = Reading(self.task, reading.mode, trials=trials, last=reading.last)
        reading.guesses = wide
        reading.search(until_met=True, until_agreed=False)
        return reading

    def _finished(self) -> Solution | None:
        """Return the best optimum of a reading of the targets, None where there is none.

        Where finer meshes have none of the coarse mesh's optima others are looked for, as if no
        guess had led there. That a default margin of stability cannot be had counts less than that
        targets are missed.
        """
        reading = self.now
        reading.task = self.task
        while True:
            reading.search()
            near = reading.mode != "exact" and any(
                each.f <= KKT_TOLERANCE for each in reading.unstable
            )
            result = reading.best(KKT_TOLERANCE if near and self.task.best_margin else np.inf)
            if result is None and reading.mode == "exact":
                result = reading.stiffer()
            if result is not None or near or not reading.met:
                break
            reading.reject()
        if result is not None or not reading.unstable or not self.task.best_margin:
            return result
        # The best that is stable at all.
        stated = self.task.options.but(margin=0.0)
        self.task = replace(self.task, options=stated, best_margin=False)
        self.now = replace(reading, task=self.task, met=[], unstable=[])
        for optimum in reading.optima:
            self.now.sort(replace(optimum, problem=optimum.problem.but(margin=0.0)))
        return self.now.best()

    def _attained(self, near: Solution) -> Solution:
        """Return the best result that meets all targets, `near` itself if none is found.

        If `near` is of least squares that all but vanish, programs corrected by the defect of its
        mesh are solved with residuals of 0, from its tensions, beside these and from initial
        guesses.
        """
        reading, task = self.now, self.now.task
        if reading.mode == "exact" or reading.fine is None or reading.fine.f > ATTAINABLE:
            return near
        fine = reading.fine
        mesh = fine.problem.options.refinement
        problem = Problem(task, task.coarse("exact").but(refinement=mesh))
        try:
            with suppress(OctoplanError, np.linalg.LinAlgError):
                corrected = on_mesh(fine, problem, task.settled(fine.tensions))
                guesses = chain([fine.tensions], beside(corrected), self.guesses())
                limited = islice(guesses, task.max_guesses)
                exact = Reading(task, "exact", limited, corrected=corrected)
                exact.search()
                return exact.best() or near
        except OutOfTime:
            return replace(near, stopped=True)
        return near

    def guesses(self, tried: int = 1, wide: int = 0) -> Iterator[Array]:
        """Yield initial guesses, tensions (n_tendons,) [N], as many as are tried at most.

        Without the `wide` guesses, which are sampled shapes.
        After the likeliest those beyond some that were tried before: another reading of the targets
        seldom leads farther from these. Where these missed equalities alone others are fitted
        without regard to effort; fits that have inequalities, too, end where these are violated.
        """
        self._source, again = tee(self._source)
        before = list(islice(again, tried))
        yield from before[:1]
        together = self.task.target_set
        if tried > 1 and together.conditions > POINT and not together.terms.names[2]:
            again = initial_guesses(self.task, is_loaded(self.task.scene), missed=True)
        yield from islice(again, max(self.task.max_guesses - tried - wide, 0))
        yield from before[1:]

    def _so_far(self, stopped: bool = True) -> Solution:
        """Return the best that was seen: of optima that of least effort, else what came last."""
        seen = [*self.now.met, *self.now.lost]
        best = min(seen, key=attrgetter("f"), default=self.now.last)
        if best is None:
            *_, T = islice(drawn_arms(self.task), 2)
            options = self.task.coarse("nearest")
            return Solution(options, self.task.arm.by_section(T), (), (), (), stopped)
        return best.result(self.now.trials, stopped=stopped)
