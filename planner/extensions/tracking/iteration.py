"""Iterations of a tracking step: linearise the program, solve the conic program, settle the arm."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.linearised import AnyEquilibrium, Equilibrium, check_stretch
from octoplan.model.equilibrium.modes import stability_slope
from octoplan.model.equilibrium.newton import Start, newton, step_sizes
from octoplan.model.equilibrium.stability import is_stable
from octoplan.model.forward import forward_maps
from octoplan.model.loads import is_coupled
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.support.errors import OctoplanError
from octoplan.planner.extensions.tracking.quadratic import Linearisation, QuadraticModel
from octoplan.planner.extensions.tracking.step_program import (
    LinearRows,
    StepProgram,
    StepSolution,
)
from octoplan.planner.program_instance import ProgramInstance
from octoplan.planner.solve.refine import defect
from octoplan.planner.targets.target_set import EQUALITY, INEQUALITY, TargetRows

# Difference of the stability from its margin below which the margin is a row of the program [-].
_NEAR_MARGIN = 0.1
# Number of times that the change of an iteration is halved.
_HALVINGS = 3
# Factor of the tolerances of Newton's method: equilibria are exact to 1e-9.
_TOLERANCE_FACTOR = 1e4
# Error of a predicted change of the states, over the change, above which the tangent is replaced.
_TANGENT_RTOL = 0.03
# Smallest unit of the objective, over the effort of the largest change of a step [-].
_LEAST_EFFORT = 1e-3


@dataclass(frozen=True, eq=False)
class Iterate:
    """Tensions, the settled shape, and the unknowns of the program.

    Attributes
    ----------
    x : (size,)
        Unknowns of the program. The tensions are those of the shape; the states are close to the
        equilibrium on the mesh of the program.
    multipliers : (n_rows,)
        Multipliers of the rows of the program.
    defect : (n,)
        Measurements of the shape minus the measurements at x.
    shape : Shape
    tangent : Equilibrium or None
        An equilibrium nearby, whose factors and derivatives predict the next shape. Shapes without
        loads have no tangent.
    """

    x: Array
    multipliers: Array
    defect: Array
    shape: Shape
    tangent: Equilibrium | None

    @property
    def tensions(self) -> Array:
        """The tensions (n_tendons,) [N]."""
        return self.shape.tensions


class StabilityRow(NamedTuple):
    """The stability, linearised in the tensions.

    Attributes
    ----------
    value : float
        At `tensions`.
    slope : (n_tendons,)
        [1/N].
    tensions : (n_tendons,)
        [N].
    """

    value: float
    slope: Array
    tensions: Array


class Iteration:
    """The map from an iterate to the next one, for a planning problem.

    Attributes
    ----------
    instance : ProgramInstance
        The program on its coarse mesh. The stability margin is a row of the step, not a block.
    """

    def __init__(self, instance: ProgramInstance, shape: Shape, largest_change: Array) -> None:
        """Prepare iterations.

        Parameters
        ----------
        instance : ProgramInstance
        shape : Shape
            The first shape; all shapes are settled on its mesh.
        largest_change : (n_tendons,)
            Largest change of each tension in a step [N].
        """
        self.instance = instance
        program = instance.program
        blocks = zip(instance.blocks, program.parameters, strict=True)
        self._target_place = next(at for each, at in blocks if isinstance(each, TargetRows))
        self._linearisation = Linearisation(program)
        self._forward = forward_maps(
            instance.arm, instance.scene, instance.problem.machine_code
        ).on(shape.refinement)
        self._error = shape.error
        self._is_coupled = is_coupled(instance.arm, instance.scene)
        self._least_effort = _LEAST_EFFORT * self._effort(largest_change / instance.unit)
        terms = instance.target_set.terms
        kinds = program.row_kinds[: program.n_design_rows]
        self._weights = np.zeros(kinds.size)
        soft = np.ones(len(terms.names[1]))
        self._weights[kinds == EQUALITY] = np.append(terms.equality_weights, soft)
        self._weights[kinds == INEQUALITY] = terms.inequality_weights

    def first(self, shape: Shape) -> Iterate:
        """Return the iterate at a settled shape; raise the errors of `settle`."""
        instance = self.instance
        states = instance.forward.solve(shape.tensions, shape.collocated).states
        x = instance.complete(shape.tensions, states)
        multipliers = np.zeros(instance.program.row_kinds.size)
        return self._at(x, multipliers, shape, shape.collocated)

    def next(
        self, at: Iterate, numbers: Array, box: tuple[Array, Array], limits: LinearRows
    ) -> tuple[Iterate | None, StepSolution | None, bool]:
        """Return the next iterate, the solution of the conic program, and whether it was shortened.

        Parameters
        ----------
        at : Iterate
        numbers : (n,)
            Parameters of the targets.
        box : (n_tendons,), (n_tendons,)
            Smallest and largest tensions of the step [N].
        limits : LinearRows
            Further limits, by changes of the tensions [N].

        The iterate is None if the arm has no equilibrium near the last one, if the arm buckles, or
        if a solver fails.
        """
        instance = self.instance
        p = instance.parameters(defect=at.defect)
        p[self._target_place] = numbers
        solution: StepSolution | None = None
        with suppress(OctoplanError, np.linalg.LinAlgError):
            model = self._linearisation.at(at.x, instance.parameters_at(at.x, p), at.multipliers)
            solution = self._step_program(at, model, box, limits).solve()
        if solution is None:
            return None, None, False
        x = at.x + model.step(solution.change)
        T = np.clip(instance.tensions(x), *box)
        settled = self._settled(T, at)
        if settled is not None:
            x[: T.size] = T / instance.unit
            multipliers = model.multipliers(solution.change, solution.rows)
            return self._at(x, multipliers, *settled), solution, False
        for halving in range(1, _HALVINGS + 1):
            nearer = self.between(at, T, 0.5**halving)
            if nearer is not None:
                return nearer, solution, True
        return None, solution, True

    def between(self, at: Iterate, tensions: Array, share: float) -> Iterate | None:
        """Return an iterate on the line from an iterate to tensions (n_tendons,) [N].

        Return None if the arm has no equilibrium nearby.
        """
        instance = self.instance
        T = at.tensions + share * (tensions - at.tensions)
        settled = self._settled(T, at)
        if settled is None:
            return None
        with suppress(OctoplanError, np.linalg.LinAlgError):
            point = instance.forward.solve_from(instance.linearised(at.x), T)
            if point is not None:
                return self._at(instance.complete(T, point.states), at.multipliers, *settled)
        return None

    @property
    def margin(self) -> float:
        """The smallest stability of a shape under loads."""
        return self.instance.options.stability_bound

    def has_reserve(self, shape: Shape) -> bool:
        """Return whether the stability of a shape is well above its margin."""
        return self.is_stable(shape, self.margin + _NEAR_MARGIN)

    def is_stable(self, shape: Shape, margin: float) -> bool:
        """Return whether a shape is stable with a margin; shapes without loads are stable."""
        point = shape.collocated
        return not self._is_coupled or point is None or is_stable(point, margin)

    def stability_row(self, shape: Shape) -> StabilityRow | None:
        """Return the linearised stability of a shape; None if the equations are singular."""
        point = shape.collocated
        if point is None:
            return None
        with suppress(OctoplanError, np.linalg.LinAlgError):
            value, slope = stability_slope(point.relinearised())
            return StabilityRow(value, slope, shape.tensions)
        return None

    def terms(self, shape: Shape, numbers: Array) -> tuple[Array, Array, Array]:
        """Return equalities, soft residuals and inequalities of the targets at a shape."""
        targets = self.instance.target_set
        poses = shape.poses(np.array(targets.stations)).ravel()
        equality, soft, inequality, _ = targets.terms.dense(poses, numbers, np.zeros(0))
        return equality.ravel(), soft.ravel(), inequality.ravel()

    def _at(
        self, x: Array, multipliers: Array, shape: Shape, tangent: Equilibrium | None
    ) -> Iterate:
        """Return the iterate with unknowns x and a shape under the same tensions."""
        return Iterate(x, multipliers, defect(self.instance, x, shape), shape, tangent)

    def _effort(self, tensions: Array) -> float:
        """Return half the sum of squares of scaled tensions (n_tendons,), over the unit."""
        T = tensions * self.instance.unit / self.instance.effort_unit
        return float(T @ T) / 2

    def _step_program(
        self, at: Iterate, model: QuadraticModel, box: tuple[Array, Array], limits: LinearRows
    ) -> StepProgram:
        """Return the conic program of the next change of the decisions."""
        instance = self.instance
        n = instance.program.n_decision
        m = instance.program.n_design_rows
        t = instance.arm.n_tendons
        x = at.x[:n]
        lbx, ubx, lbg, ubg = instance.bounds
        lower = lbx[:n] - x
        upper = ubx[:n] - x
        lower[:t] = np.maximum(lower[:t], box[0] / instance.unit - x[:t])
        upper[:t] = np.minimum(upper[:t], box[1] / instance.unit - x[:t])
        by_decisions = np.zeros((limits.values.size, n))
        by_decisions[:, :t] = limits.jacobian * instance.unit
        return StepProgram(
            model=model,
            effort=max(self._effort(x[:t]), self._least_effort),
            # The last iterate is within all bounds, up to rounding.
            lower=np.minimum(lower, 0.0),
            upper=np.maximum(upper, 0.0),
            row_bounds=(lbg[:m], ubg[:m]),
            weights=self._weights,
            limits=limits._replace(jacobian=by_decisions),
        )

    def _settled(self, tensions: Array, at: Iterate) -> tuple[Shape, Equilibrium | None] | None:
        """Return the shape under tensions (n_tendons,) and the tangent; None if there is none.

        The shape is on the branch of the iterate.
        """
        with suppress(OctoplanError, np.linalg.LinAlgError):
            forward = self._forward
            if not isinstance(forward, CollocationMap):
                return self._shape(forward.solve(tensions), at), None
            point, tangent = _equilibrium(forward, tensions, at)
            if point is not None:
                return self._shape(point, at), tangent
        return None

    def _shape(self, point: AnyEquilibrium, at: Iterate) -> Shape:
        """Return the shape of an equilibrium; raise CollapsedError."""
        check_stretch(point)
        instance = self.instance
        return Shape(instance.arm, instance.scene, self._error, point, at.shape.refinement)


def _equilibrium(
    forward: CollocationMap, tensions: Array, at: Iterate
) -> tuple[Equilibrium | None, Equilibrium | None]:
    """Return the equilibrium under tensions on the branch of an iterate, and the next tangent.

    Newton's method starts with the factors of the tangent. The tangent is replaced if the error of
    its prediction exceeds a share of the change.
    """
    before = at.shape.collocated
    tangent = at.tangent
    assert before is not None and tangent is not None
    load = float(before.x[before.system.layout.n_tendons])
    change = tangent.by_tensions @ (tensions - before.tensions)
    predicted = before.states + change
    start = Start(tensions, load, predicted, tangent, _TOLERANCE_FACTOR, "near")
    (point,) = newton(forward.system, [start])
    if point is None:
        point = forward.solve_from(before, tensions)
        return point, point
    both = np.array([change, point.states - predicted])
    _, (size, error) = step_sizes(forward.system, both, np.array([point.states] * 2))
    return point, point.relinearised() if error > _TANGENT_RTOL * size else tangent
