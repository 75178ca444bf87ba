"""Nonlinear program of a design: parameters of the arm, and the programs of all tasks.

    minimise    the weighted sum of the tasks' objectives
    subject to  the constraints of each task, with equilibrium equations of parameters n(z)
                manufacturing margins(z) >= 0,   0 <= z <= 1

The variables are the unknown parameters z of the arm, as fractions of their bounds' ranges, and the
tensions and states of each task. The solver is ipopt. CasADi differentiates the equilibrium
equations with respect to their parameters n. NumPy evaluates n in closed form from z (profiles,
integrals over cross-sections, loads on nodes that move with the arm), without solving equations;
difference quotients give dn/dz. The Hessian neglects the curvature of n(z), which affects K rows
and columns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.scene import Scene
from octoplan.model.support.errors import InputError
from octoplan.model.support.progress import check_time
from octoplan.planner.extensions.fit.manufacturing import ManufacturingLimits, Objective, Reach
from octoplan.planner.extensions.fit.unknowns import Parameters, neighbour
from octoplan.planner.extensions.trajectory.side_by_side import Part, SideBySide, joined
from octoplan.planner.limits import TendonLimits
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from octoplan.planner.program_instance import Bounds, ProgramInstance, tension_scales
from octoplan.planner.solution import SolverResult
from octoplan.planner.solve.ipopt import SIDE_BY_SIDE, WARM
from octoplan.planner.targets.base import Target
from octoplan.planner.targets.target_set import TargetSet

Targets = tuple[Target, ...]
# Refinement of the tasks' meshes.
_REFINEMENT = 2
# Constraint violation below which a task counts as met; the final plans have certificates.
_MET = 1e-7


@dataclass(frozen=True, eq=False)
class DesignOptimum:
    """A local optimum of a design.

    Attributes
    ----------
    values : (K,)
        Values of the unknowns.
    tensions : (tasks, n_tendons)
        [N].
    violation : float
        Largest violation of a constraint, over the arm's length or in rad.
    objective : float
        Half the sum of squared tensions [N2]; or the mean logarithm of compliances over the
        compliances of the given arm at rest; or minus the reach over the given arm's length.
    """

    values: Array
    tensions: Array
    violation: float
    objective: float

    @property
    def cost(self) -> tuple[float, float]:
        """Key for comparisons: constraint violation first, then the objective."""
        return max(self.violation - _MET, 0.0), self.objective


class DesignProgram:
    """Tasks of an arm with unknown parameters.

    Attributes
    ----------
    parameters : Parameters
        The unknowns, with the arm and the scene.
    limits : TendonLimits
        Limits of the tensions.
    manufacturing : ManufacturingLimits
    tasks, weights : sequences
        Targets of each task, and the weight of its objective. A reach is an additional task, last.
    planned : tuple of Targets
        The given tasks, without the reach.
    objective_unit : float
        Value of one unit of the program's objective.
    instances : list of ProgramInstance
        The nonlinear program of each task.
    K : int
        Number of unknowns.
    """

    def __init__(
        self,
        parameters: Parameters,
        tasks: Sequence[Targets],
        limits: TendonLimits,
        manufacturing: ManufacturingLimits,
        objective: Objective = "effort",
    ) -> None:
        self.parameters = parameters
        self.limits = limits
        self.manufacturing = manufacturing
        _, self.arm, scene = parameters.setting(parameters.start)
        self.tasks = tuple(tasks)
        self.weights = [1.0] * len(tasks)
        self.objective_unit = 1.0
        if objective == "effort":
            self.objective_unit = float(tension_scales(self.arm, limits).max() ** 2)
        if isinstance(objective, Reach):
            self.tasks = (*tasks, (objective,))
            self.weights = [*[0.0] * len(tasks), 1.0]
        elif objective != "effort":
            self.tasks = tuple((*task, objective) for task in tasks)
            self.weights = [1 / len(tasks)] * len(tasks)
        self.planned = self.tasks[: len(tasks)]
        stated = NlpOptions(refinement=_REFINEMENT)
        self.instances = [
            ProgramInstance(PlanningProblem(self.arm, task, scene, limits, stated, _MET))
            for task in self.tasks
        ]
        if objective == "effort":
            self.weights = [
                instance.effort_unit**2 / self.objective_unit for instance in self.instances
            ]
        self.K = len(parameters.unknowns)

    def system(self, i: int, arm: Arm, scene: Scene) -> DiscreteRod:
        """Return the equations of a task for an arm, on nodes that move along with the arm."""
        nominal = self.instances[i].forward.system
        before = TargetSet(nominal.arm, self.tasks[i]).stations
        after = TargetSet(arm, self.tasks[i]).stations
        return neighbour(nominal, arm, scene, before, after)

    def equation_parameters(self, values: Array) -> list[Array]:
        """Return the parameters of each task's equations, and last the manufacturing margins.

        Raises InputError if the values are invalid for an arm.
        """
        _, arm, scene = self.parameters.setting(values)
        parameters = list[Array]()
        by_structure = dict[Any, Array]()
        for i, instance in enumerate(self.instances):
            targets = instance.target_set
            directions = tuple(D.tobytes() for D in targets.directions)
            key = targets.stations, targets.requests, directions
            if key not in by_structure:
                system = self.system(i, arm, scene)
                by_structure[key] = instance.kernel_parameters(system)
            parameters.append(by_structure[key])
        return [*parameters, self.manufacturing.margins(arm)]

    def initial_variables(self, values: Array, tensions: Array) -> Array:
        """Return the variables for an arm whose tasks are in equilibrium under tensions."""
        _, arm, scene = self.parameters.setting(values)
        parts = list[Array]()
        parameters = self.equation_parameters(values)
        for i, (instance, T) in enumerate(zip(self.instances, tensions, strict=True)):
            states = CollocationMap(self.system(i, arm, scene)).solve(T).states
            parts.append(instance.complete(T, states, parameters[i]))
        return np.concatenate([*parts, self.parameters.fractions(values)])

    def solve(self, values: Array, tensions: Array, fixed: bool = False) -> DesignOptimum:
        """Solve the program from an arm and its plans; `fixed` holds the parameters of the arm.

        Return the initial point if the solution is worse.
        """
        x, bounds, solution = self._solve_from(values, tensions, fixed)
        first = self._optimum(x, bounds)
        last = self._optimum(solution.x, bounds)
        return min(last, first, key=lambda optimum: optimum.cost)

    def sensitivity(self, values: Array, tensions: Array) -> Array:
        """Return derivatives of the objective with respect to the values (K,).

        The tensions are optimal for each value. The derivatives are minus the multipliers of the
        fixed values.
        """
        _, _, solution = self._solve_from(values, tensions, fixed=True)
        multipliers = solution.lam_x[-self.K :]
        return np.asarray(-self.objective_unit * multipliers / self.parameters.range)

    def _solve_from(
        self, values: Array, tensions: Array, fixed: bool
    ) -> tuple[Array, Bounds, SolverResult]:
        """Return the initial variables for an arm and its plans, the bounds, and the solution.

        Raises OutOfTime if the time limit stopped ipopt. A reach starts at the first task's
        tensions.
        """
        x = self.initial_variables(values, np.array([*tensions, tensions[0]][: len(self.tasks)]))
        z = x[-self.K :]
        n_margins = self.manufacturing.margins(self.arm).size
        ends = (z, z) if fixed else (np.zeros(self.K), np.ones(self.K))
        each = [instance.bounds for instance in self.instances]
        bounds = joined(each, ends, (np.zeros(n_margins), np.full(n_margins, np.inf)))
        solution = self.stated.solve(SIDE_BY_SIDE, x, np.zeros(0), bounds)
        if solution.is_finite:
            multipliers = solution.lam_x, solution.lam_g
            solution = self.stated.solve(WARM, solution.x, np.zeros(0), bounds, multipliers)
        if not solution.converged:
            check_time()
        return x, bounds, solution

    def _optimum(self, x: Array, bounds: Bounds) -> DesignOptimum:
        """Return the point of the program as an optimum."""
        f, g = (np.array(v).ravel() for v in self.stated.values(x, []))
        violation = np.concatenate([bounds[2] - g, g - bounds[3], [0.0]]).max()
        *each, z = self.stated.split(x)
        pairs = zip(self.instances, each, strict=True)
        return DesignOptimum(
            values=self.parameters.from_fractions(np.clip(z, 0.0, 1.0)),
            tensions=np.array([instance.tensions(item) for instance, item in pairs]),
            violation=float(violation) if np.isfinite(violation) else np.inf,
            objective=self.objective_unit * float(f[0]),
        )

    def all_equation_parameters(self, z: Array) -> Array:
        """Return all equation parameters and margins (n,) at z; InputError for an invalid arm."""
        return np.concatenate(self.equation_parameters(self.parameters.from_fractions(z)))

    def parameter_jacobian(self, z: Array) -> Array:
        """Return the derivatives (n, K) of all equation parameters and margins by z."""
        values = self.parameters.from_fractions(z)
        at_values = self.equation_parameters(values)
        parts = self.parameters.derivatives(self.equation_parameters, at_values, values)
        return np.vstack(parts) * self.parameters.range

    @cached_property
    def stated(self) -> SideBySide:
        """The program in CasADi symbols: the tasks, which share the parameters of the arm."""
        sizes = list(map(len, self.equation_parameters(self.parameters.start)))
        cuts = np.cumsum([0, *sizes]).tolist()
        n_margins = sizes[-1]
        K = self.K
        at = SideBySide(
            [instance.program.size for instance in self.instances],
            [instance.program.row_kinds.size for instance in self.instances],
            K,
            n_margins,
            0,
        )
        *xs, z = at.unknowns
        *lams, _ = at.multipliers
        # CasADi does not keep callbacks alive: hold references for the life of the program.
        self._callbacks = [
            ClosedForm(self.all_equation_parameters, K, (cuts[-1], 1)),
            ClosedForm(self.parameter_jacobian, K, (cuts[-1], K)),
        ]
        parameters, by_z = (ca.vertsplit(callback(z), cuts) for callback in self._callbacks)
        tasks = zip(self.instances, self.weights, xs, parameters, by_z, lams, strict=False)
        parts = [_part(problem, w, x, n, J, lam, at.sigma) for problem, w, x, n, J, lam in tasks]
        J = ca.horzcat(ca.MX(n_margins, at.ends[-1]), by_z[-1])
        return at.stated(parts, Part(ca.MX(0), ca.MX(K, 1), parameters[-1], J, ca.MX(K, K)))


def _part(
    instance: ProgramInstance,
    weight: float,
    x: ca.MX,
    parameters: ca.MX,
    by_z: ca.MX,
    lam: ca.MX,
    sigma: ca.MX,
) -> Part:
    """Return a task's part of the program, with derivatives with respect to (x, z).

    The arguments are the weight of the task's objective, its variables x, the parameters n of its
    equations with their derivatives by z, the multipliers of its constraints, and the factor of the
    objective in the Hessian. The equations are functions of y = (x in SI units, n); the chain rule
    gives the derivatives by (x, z).
    """
    of = instance.program
    p = ca.DM(instance.parameters())
    K = by_z.size2()
    unit = of.scale(p)
    row_scale = p[of.parts["row_scale"]]
    m = of.n_design_rows
    weights = weight * sigma, lam[:m]
    f, gradient, rows, rows_J, rows_H = of.design.call([x, p, *weights], True, False)
    equations = of.equations.with_parameters_as_variables()
    y = ca.vertcat(unit * x, parameters)
    none = ca.MX(0, 1)
    chain = ca.diagcat(ca.MX(ca.diag(unit)), by_z)
    J = equations.jacobian
    H = equations.hessian
    by_y = ca.diag(1 / row_scale) @ ca.MX(J.places, J.function(y, none))[:, :-1]
    equation_H = ca.MX(H.places, H.function(y, none, lam[m:] / row_scale))
    return Part(
        weight * f,
        ca.vertcat(weight * gradient, ca.MX(K, 1)),
        ca.vertcat(rows, equations.value.function(y, none) / row_scale),
        ca.vertcat(ca.horzcat(rows_J, ca.MX(m, K)), by_y @ chain),
        chain.T @ equation_H @ chain + ca.diagcat(rows_H, ca.MX(K, K)),
    )


class ClosedForm(ca.Callback):
    """CasADi callback: a matrix that NumPy evaluates from z (K,).

    The matrix is NaN if z is invalid for an arm, so that the solver shortens its step.
    """

    def __init__(self, function: Callable[[Array], Array], K: int, shape: tuple[int, int]) -> None:
        super().__init__()
        self._K = K
        self._shape = shape
        # One iteration of ipopt evaluates the callback up to four times, partly at the same z.
        self._at = lru_cache(maxsize=4)(lambda z: ca.DM(function(np.array(z))))
        self.construct("closed_form", {})

    def get_sparsity_in(self, _: int) -> ca.Sparsity:
        """Return the sparsity of z: dense."""
        return ca.Sparsity.dense(self._K)

    def get_sparsity_out(self, _: int) -> ca.Sparsity:
        """Return the sparsity of the matrix: dense."""
        return ca.Sparsity.dense(*self._shape)

    def eval(self, given: Sequence[ca.DM]) -> list[ca.DM]:
        """Evaluate the matrix."""
        try:
            return [self._at(tuple(np.array(given[0]).ravel().tolist()))]
        except InputError:
            return [ca.DM.nan(*self._shape)]
