"""From a question to tensions: build, solve from several starts, polish, look at it twice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from model.arm import Arm
from model.errors import OctoplanError
from model.forward import schemes_of
from model.loaded.forward import unloaded
from model.paths import Array
from model.patience import OutOfTime, check_time, time_limit
from model.progress import tell, told
from model.scene import Scene
from model.settle import settle
from model.statics import is_loaded
from model.stiffness import stiffness
from planner.program.limits import Limits
from planner.program.problem import TRACES, Problem, build
from planner.program.statement import Mode, Statement
from planner.program.terms import looks_of
from planner.solve.ipopt import Solution, solve
from planner.solve.polish import optimality, polish
from planner.solve.starts import candidates, spread
from planner.targets.base import Target

# Starts before agreement counts: five do for points; mirrored optima agree without meaning.
_FEW, _MORE = 5, 10
# Loaded arms start from the optima of the unloaded one, among which the search was.
_FEWEST = 2
_INSIDE = 0.005
_LITTLE = 1e-5
_FINE_IF_UNSETTLED = 16


@dataclass(frozen=True)
class Start:
    """One first guess and what became of it: the objective reached, and whether it was met."""

    objective: float
    met: bool
    iterations: int


@dataclass(frozen=True, eq=False)
class Found:
    """What a search ends with: how the question was stated, tensions, multipliers, starts.

    `stopped` says that the time limit ended it.
    """

    statement: Statement
    tensions: Array
    lam_x: tuple[float, ...]
    lam_g: tuple[float, ...]
    starts: tuple[Start, ...]
    stopped: bool = False


class Search:
    """One planning question and the steps that answer it."""

    def __init__(
        self,
        arm: Arm,
        targets: tuple[Target, ...],
        scene: Scene,
        limits: Limits,
        statement: Statement,
        accuracy: float,
    ) -> None:
        self.arm, self.targets, self.scene = arm, targets, scene
        self.asked, self.limits = limits, allowed(arm, targets, limits)
        self.statement, self.accuracy = statement, accuracy
        self.coarse = search_mesh(scene, statement)
        terms = self._problem("exact").terms
        is_point = terms.numel_out(0) + terms.numel_out(1) <= 3 and terms.numel_out(2) == 0
        self.least = _FEW if is_point else _MORE
        if is_loaded(scene):
            self.least = _FEWEST
        self.seen: list[tuple[Mode, Solution]] = []

    def run(self, most: int, seconds: float | None = None) -> Found:
        """Return the best optimum from so many starts, or the best so far after so long."""
        try:
            with time_limit(seconds):
                return self._run(most)
        except OutOfTime:
            return self._so_far()

    def _so_far(self) -> Found:
        """Return the best that was seen before the time was over, on the coarse mesh.

        Of optima the one of least effort, else where the last solve was, else the least tensions.
        """
        records = tuple(Start(s.f, s.met, s.iterations) for _, s in self.seen)
        if not self.seen:
            T = self.arm.by_section(np.array(self.limits.lower))
            return Found(self.coarse, T, (), (), records, True)
        met = [(mode, s) for mode, s in self.seen if mode == "exact" and s.met]
        mode, best = min(met, key=lambda item: item[1].f) if met else self.seen[-1]
        return Found(
            self.coarse.but(mode=mode),
            self.arm.by_section(self._tensions(best)),
            tuple(best.lam_x.tolist()),
            tuple(best.lam_g.tolist()),
            records,
            True,
        )

    def _run(self, most: int) -> Found:
        """Try the readings of the targets in turn; planner.program.problem has the three modes."""
        guesses = candidates(self._problem("exact"), self.targets, self.limits)
        starts = spread(guesses, most)
        if is_loaded(self.scene):
            starts = spread([*self._without_loads(starts), *((0.0, T) for T in starts)], most)
        first, others = starts[: self.least], starts[self.least :]
        records: list[Start] = []
        best: Solution | None = None
        if self._can_be_exact():
            records, best = self._from_starts(first, "exact", records, best)
        if best is None:
            fallback = self._fallback(starts)
            if not self._can_be_exact() or fallback[0].f > _LITTLE:
                return self._finish(*fallback)
            others = [self._tensions(fallback[0]), *others]
        records, best = self._from_starts(others, "exact", records, best)
        return self._finish(best, records, "exact") if best else self._finish(*fallback)

    def _without_loads(self, starts: list[Array]) -> list[tuple[float, Array]]:
        """Return the optima of the unloaded arm, best first: the loaded ones are near.

        Those for the shape alone, if there is one: how stiff it is has to be found with the loads.
        """
        scene, statement = unloaded(self.scene), self.statement.but(form="condensed")
        shape = tuple(target for target in self.targets if target.look() is None) or self.targets
        free = Search(self.arm, shape, scene, self.asked, statement, self.accuracy)
        problem = free._problem("exact" if free._can_be_exact() else "closest")
        found = [free._solve(problem, T) for T in starts[: free.least]]
        met = sorted((s for s in found if s.finite), key=lambda s: (not s.met, s.f))
        return [(0.0, free._tensions(s)) for s in met]

    def _can_be_exact(self) -> bool:
        """Return whether there are tendons enough to meet every row of match and approach."""
        terms = self._problem("exact").terms
        free = np.sum(np.array(self.limits.upper) > self.limits.lower)
        return bool(terms.numel_out(0) + terms.numel_out(1) <= free)

    def _fallback(self, starts: list[Array]) -> tuple[Solution, list[Start], Mode]:
        """Return the closest shape, or the nearest if what has to be met cannot be."""
        closest = self._problem("closest")
        closer = closest.terms.numel_out(1) > 0 or closest.n_lack > 0
        modes: tuple[Mode, ...] = ("closest", "nearest") if closer else ("nearest",)
        for mode in modes:
            records, best = self._from_starts(starts, mode, [], None)
            if best is not None:
                return best, records, mode
        found = [s for s in (self._solve(self._problem(mode), T) for T in starts) if s.finite]
        if not found:
            raise OctoplanError("no start led to a shape; check the arm, the limits and the target")
        return min(found, key=lambda s: s.f), records, mode

    def _from_starts(
        self, starts: list[Array], mode: Mode, records: list[Start], best: Solution | None
    ) -> tuple[list[Start], Solution | None]:
        """Go on solving on the coarse mesh, from each start, until the best was found twice."""
        problem, records = self._problem(mode), list(records)
        for T in told(f"first guesses, {mode}", starts):
            if best is not None and len(records) >= self.least and _twice(records, best.f):
                break
            solution = self._solve(problem, T)
            records.append(Start(solution.f, solution.met, solution.iterations))
            if solution.met and (best is None or solution.f < best.f):
                best = solution
        return records, best

    def _solve(self, problem: Problem, T: Array) -> Solution:
        p = problem.parameters(self.targets, self.limits, TRACES[0])
        bounds, x = problem.bounds(self.limits), problem.unknowns(T, self.limits, p)
        n = self.arm.n_tendons
        x[:n] = np.clip(np.maximum(x[:n], _INSIDE), bounds[0][:n], bounds[1][:n])
        solution = solve(problem, x, p, bounds)
        if solution.finite:
            self.seen.append((problem.statement.mode, solution))
        check_time()
        return solution

    def _finish(self, coarse: Solution, records: list[Start], mode: Mode) -> Found:
        """Return the plan on a mesh as fine as the accuracy asks for."""
        tell("the last digits")
        T = self._tensions(coarse)
        statement = self._fine_statement(T, mode)
        problem = build(self.arm, self.targets, self.scene, statement)
        p, bounds = problem.parameters(self.targets, self.limits), problem.bounds(self.limits)
        guess = self._warm(problem, coarse, T, p)
        fine = polish(problem, guess, p, bounds)
        if fine is guess:
            solved = solve(problem, guess.x, p, bounds, (guess.lam_x, guess.lam_g))
            polished = polish(problem, solved, p, bounds) if solved.finite else guess
            fine = min((polished, guess), key=lambda s: self._worst(problem, s, p, bounds))
        return Found(
            statement,
            self.arm.by_section(problem.tensions(fine.x, self.limits)),
            tuple(fine.lam_x.tolist()),
            tuple(fine.lam_g.tolist()),
            tuple(records),
        )

    def _worst(self, problem: Problem, s: Solution, p: Array, bounds: Any) -> float:
        return optimality(problem, s.x, p, s.lam_x, s.lam_g, bounds).worst

    def _warm(self, problem: Problem, coarse: Solution, T: Array, p: Array) -> Solution:
        """Return the coarse solution as a guess on the fine mesh; multipliers carry over."""
        x = problem.unknowns(T, self.limits, p)
        g = np.array(problem.derivatives.slopes(x, p)[1]).ravel()
        parts = (x, coarse.lam_x, coarse.lam_g, coarse.f, g)
        return Solution(*parts, coarse.met, coarse.reason, coarse.iterations)

    def _fine_statement(self, T: Array, mode: Mode) -> Statement:
        """Return the statement on the mesh that settles T to a tenth of the accuracy.

        And that gives its stiffness as well, where a target looks at it.
        """
        scheme = fine_scheme(self.scene, self.statement)
        fine = self.accuracy / 10
        try:
            mesh = settle(self.arm, T, self.scene, fine, scheme).refinement
            for look in looks_of(self.targets):
                found = stiffness(self.arm, T, self.scene, look.hold, accuracy=fine)
                mesh = max(mesh, found.refinement)
        except OctoplanError:
            mesh = _FINE_IF_UNSETTLED
        return self.statement.but(mode=mode, scheme=scheme, refinement=mesh)

    def _problem(self, mode: Mode) -> Problem:
        """Return the problem on the coarse mesh."""
        return build(self.arm, self.targets, self.scene, self.coarse.but(mode=mode))

    def _tensions(self, solution: Solution) -> Array:
        return self._problem("exact").tensions(solution.x, self.limits)


def fine_scheme(scene: Scene, statement: Statement) -> str:
    """Return the scheme on which a plan is finished; multiple shooting is by Runge-Kutta."""
    return schemes_of(scene)[0] if statement.form == "condensed" else "rk6"


def search_mesh(scene: Scene, statement: Statement) -> Statement:
    """Return the statement by a scheme and mesh that cost little: good to 1 % of L or so."""
    if fine_scheme(scene, statement) == "magnus6":
        return statement.but(scheme="magnus2", refinement=2)
    return statement.but(scheme="rk4", refinement=2)


def _twice(records: list[Start], best: float) -> bool:
    near = best + 1e-3 * abs(best) + 1e-12
    return sum(record.met and record.objective <= near for record in records) >= 2


def allowed(arm: Arm, targets: tuple[Target, ...], limits: Limits) -> Limits:
    """Return the limits, with tendons that a target does not let pull held at their minima."""
    tendons = frozenset.intersection(*(target.tendons(arm) for target in targets))
    return limits.restricted(tendons)
