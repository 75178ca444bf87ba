"""The program of a design: numbers of the arm, and the programs of all tasks, as one.

    minimise    the sum of the tasks' objectives
    subject to  the constraints of each task, its equations of equilibrium with numbers n(z)
                what can be made: room(z) >= 0,   0 <= z <= 1

with z the unknown numbers of the arm between their bounds, and for each task its tensions and
states; solved by ipopt. The equations are differentiated by their numbers n by CasADi. The numbers
are closed forms of z in NumPy (profiles, integrals over cross-sections, loads on nodes that move
along with the arm), for which nothing is solved: their own derivatives by z are differences. In the
Hessian they count as linear in z: it is of K rows and columns that this leaves something out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.load_steps import Collocation
from octoplan.model.paths import Array
from octoplan.model.rod.system import DiscreteRod
from octoplan.model.scene import Scene
from octoplan.model.support.errors import InputError
from octoplan.model.support.progress import check_time
from octoplan.planner.extensions.fit.making import Making, Objective, Reach
from octoplan.planner.extensions.fit.unknowns import Parameters, neighbour
from octoplan.planner.extensions.trajectory.side_by_side import Part, SideBySide, joined
from octoplan.planner.program.problem import Bounds, Problem, Solution, units
from octoplan.planner.program.terms import Targets as Together
from octoplan.planner.question import Limits, Statement
from octoplan.planner.solve.ipopt import TOGETHER, WARM
from octoplan.planner.targets.base import Target
from octoplan.planner.task import Task

Targets = tuple[Target, ...]
# Of the meshes; the residual up to which a task counts as met: plans are certified afresh.
_REFINEMENT, _MET = 2, 1e-7


@dataclass(frozen=True, eq=False)
class DesignOptimum:
    """A local optimum.

    Attributes
    ----------
    values : (K,)
        Of the unknowns.
    tensions : (tasks, n_tendons)
        [N].
    missed : float
        The largest violation of a constraint, over the arm's length or in rad.
    objective : float
        Half the sum of squared tensions [N2], the mean logarithm of compliances over those of the
        given arm at rest, or with a minus the reach over the given arm's length.
    """

    values: Array
    tensions: Array
    missed: float
    objective: float

    @property
    def cost(self) -> tuple[float, float]:
        """What is compared: what is missed first."""
        return max(self.missed - _MET, 0.0), self.objective


class DesignProgram:
    """Tasks of an arm with unknown numbers, which are `planned`; a reach is one task more."""

    def __init__(
        self,
        parameters: Parameters,
        tasks: Sequence[Targets],
        limits: Limits,
        making: Making,
        objective: Objective = "effort",
    ) -> None:
        self.parameters, self.limits, self.making = parameters, limits, making
        _, self.arm, scene = parameters.setting(parameters.start)
        self.tasks, self.weights = tuple(tasks), [1.0] * len(tasks)
        # What one unit of the objective is worth.
        self.worth = float(units(self.arm, limits).max() ** 2) if objective == "effort" else 1.0
        if isinstance(objective, Reach):
            self.tasks, self.weights = (*tasks, (objective,)), [*[0.0] * len(tasks), 1.0]
        elif objective != "effort":
            self.tasks = tuple((*task, objective) for task in tasks)
            self.weights = [1 / len(tasks)] * len(tasks)
        self.planned = self.tasks[: len(tasks)]
        stated = Statement(refinement=_REFINEMENT)
        self.problems = [
            Problem(Task(self.arm, task, scene, limits, stated, _MET)) for task in self.tasks
        ]
        if objective == "effort":
            self.weights = [of.effort_unit**2 / self.worth for of in self.problems]
        self.K = len(parameters.unknowns)

    def system(self, i: int, arm: Arm, scene: Scene) -> DiscreteRod:
        """Return the equations of a task's arm, on nodes that move along with it."""
        of = self.problems[i].forward.system
        ends = (Together(each, self.tasks[i]).stations for each in (of.arm, arm))
        return neighbour(of, arm, scene, *ends)

    def numbers(self, values: Array) -> list[Array]:
        """Return the numbers of each task's equations, and last what room is left to the making.

        Raises InputError where no such arm can be.
        """
        _, arm, scene = self.parameters.setting(values)
        numbers, by_structure = list[Array](), dict[Any, Array]()
        for i, problem in enumerate(self.problems):
            forces, targets = problem.forces, problem.together
            key = targets.stations, targets.requests, forces.tobytes()
            if key not in by_structure:
                system = self.system(i, arm, scene)
                by_structure[key] = problem.program.numbers(system, forces)
            numbers.append(by_structure[key])
        return [*numbers, self.making.room(arm)]

    def begun(self, values: Array, tensions: Array) -> Array:
        """Return the unknowns of an arm whose tasks are in equilibrium under tensions."""
        _, arm, scene = self.parameters.setting(values)
        parts, numbers = list[Array](), self.numbers(values)
        for i, (problem, T) in enumerate(zip(self.problems, tensions, strict=True)):
            states = Collocation(self.system(i, arm, scene)).solve(T).states
            parts.append(problem.closed(T, states, numbers[i]))
        return np.concatenate([*parts, self.parameters.fractions(values)])

    def solve(self, values: Array, tensions: Array, fixed: bool = False) -> DesignOptimum:
        """Return the optimum that an arm and its plans lead to, numbers of the arm `fixed` or not.

        Or the best of all that were met on the way, where that is these themselves.
        """
        x, bounds, solution = self._followed(values, tensions, fixed)
        first = self._optimum(x, bounds)
        last = self._optimum(solution.x, bounds)
        return min(last, first, key=lambda optimum: optimum.cost)

    def sensitivity(self, values: Array, tensions: Array) -> Array:
        """Return derivatives of the objective by the values (K,), all tensions chosen anew.

        They are less the multipliers of the values, held at the optimum of the tensions.
        """
        _, _, solution = self._followed(values, tensions, fixed=True)
        return np.asarray(-self.worth * solution.lam_x[-self.K :] / self.parameters.range)

    def _followed(
        self, values: Array, tensions: Array, fixed: bool
    ) -> tuple[Array, Bounds, Solution]:
        """Return the unknowns of an arm and its plans, the bounds, and what ipopt makes of them.

        OutOfTime where the time limit stopped it.
        """
        x = self.begun(values, np.array([*tensions, tensions[0]][: len(self.tasks)]))
        z, room = x[-self.K :], self.making.room(self.arm).size
        ends = (z, z) if fixed else (np.zeros(self.K), np.ones(self.K))
        each = [problem.bounds for problem in self.problems]
        bounds = joined(each, ends, (np.zeros(room), np.full(room, np.inf)))
        solution = self.stated.solve(TOGETHER, x, np.zeros(0), bounds)
        if solution.is_finite:
            known = solution.lam_x, solution.lam_g
            solution = self.stated.solve(WARM, solution.x, np.zeros(0), bounds, known)
        if not solution.met:
            check_time()
        return x, bounds, solution

    def _optimum(self, x: Array, bounds: Bounds) -> DesignOptimum:
        f, g = (np.array(v).ravel() for v in self.stated.values(x, []))
        off = np.concatenate([bounds[2] - g, g - bounds[3], [0.0]]).max()
        *each, z = self.stated.split(x)
        pairs = zip(self.problems, each, strict=True)
        T = np.array([problem.tensions(item) for problem, item in pairs])
        missed = float(off) if np.isfinite(off) else np.inf
        values = self.parameters.from_fractions(np.clip(z, 0.0, 1.0))
        return DesignOptimum(values, T, missed, self.worth * float(f[0]))

    def all_numbers(self, z: Array) -> Array:
        """Return all numbers (n,) at z; raises InputError where no such arm can be."""
        return np.concatenate(self.numbers(self.parameters.from_fractions(z)))

    def first_derivatives(self, z: Array) -> Array:
        """Return their derivatives (n, K) by z."""
        values = self.parameters.from_fractions(z)
        parts = self.parameters.derivatives(self.numbers, self.numbers(values), values)
        return np.vstack(parts) * self.parameters.range

    @cached_property
    def stated(self) -> SideBySide:
        """The program in symbols: the tasks, with the numbers of the arm in common."""
        cuts = np.cumsum([0, *map(len, self.numbers(self.parameters.start))]).tolist()
        room, K = cuts[-1] - cuts[-2], self.K
        sizes = [problem.program.size for problem in self.problems]
        rows = [problem.program.rows.size for problem in self.problems]
        at = SideBySide(sizes, rows, K, room, 0)
        (*xs, z), (*lams, _) = at.unknowns, at.multipliers
        # CasADi does not keep the closed forms that a program calls.
        self._closed = [
            NumbersOfArm(self.all_numbers, K, (cuts[-1], 1)),
            NumbersOfArm(self.first_derivatives, K, (cuts[-1], K)),
        ]
        values, by_z = (ca.vertsplit(each(z), cuts) for each in self._closed)
        tasks = zip(self.problems, self.weights, xs, values, by_z, lams, strict=False)
        parts = [_part(problem, w, x, n, J, lam, at.sigma) for problem, w, x, n, J, lam in tasks]
        J = ca.horzcat(ca.MX(room, at.ends[-1]), by_z[-1])
        return at.stated(parts, Part(ca.MX(0), ca.MX(K, 1), values[-1], J, ca.MX(K, K)))


