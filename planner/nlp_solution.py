"""Solutions of nonlinear programs: unknowns, multipliers and the residual of optimality.

With tensions and decisions a, dependent unknowns S (states of the rod and dependents of blocks) and
the equations c(a, S) = 0, whose Jacobian c_S is square and regular, a function r of both has the
derivative

    dr/da = r_a + mu^T c_a,    c_S^T mu = -r_S

along c = 0. With r the Lagrangian of objective and design rows, mu are the multipliers of the
equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.linalg import norm
from scipy.sparse import csc_array

from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.problem import Problem, factorised
from octoplan.planner.solution import Solution, Trial

# Largest residual of the first-order conditions of an optimum, scaled [-].
KKT_TOLERANCE = 1e-6
# Largest miss of a stability margin [-]: eigenvalues on another mesh have other digits.
STABILITY_TOLERANCE = 1e-4
# Smallest sum of multipliers and gradient that scales the residual [-].
_LEAST_SCALE = 1e-2
# Largest distance to a bound that counts in complementarity, in units of the unknown or row [-].
_FAR = 1e3


@dataclass(frozen=True, eq=False)
class SolverResult:
    """The last iterate of a solver.

    Attributes
    ----------
    x : (n_x,)
        Scaled unknowns.
    lam_x, lam_g : (n_x,), (n_rows,)
        Multipliers of bounds and rows, with CasADi's signs: negative at a lower bound.
    f : float
        Objective.
    converged : bool
        Whether the solver reports convergence and all numbers are finite. The certificate does not
        rely on this report.
    iterations : int
    """

    x: Array
    lam_x: Array
    lam_g: Array
    f: float
    converged: bool
    iterations: int

    @property
    def is_finite(self) -> bool:
        """Whether every number is finite."""
        return bool(np.isfinite(np.hstack([self.x, self.f, self.lam_x, self.lam_g])).all())


@dataclass(frozen=True, eq=False)
class NlpSolution(SolverResult):
    """A solution of the program of a planning problem.

    Attributes
    ----------
    problem : Problem
    defect : (n,) or None
        Defect of the mesh for which the program was solved, see octoplan.planner.solve.refine.
    """

    problem: Problem = field(kw_only=True)
    defect: Array | None = field(default=None, kw_only=True)

    @property
    def tensions(self) -> Array:
        """The tensions (n_tendons,) [N]."""
        return self.problem.tensions(self.x)

    @property
    def task(self) -> PlanningProblem:
        """The planning problem, with the base at the joint values of the solution."""
        return self.problem.task.at_base(self.problem.base_joints(self.x))

    @property
    def controls(self) -> Array:
        """The tensions (n_tendons,) [N], followed by the values of base joints if any."""
        return np.append(self.tensions, self.problem.base_joints(self.x))

    def settled(self, near: Shape | None = None) -> Shape:
        """Return the settled shape under the tensions; see PlanningProblem.settled."""
        return self.task.settled(self.tensions, near)

    @cached_property
    def derivatives(self) -> tuple[Array, Array, csc_array]:
        """The gradient of the objective, the rows and the Jacobian of the rows."""
        p = self.problem.parameters_at(self.x, self.problem.parameters(defect=self.defect))
        return self.problem.program.evaluate(self.x, p)[1:]

    def with_adjoint(self) -> NlpSolution:
        """Return the solution with multipliers of the equations from those of the design rows.

        Multipliers of states and dependents, which have no bounds, are zero.
        """
        n, m = self.problem.program.n_decision, self.problem.program.n_design_rows
        gradient, _, J = self.derivatives
        lam_g = self.lam_g[:m]
        slope = gradient + J[:m].T @ lam_g
        adjoint = factorised(J[m:].tocsc()[:, n + 1 :]).solve(-slope[n + 1 :], "T")
        lam_x = np.append(self.lam_x[:n], np.zeros(self.x.size - n))
        return replace(self, lam_x=lam_x, lam_g=np.append(lam_g, adjoint))

    @cached_property
    def residual(self) -> float:
        """The residual of the first-order conditions, scaled, at an equilibrium.

        The largest of: a component of the Lagrangian's gradient; a violation of a row or a bound;
        the product of a multiplier and the distance to the bound. NaN counts as infinite.
        """
        program = self.problem.program
        n, m = program.n_decision, program.n_design_rows
        gradient, g, J = self.derivatives
        adjoint = self.with_adjoint()
        lam = np.append(adjoint.lam_x[:n], adjoint.lam_g[:m])
        stationarity = (gradient + J.T @ adjoint.lam_g + adjoint.lam_x)[:n]
        lbx, ubx, lbg, ubg = self.problem.bounds
        values = np.append(self.x[:n], g[:m])
        above = values - np.append(lbx[:n], lbg[:m])
        below = np.append(ubx[:n], ubg[:m]) - values
        largest_multiplier = norm(np.append(lam[n:], 0.0), np.inf)
        scale = _LEAST_SCALE + norm(gradient[:n], np.inf) + largest_multiplier
        distance = np.minimum(np.abs(np.where(lam < 0, above, below)), _FAR)
        violation = np.maximum(-np.minimum(above, below), 0.0)
        residuals = np.concatenate([stationarity / scale, violation, lam * distance / scale])
        largest = float(norm(residuals, np.inf))
        return largest if np.isfinite(largest) else np.inf

    def result(self, trials: Sequence[Trial], **more: Any) -> Solution:
        """Return the solution of a search that ends here, after trials."""
        problem = self.problem
        program = problem.program
        return Solution(
            problem.options,
            problem.arm.by_section(self.tensions),
            tuple(self.lam_x[: program.n_decision].tolist()),
            tuple(self.lam_g[: program.n_design_rows].tolist()),
            tuple(trials),
            base=problem.base_joints(self.x),
            iterations=self.iterations,
            optimum=None if self.defect is None else self,
            **more,
        )
