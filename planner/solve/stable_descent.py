"""Optima that are stable: descents along stable shapes, and margins of stability.

A search imports this file if loads act before tensions, or if an optimum is not stable enough.

Under strong loads an arm has several shapes under the same tensions, and solves from a guess often
end at an unstable one. Each iterate of a descent is an equilibrium on the branch of the last one,
so that the unknowns are tensions and decisions alone (octoplan.planner.solve.reduced_program). A
step is taken if it decreases the merit, and if the new shape is stable. While the linearised rows
cannot be met in the box of the step, the merit is the objective and a penalty of violations; from
then on, the augmented Lagrangian, because a penalty of violations shortens steps along curved rows.
The rows state the stability only near folds: after a step that was not stable enough, or two steps
to no equilibrium. The eigenvalue of the least stable mode then has the required stability as bound.

Source: Nocedal, Wright, "Numerical Optimization", 2nd ed., 17.3 (augmented Lagrangian), 18.5
(S-l1-QP), 15.6 (second-order correction).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.continuation import with_poses
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.newton import Start, newton
from octoplan.model.equilibrium.stability import is_stable
from octoplan.model.paths import Array
from octoplan.model.rotations import POSE
from octoplan.model.support.errors import OctoplanError, SnapError
from octoplan.model.support.progress import check_time
from octoplan.planner.linearised_blocks import STABILITY, LeastMode
from octoplan.planner.program_instance import SEARCH_WEIGHT, ProgramInstance
from octoplan.planner.solution import NlpSolution
from octoplan.planner.solve.ipopt import solve
from octoplan.planner.solve.reduced_program import ReducedProgram, Step, elastic_step
from octoplan.planner.solve.refine import COARSE_RTOL, CORRECTIONS

# Lower bounds on the stability, tried in this order, if the arm takes another shape under the
# tensions of all optima [-]; 1 is an arm at rest.
STABILITY_FLOORS = (0.3, 0.5)
# Largest distance of nodes over L at which two shapes are the same [-].
SAME_SHAPE = 1e-2
# Excess over the required stability from which on the rows do not state the stability [-]; 1 is an
# arm at rest. The rows cost as much time as the rest of a step.
_FAR_FROM_FOLD = 0.2
# Number of steps in succession to no equilibrium after which the rows state the stability, because
# a fold is near.
_LOST = 2
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
# Share of the largest decrease of the linearised violation that each step has, and factor of the
# penalty until then [-].
_STEERING = 0.1
_PENALTY_GROWTH = 3.0
# Weight of squared violations in the augmented Lagrangian: a violation of 0.01 L weighs as much as
# a tenth of a usual objective [-].
_SQUARES = 100.0
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


def descend(
    instance: ProgramInstance, start: Equilibrium, defect: Array | None = None
) -> NlpSolution:
    """Return the optimum that a descent from a stable shape leads to, corrected by a defect.

    The solution counts as converged if its rows are met, except for the stability. `start` is an
    equilibrium on the mesh of the problem. Raise SingularError or LinAlgError if the program has no
    derivatives there.
    """
    descent = _Descent(instance, start, defect)
    if not instance.options.modes and not is_stable(start, instance.options.stability_bound):
        descent.state_stability()
    while descent.proceed():
        check_time()
    return descent.solution()


def descend_from_guess(
    instance: ProgramInstance,
    forward: CollocationMap,
    tensions: Array,
    defect: Array | None = None,
    known: Sequence[NlpSolution] = (),
) -> NlpSolution | None:
    """Return the optimum of a descent from the last stable shape on the way to tensions [N].

    If the arm takes another shape under the tensions of the optimum, descend again from there with
    more stability: the arm more often takes shapes with more stability. `forward` has the equations
    of equilibrium at the base of the guess. None if there is no such shape.

    The arm takes the shapes of `known` optima.
    """
    with suppress(OctoplanError, np.linalg.LinAlgError):
        start = forward.solve_towards(tensions)
        count = 0
        for floor in (instance.options.floor, *STABILITY_FLOORS):
            solution = descend(instance.replace(floor=floor), start, defect)
            count += solution.iterations
            solution = replace(solution, iterations=count)
            if not solution.converged or any(_is_equal(solution, each) for each in known):
                return solution
            try:
                start = instance.forward_at(solution.problem.arm).solve(solution.tensions)
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
    if optimum.instance.forward.loads_first:
        instance = optimum.instance.replace(modes=1, floor=bound)
        with suppress(OctoplanError, np.linalg.LinAlgError):
            near = descend(instance, instance.linearised(optimum.x))
            return (
                near if near.converged and instance.is_stable(near.x, bound - tolerance) else None
            )
        return None
    with suppress(OctoplanError, np.linalg.LinAlgError):
        for _ in range(CORRECTIONS):
            instance = near.instance.replace(modes=1, floor=bound)
            states = near.instance.linearised(near.x).states
            x = instance.complete(near.tensions, states)
            near = solve(instance, x, instance.parameters(SEARCH_WEIGHT))
            check_time()
            if not near.converged:
                break
            if instance.is_stable(near.x, bound - tolerance):
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

    def __init__(self, instance: ProgramInstance, start: Equilibrium, defect: Array | None) -> None:
        self._defect = defect
        self.point = self._at(instance, start)
        self.lam = np.zeros(self.point.rows.size)
        self.width = _FIRST_WIDTH
        self.penalty = _FIRST_PENALTY
        self.count = 0
        self._n_lost = 0
        # Modes that the descent adds are dropped again.
        self._modes = instance.options.modes

    def _at(self, instance: ProgramInstance, equilibrium: Equilibrium) -> ReducedProgram:
        """Return the program at an equilibrium."""
        p = instance.parameters(SEARCH_WEIGHT, self._defect)
        return ReducedProgram(instance, equilibrium, p)

    def _merit(self, point: ReducedProgram, lam: Array | None) -> float:
        """Return the objective plus the penalty of all rows."""
        return point.f + self._penalty_of(point, point.rows, lam)

    def _penalty_of(self, point: ReducedProgram, rows: Array, lam: Array | None) -> float:
        """Return the penalty of values of the design rows.

        Without multipliers (m,), the sum of violations times the penalty. With multipliers, the
        terms of the augmented Lagrangian, which hardly oppose steps along curved rows.
        """
        if lam is None:
            return self.penalty * float(point.violation(rows).sum())
        lower, upper = point.row_bounds
        is_equality = lower == upper
        residual = (rows - upper)[is_equality]
        result = lam[is_equality] @ residual + _SQUARES / 2 * residual @ residual
        for excess, mu in ((rows - upper, lam), (lower - rows, -lam)):
            before = np.maximum(mu, 0.0)[~is_equality]
            now = np.maximum(before + _SQUARES * excess[~is_equality], 0.0)
            result += float(now @ now - before @ before) / (2 * _SQUARES)
        return float(result)

    def proceed(self) -> bool:
        """Take one step; return whether another step may decrease the merit."""
        self.count += 1
        if self.count > _STEPS or self.width < _LEAST_WIDTH:
            return False
        point = self.point
        H = point.hessian(self.lam)
        step = self._step(H)
        if step is None:
            return False
        d = step.change
        violation = point.violation_after(np.zeros_like(d))
        is_elastic = point.violation_after(d) > _MET
        lam = None if is_elastic else step.lam
        model = point.f + float(point.gradient @ d + d @ H @ d / 2)
        model += self._penalty_of(point, point.rows + point.jacobian @ d, lam)
        predicted = self._merit(point, lam) - model
        size = float(np.abs(d[point.instance.controls]).max())
        is_inside = size < 0.9 * self.width
        scale = point.f + self.penalty * violation
        is_met = is_elastic or violation <= _MET
        if is_met and predicted <= (_END_RTOL if is_inside else _LEAST_RTOL) * scale:
            self.lam = step.lam
            return False
        after, decrease = self._trial(d, lam)
        if after is not None and decrease < _POOR * predicted:
            # Rows are curved: repeat the step with the rows at its end.
            rows = after.rows - point.jacobian @ d
            again = elastic_step(point, H, rows, self.penalty, self.width)
            if again is not None:
                corrected, change = self._trial(again.change, lam)
                if change > decrease:
                    after, decrease, d = corrected, change, again.change
        if after is not None and decrease > _FAILS * predicted:
            if decrease < _POOR * predicted:
                self.width = _SHRINKAGE * size
            elif decrease > _GOOD * predicted and not is_inside:
                self.width *= _GROWTH
            self._take(after, step.lam, is_elastic)
            self._n_lost = 0
        else:
            self._n_lost += after is None
            ends = self._is_unstable or self._n_lost >= _LOST
            if after is None and ends and not point.instance.options.modes:
                self.state_stability()
            else:
                self.width = _CUT * size
        return True

    def _step(self, H: Array) -> Step | None:
        """Return the step of the quadratic model, or None; increase the penalty if necessary.

        The linearised violation has to vanish if it can in the box, and otherwise has to fall by a
        share of its largest decrease (steering rules: Byrd, Nocedal, Waltz, Optimization Methods
        and Software 23, 2008).
        """
        point = self.point
        step = elastic_step(point, H, point.rows, self.penalty, self.width)
        violation = point.violation_after(np.zeros(len(H)))
        if step is None or violation <= _MET or point.violation_after(step.change) <= _MET:
            return step
        best = elastic_step(point, H, point.rows, _LARGEST_PENALTY, self.width)
        if best is None:
            return step
        least = point.violation_after(best.change)
        required = (1.0 if least <= _MET else _STEERING) * (violation - least) - _MET
        while violation - point.violation_after(step.change) < required:
            if self.penalty * _PENALTY_GROWTH >= _LARGEST_PENALTY:
                return best
            self.penalty *= _PENALTY_GROWTH
            again = elastic_step(point, H, point.rows, self.penalty, self.width)
            step = best if again is None else again
        return step

    def _trial(self, d: Array, lam: Array | None) -> tuple[ReducedProgram | None, float]:
        """Return the program after a step, and the decrease of the merit.

        None if there is no equilibrium nearby, or if the equilibrium is not stable enough.
        """
        self._is_unstable = False
        point = self.point
        instance = point.instance
        bound = 0.0 if instance.options.modes else instance.options.stability_bound
        with suppress(OctoplanError, np.linalg.LinAlgError):
            equilibrium = _moved(point, d) or _moved(point, d, halves=2)
            if equilibrium is not None:
                self._is_unstable = not is_stable(equilibrium, bound)
                if not self._is_unstable:
                    after = self._at(instance, equilibrium)
                    return after, self._merit(point, lam) - self._merit(after, lam)
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
        options = after.instance.options
        if options.modes > self._modes:
            excess = options.stability_bound + _FAR_FROM_FOLD
            if is_stable(after.equilibrium, excess):
                self._replace_modes(self._modes)

    def state_stability(self) -> None:
        """Add the least stable mode to the program."""
        self._replace_modes(1)

    def _replace_modes(self, modes: int) -> None:
        """Continue with the least stable mode, or without; the other rows are the same."""
        before = self.point.instance
        instance = before.replace(modes=modes)
        if self._defect is not None:
            # The defect of the stability is not known.
            larger = instance if modes else before
            names = [type(block) for block in larger.blocks]
            place = larger.program.measured[names.index(LeastMode)].start
            if modes:
                self._defect = np.insert(self._defect, place, 0.0)
            else:
                self._defect = np.delete(self._defect, place)
        lam = self.lam[self._is_other_row()]
        self.point = self._at(instance, self.point.equilibrium)
        self.lam = np.zeros(self.point.rows.size)
        self.lam[self._is_other_row()] = lam

    def _is_other_row(self) -> NDArray[np.bool_]:
        """Return which design rows (m,) do not state the stability."""
        kinds = self.point.instance.program.row_kinds[: self.point.rows.size]
        return np.asarray(kinds != STABILITY, dtype=bool)

    def solution(self) -> NlpSolution:
        """Return the last point as a solution."""
        point = self.point
        program = point.instance.program
        lam_x = np.zeros(point.x.size)
        lam_x[: program.n_decision] = -(point.gradient + self.lam @ point.jacobian)
        violations = point.violation(point.rows)
        others = self._is_other_row()
        return NlpSolution(
            point.x,
            lam_x,
            point.multipliers(self.lam),
            point.f,
            bool(violations[others].max(initial=0.0) <= _MET),
            self.count,
            instance=point.instance,
            defect=self._defect,
        )


def _moved(point: ReducedProgram, d: Array, halves: int = 1) -> Equilibrium | None:
    """Return the equilibrium after a step d (n,) on the branch of a point, or None.

    The step is taken in `halves` parts, which are predicted along the equilibria.
    """
    instance = point.instance
    change = point.along(d)
    states = point.equilibrium.states
    end: Equilibrium | None = None
    for k in range(halves):
        share = (k + 1) / halves
        x = point.x.copy()
        x[: d.size] += share * d
        arm = instance.problem.at_base(instance.base_joints(x)).arm
        system = instance.forward_at(arm).system
        start = Start(instance.tensions(x), 1.0, with_poses(system, states + change / halves))
        (end,) = newton(system, [start])
        if end is None:
            return None
        states = end.states
    return end


def _is_equal(optimum: NlpSolution, other: NlpSolution) -> bool:
    """Return whether an optimum of the same problem has nearly the shape and the objective."""
    if optimum.problem.arm != other.problem.arm or abs(optimum.f - other.f) > SAME_SHAPE * other.f:
        return False
    return _has_shape(optimum, other.instance.linearised(other.x))


def _has_shape(optimum: NlpSolution, shape: Equilibrium) -> bool:
    """Return whether an equilibrium on the mesh of an optimum has the shape of the optimum."""
    states = optimum.instance.linearised(optimum.x).states
    places = shape.system.layout.nodes[:, 4:POSE]
    apart = np.linalg.norm(states[places] - shape.states[places], axis=1)
    return bool(apart.max() <= SAME_SHAPE * optimum.instance.arm.length)