def _part(
    problem: Problem,
    weight: float,
    x: ca.MX,
    numbers: ca.MX,
    by_z: ca.MX,
    lam: ca.MX,
    sigma: ca.MX,
) -> Part:
    """Return a task's part at unknowns x, numbers n and their derivatives by z.

    And the weights of its constraints and of the objective. The equations see y = (unknowns in SI,
    n); the chain rule takes them to (x, z).
    """
    of, p, K = problem.program, ca.DM(problem.parameters()), by_z.size2()
    whole, scale, m = of.scale(p), p[of.parts["row_scale"]], of.n_outer
    weights = weight * sigma, lam[:m]
    f, gradient, outer, outer_J, outer_H = of.outer.call([x, p, *weights], True, False)
    equations = of.equations.in_numbers()
    y, none = ca.vertcat(whole * x, numbers), ca.MX(0, 1)
    chain = ca.diagcat(ca.MX(ca.diag(whole)), by_z)
    J, H = equations.jacobian, equations.hessian
    by_y = ca.diag(1 / scale) @ ca.MX(J.places, J.function(y, none))[:, :-1]
    curved = chain.T @ ca.MX(H.places, H.function(y, none, lam[m:] / scale)) @ chain
    return Part(
        weight * f,
        ca.vertcat(weight * gradient, ca.MX(K, 1)),
        ca.vertcat(outer, equations.value.function(y, none) / scale),
        ca.vertcat(ca.horzcat(outer_J, ca.MX(m, K)), by_y @ chain),
        curved + ca.diagcat(outer_H, ca.MX(K, K)),
    )


class NumbersOfArm(ca.Callback):
    """A matrix of z (K,) in NumPy as CasADi calls it.

    No numbers where no such arm can be, so that the solver shortens its step.
    """

    def __init__(self, of: Callable[[Array], Array], K: int, shape: tuple[int, int]) -> None:
        super().__init__()
        self._K, self._shape = K, shape
        # A step asks for them up to four times.
        self._at = lru_cache(maxsize=4)(lambda z: ca.DM(of(np.array(z))))
        self.construct("closed_form", {})

    def get_sparsity_in(self, _: int) -> ca.Sparsity:
        """Return that z is dense."""
        return ca.Sparsity.dense(self._K)

    def get_sparsity_out(self, _: int) -> ca.Sparsity:
        """Return that the matrix is dense."""
        return ca.Sparsity.dense(*self._shape)

    def eval(self, given: Sequence[ca.DM]) -> list[ca.DM]:
        """Return the matrix."""
        try:
            return [self._at(tuple(np.array(given[0]).ravel().tolist()))]
        except InputError:
            return [ca.DM.nan(*self._shape)]
