"""Optima that are stable: descents along stable shapes, and margins of stability.

A search imports this file if loads act before tensions, or if an optimum is not stable enough.

Under strong loads an arm has several shapes under the same tensions, and solves from a guess often
end at an unstable one. Each iterate of a descent is an equilibrium on the branch of the last one,
so that the unknowns are tensions and decisions alone (octoplan.planner.solve.reduced_program). A
step is taken if it decreases the merit, which is the objective and a penalty of violated rows, and
if the new shape is stable. The rows state the stability only after a step that was not stable
enough: the eigenvalue of the least stable mode then has the required stability as bound.

Source: Nocedal, Wright, "Numerical Optimization", 2nd ed., 18.5 (S-l1-QP), 15.6 (second-order
correction).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.newton import Start, newton
from octoplan.model.equilibrium.stability import is_stable
from octoplan.model.paths import Array
from octoplan.model.rotations import POSE
from octoplan.model.support.errors import OctoplanError, SnapError
from octoplan.model.support.progress import check_time
from octoplan.planner.linearised_blocks import STABILITY, LeastMode
from octoplan.planner.problem import SEARCH_WEIGHT, Problem
from octoplan.planner.solution import NlpSolution
from octoplan.planner.solve.ipopt import solve
from octoplan.planner.solve.reduced_program import ReducedProgram, elastic_step
from octoplan.planner.solve.refine import COARSE_RTOL, CORRECTIONS

# Lower bounds on the stability, tried in this order, if the arm takes another shape under the
# tensions of all optima [-]; 1 is an arm at rest.
STABILITY_FLOORS = (0.3, 0.5)
# Largest distance of nodes over L at which two shapes are the same [-].
SAME_SHAPE = 1e-2
# Largest number of steps, including steps that fail.
_STEPS = 80
# Half the width of the first box, in units of the tensions [-].
_FIRST_WIDTH = 0.15
# Half the width of the smallest box [-].
_LEAST_WIDTH = 1e-4
# First penalty of violations: several times the multipliers of most targets [-].
_FIRST_PENALTY = 10.0
# Largest penalty [-].
_LARGEST_PENALTY = 1e4
# Ratio of the penalty to the largest multiplier, and smallest penalty [-]. A large penalty keeps
# steps close to curved rows, so that steps are short.
_PENALTY_RATIO = 1.5
_LEAST_PENALTY = 1.0
# Share of the predicted decrease below which a step fails [-].
_FAILS = 0.05
# Share of the predicted decrease below which a step is corrected, and the box shrinks [-].
_POOR = 0.25
# Share of the predicted decrease from which the box grows [-].
_GOOD = 0.7
# Factors of the width after good, poor and failed steps [-].
_GROWTH = 2.0
_SHRINKAGE = 0.5
_CUT = 0.25
# Predicted decrease of the merit, relative to the merit, at which the descent ends: if the step is
# inside the box, from where the optimum is polished, and otherwise [-].
_END_RTOL = 1e-4
_LEAST_RTOL = 1e-6
# Violation of a row at which the row is met [-].
_MET = 1e-5


def descend(problem: Problem, start: Equilibrium, defect: Array | None = None) -> NlpSolution:
    """Return the optimum that a descent from a stable shape leads to, corrected by a defect.

    The solution counts as converged if its rows are met, except for the stability. `start` is an
    equilibrium on the mesh of the problem. Raise SingularError or LinAlgError if the program has no
    derivatives there.
    """
    descent = _Descent(problem, start, defect)
    if not problem.options.modes and not is_stable(start, problem.options.stability_bound):
        descent.state_stability()
    while descent.proceed():
        check_time()
    return descent.solution()


def descend_from_guess(
    problem: Problem, forward: CollocationMap, tensions: Array, defect: Array | None = None
) -> NlpSolution | None:
    """Return the optimum of a descent from the last stable shape on the way to tensions [N].

    If the arm takes another shape under the tensions of the optimum, descend again from there with
    more stability: the arm more often takes shapes with more stability. `forward` has the equations
    of equilibrium at the base of the guess. None if there is no such shape.
    """
    with suppress(OctoplanError, np.linalg.LinAlgError):
        start = forward.solve_towards(tensions)
        count = 0
        for floor in (problem.options.floor, *STABILITY_FLOORS):
            solution = descend(problem.replace(floor=floor), start, defect)
            count += solution.iterations
            solution = replace(solution, iterations=count)
            if not solution.converged:
                return solution
            try:
                start = problem.forward_at(solution.task.arm).solve(solution.tensions)
            except SnapError:
                # The refinement decides: the coarse mesh snaps too early near a fold.
                return solution
            if _has_shape(solution, start):
                return solution
        return replace(solution, converged=False)
    return None


def enforce_margin(optimum: NlpSolution, bound: float) -> NlpSolution | None:
    """Return an optimum near an unstable optimum with at least the stability `bound`, or None.

    One mode is constrained. If another mode is then below the bound, that mode is constrained next.
    If loads act before tensions, a descent constrains the least stable mode of each shape.
    """
    near = optimum
    tolerance = COARSE_RTOL * bound
    if optimum.problem.forward.loads_first:
        problem = optimum.problem.replace(modes=1, floor=bound)
        with suppress(OctoplanError, np.linalg.LinAlgError):
            near = descend(problem, problem.linearised(optimum.x))
            return near if near.converged and problem.is_stable(near.x, bound - tolerance) else None
        return None
    with suppress(OctoplanError, np.linalg.LinAlgError):
        for _ in range(CORRECTIONS):
            problem = near.problem.replace(modes=1, floor=bound)
            states = near.problem.linearised(near.x).states
            x = problem.complete(near.tensions, states)
            near = solve(problem, x, problem.parameters(SEARCH_WEIGHT))
            check_time()
            if not near.converged:
                break
            if problem.is_stable(near.x, bound - tolerance):
                return near
    return None


class _Descent:
    """The state of a descent.

    Attributes
    ----------
    point : ReducedProgram
        The last stable shape.
    lam : (m,)
        Multipliers of the design rows.
    width : float
        Half the width of the box [-].
    penalty : float
        Weight of violations in the merit.
    count : int
        Number of steps.
    """

    def __init__(self, problem: Problem, start: Equilibrium, defect: Array | None) -> None:
        self._defect = defect
        self.point = self._at(problem, start)
        self.lam = np.zeros(self.point.rows.size)
        self.width = _FIRST_WIDTH
        self.penalty = _FIRST_PENALTY
        self.count = 0

    def _at(self, problem: Problem, equilibrium: Equilibrium) -> ReducedProgram:
        """Return the program at an equilibrium."""
        p = problem.parameters(SEARCH_WEIGHT, self._defect)
        return ReducedProgram(problem, equilibrium, p)

    def _merit(self, point: ReducedProgram) -> float:
        """Return the objective plus the penalty of all violations."""
        return point.f + self.penalty * float(point.violation(point.rows).sum())

    def proceed(self) -> bool:
        """Take one step; return whether another step may decrease the merit."""
        self.count += 1
        if self.count > _STEPS or self.width < _LEAST_WIDTH:
            return False
        point = self.point
        H = point.hessian(self.lam)
        step = elastic_step(point, H, point.rows, self.penalty, self.width)
        if step is None:
            return False
        d = step.change
        violation = float(point.violation(point.rows).sum())
        remaining = float(point.violation(point.rows + point.jacobian @ d).sum())
        if violation > _MET and remaining > 0.99 * violation and self.penalty < _LARGEST_PENALTY:
            self.penalty *= 10.0
            return True
        reduction = self.penalty * (violation - remaining)
        predicted = reduction - float(point.gradient @ d + d @ H @ d / 2)
        is_elastic = violation > _MET and remaining > violation / 2
        size = float(np.abs(d[point.problem.controls]).max())
        is_inside = size < 0.9 * self.width
        if predicted <= (_END_RTOL if is_inside else _LEAST_RTOL) * self._merit(point):
            self.lam = step.lam
            return False
        after, decrease = self._trial(d)
        if after is not None and decrease < _POOR * predicted:
            # Rows are curved: repeat the step with the rows at its end.
            rows = after.rows - point.jacobian @ d
            again = elastic_step(point, H, rows, self.penalty, self.width)
            if again is not None:
                corrected, change = self._trial(again.change)
                if change > decrease:
                    after, decrease, d = corrected, change, again.change
        if after is not None and decrease > _FAILS * predicted:
            if decrease < _POOR * predicted:
                self.width = _SHRINKAGE * size
            elif decrease > _GOOD * predicted and not is_inside:
                self.width *= _GROWTH
            self._take(after, step.lam, is_elastic)
        elif after is None and self._is_unstable and not point.problem.options.modes:
            self.state_stability()
        else:
            self.width = _CUT * size
        return True

    def _trial(self, d: Array) -> tuple[ReducedProgram | None, float]:
        """Return the program after a step, and the decrease of the merit.

        None if there is no equilibrium nearby, or if the equilibrium is not stable enough.
        """
        self._is_unstable = False
        point = self.point
        problem = point.problem
        bound = 0.0 if problem.options.modes else problem.options.stability_bound
        with suppress(OctoplanError, np.linalg.LinAlgError):
            equilibrium = _moved(point, d) or _moved(point, d, halves=2)
            if equilibrium is not None:
                self._is_unstable = not is_stable(equilibrium, bound)
                if not self._is_unstable:
                    after = self._at(problem, equilibrium)
                    return after, self._merit(point) - self._merit(after)
        return None, -np.inf

    def _take(self, after: ReducedProgram, lam: Array, is_elastic: bool) -> None:
        """Continue from the program after a step with multipliers (m,).

        Multipliers at the penalty are no multipliers of the targets: the Hessian keeps the others.
        """
        self.point = after
        largest = float(np.abs(lam).max(initial=0.0))
        if largest < 0.9 * self.penalty:
            self.lam = lam
        if not is_elastic:
            self.penalty = max(_LEAST_PENALTY, _PENALTY_RATIO * largest)

    def state_stability(self) -> None:
        """Add the least stable mode to the program."""
        problem = self.point.problem.replace(modes=1)
        if self._defect is not None:
            # The defect of the stability is not known.
            names = [type(block) for block in problem.blocks]
            place = problem.program.measured[names.index(LeastMode)]
            self._defect = np.insert(self._defect, place.start, 0.0)
        self.point = self._at(problem, self.point.equilibrium)
        kinds = problem.program.row_kinds[: self.point.rows.size]
        lam = np.zeros(self.point.rows.size)
        lam[kinds != STABILITY] = self.lam
        self.lam = lam

    def solution(self) -> NlpSolution:
        """Return the last point as a solution."""
        point = self.point
        program = point.problem.program
        lam_x = np.zeros(point.x.size)
        lam_x[: program.n_decision] = -(point.gradient + self.lam @ point.jacobian)
        violations = point.violation(point.rows)
        others = program.row_kinds[: violations.size] != STABILITY
        return NlpSolution(
            point.x,
            lam_x,
            point.multipliers(self.lam),
            point.f,
            bool(violations[others].max(initial=0.0) <= _MET),
            self.count,
            problem=point.problem,
            defect=self._defect,
        )


def _moved(point: ReducedProgram, d: Array, halves: int = 1) -> Equilibrium | None:
    """Return the equilibrium after a step d (n,) on the branch of a point, or None.

    The step is taken in `halves` parts, which are predicted along the equilibria.
    """
    problem = point.problem
    change = point.along(d)
    states = point.equilibrium.states
    end: Equilibrium | None = None
    for k in range(halves):
        share = (k + 1) / halves
        x = point.x.copy()
        x[: d.size] += share * d
        arm = problem.task.at_base(problem.base_joints(x)).arm
        start = Start(problem.tensions(x), 1.0, states + change / halves)
        (end,) = newton(problem.forward_at(arm).system, [start])
        if end is None:
            return None
        states = end.states
    return end


def _has_shape(optimum: NlpSolution, shape: Equilibrium) -> bool:
    """Return whether an equilibrium on the mesh of an optimum has the shape of the optimum."""
    states = optimum.problem.linearised(optimum.x).states
    places = shape.system.layout.nodes[:, 4:POSE]
    apart = np.linalg.norm(states[places] - shape.states[places], axis=1)
    return bool(apart.max() <= SAME_SHAPE * optimum.problem.arm.length)
