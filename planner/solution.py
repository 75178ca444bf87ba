"""Solutions: the numbers that a search ends with, and the point of the nonlinear program.

A Solution has the numbers of an optimum, which plans keep and save. An NlpSolution is a point of a
program, with unknowns and multipliers.

With tensions and decisions a, dependent unknowns S (states of the rod and dependents of blocks) and
the equations r(a, S) = 0, whose Jacobian r_S is square and regular, a function l of both has the
derivative

    dl/da = l_a + mu^T r_a,    r_S^T mu = -l_S

along r = 0. With l = f + lambda . c the Lagrangian of objective and design rows, mu are the
multipliers of the equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.linalg import norm
from scipy.sparse import csc_array

from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.support.value import Count
from octoplan.planner.block import Constraints
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from octoplan.planner.program_instance import ProgramInstance, factorised

# Largest residual of the first-order conditions of an optimum, scaled [-].
KKT_TOLERANCE = 1e-6
# Largest miss of a stability margin [-]: eigenvalues on another mesh have other digits.
STABILITY_TOLERANCE = 1e-4
# Smallest sum of multipliers and gradient that scales the residual [-].
_LEAST_SCALE = 1e-2
# Largest distance to a bound that counts in complementarity, in units of the unknown or row [-].
_FAR = 1e3


@dataclass(frozen=True)
class Trial:
    """The result of one initial guess.

    Attributes
    ----------
    objective : float
        Value at the point at which the solver stopped.
    met : bool
        Whether this point is an optimum that the search accepts.
    iterations : int
        Iterations of the solver.
    """

    objective: float
    met: bool
    iterations: Count


@dataclass(frozen=True, eq=False)
class Solution:
    """The optimum that a search ends with.

    Attributes
    ----------
    options : NlpOptions
        Options of the last program. The mode is "nearest" if the targets cannot be met.
    tensions : (n_sections, n), or (n_tendons,) if sections differ in their number of tendons
        [N].
    lam_x, lam_g : tuple of float
        Multipliers of bounds and constraints of the last program, scaled, with CasADi's signs.
    starts : tuple of Trial
        Results of the initial guesses, in order.
    stopped : bool
        Whether the time limit ended the search. The tensions are the best that were found.
    jump : float
        Relative change of the tensions from the tensions of the plan `near`, if the search left
        the branch of that plan; otherwise 0.
    lost : float
        Fraction of the effort that a cheaper optimum of the coarse mesh saved, if finer meshes do
        not have this optimum; otherwise 0.
    in_the_way : str
        Description of the obstacle nearest to the plan without obstacles, if that plan meets the
        targets and no plan that keeps clear was found; otherwise empty.
    unstable : bool
        Whether all shapes that meet the targets are below the stability margin.
    load_path : tuple of (n_tendons,)
        Tensions [N] that lead an arm in contact to the shape. From rest the loads act first; then
        tensions change in straight lines to the first, to the next, and to the tensions of the
        solution. Empty if the load path from rest is straight.
    avoidance : Constraints or None
        Inequalities of the last program that keep the arm clear of obstacles.
    base : tuple of float
        Values of the base joints: insertion [m] and rotation [rad]; empty for a fixed base.
    sampled : int
        Number of shapes that were sampled for further guesses; 0 if the first guesses sufficed.
    iterations : int
        Iterations of the last program.
    optimum : NlpSolution or None
        The refined optimum as a point of its program, in the result of a search. A plan stores this
        point apart from its solution: the point is not saved.
    """

    options: NlpOptions
    tensions: Array
    lam_x: tuple[float, ...]
    lam_g: tuple[float, ...]
    starts: tuple[Trial, ...]
    stopped: bool = False
    jump: float = 0.0
    lost: float = 0.0
    in_the_way: str = ""
    unstable: bool = False
    load_path: tuple[tuple[float, ...], ...] = ()
    avoidance: Constraints | None = None
    base: tuple[float, ...] = ()
    sampled: Count = 0
    iterations: Count = 0
    optimum: Any = field(default=None, repr=False, kw_only=True)

    @property
    def controls(self) -> Array:
        """The tensions (n_tendons,) [N], followed by the values of base joints if any."""
        return np.append(self.tensions, self.base)

    @property
    def n_equal_optima(self) -> int:
        """The number of initial guesses that lead to the best objective."""
        return n_equal_optima(self.starts)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Solution):
            return NotImplemented
        names = [f.name for f in fields(self) if f.name not in ("tensions", "optimum")]
        same = all(getattr(self, name) == getattr(other, name) for name in names)
        return same and np.array_equal(self.tensions, other.tensions)

    __hash__ = None  # type: ignore[assignment]


def n_equal_optima(trials: Sequence[Trial]) -> int:
    """Return the number of trials that end at the best objective, to a thousandth."""
    best = min((trial.objective for trial in trials if trial.met), default=float("inf"))
    near = best + 1e-3 * abs(best) + 1e-12
    return sum(trial.met and trial.objective <= near for trial in trials)


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
    instance : ProgramInstance
    defect : (n,) or None
        Defect of the mesh for which the program was solved, see octoplan.planner.solve.refine.
    """

    instance: ProgramInstance = field(kw_only=True)
    defect: Array | None = field(default=None, kw_only=True)

    @property
    def tensions(self) -> Array:
        """The tensions (n_tendons,) [N]."""
        return self.instance.tensions(self.x)

    @property
    def problem(self) -> PlanningProblem:
        """The planning problem, with the base at the joint values of the solution."""
        return self.instance.problem.at_base(self.instance.base_joints(self.x))

    @property
    def controls(self) -> Array:
        """The tensions (n_tendons,) [N], followed by the values of base joints if any."""
        return np.append(self.tensions, self.instance.base_joints(self.x))

    def settled(self, near: Shape | None = None) -> Shape:
        """Return the settled shape under the tensions; see PlanningProblem.settled."""
        return self.problem.settled(self.tensions, near)

    @cached_property
    def derivatives(self) -> tuple[Array, Array, csc_array]:
        """The gradient of the objective, the rows and the Jacobian of the rows."""
        p = self.instance.parameters_at(self.x, self.instance.parameters(defect=self.defect))
        return self.instance.program.evaluate(self.x, p)[1:]

    def with_adjoint(self) -> NlpSolution:
        """Return the solution with multipliers of the equations from those of the design rows.

        Multipliers of states and dependents, which have no bounds, are zero.
        """
        n, m = self.instance.program.n_decision, self.instance.program.n_design_rows
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
        program = self.instance.program
        n, m = program.n_decision, program.n_design_rows
        gradient, g, J = self.derivatives
        adjoint = self.with_adjoint()
        lam = np.append(adjoint.lam_x[:n], adjoint.lam_g[:m])
        stationarity = (gradient + J.T @ adjoint.lam_g + adjoint.lam_x)[:n]
        lbx, ubx, lbg, ubg = self.instance.bounds
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
        instance = self.instance
        program = instance.program
        return Solution(
            instance.options,
            instance.arm.by_section(self.tensions),
            tuple(self.lam_x[: program.n_decision].tolist()),
            tuple(self.lam_g[: program.n_design_rows].tolist()),
            tuple(trials),
            base=instance.base_joints(self.x),
            iterations=self.iterations,
            optimum=None if self.defect is None else self,
            **more,
        )
