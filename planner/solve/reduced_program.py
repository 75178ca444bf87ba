"""Programs reduced to tensions and decisions: the equations of equilibrium are eliminated.

By the implicit function theorem, states and dependents S of blocks change with tensions and
decisions a by dS = Z da with Z = -r_S^-1 r_a, where r(a, S) = 0 are the equations (see
octoplan.planner.solution). The reduced gradient of a function is (I Z') times the gradient, and the
reduced Hessian of the Lagrangian H is (I Z') H (I; Z).

An elastic quadratic program gives a step; it always has a solution. Source: Fletcher, "Practical
Methods of Optimization", 2nd ed., 14.4.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import clarabel
import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU

from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.paths import Array
from octoplan.planner.program_instance import ProgramInstance, factorised

# Curvature along equalities, over the norm of the Hessian: rows determine these directions [-].
_CURVATURE_ALONG_ROWS = 10.0
# Smallest curvature, over the norm of the Hessian [-].
_LEAST_CURVATURE = 1e-8
# Relative singular value below which equalities do not determine a direction [-].
_RANK_TOL = 1e-6


class ReducedProgram:
    """The program of a problem at an equilibrium; derivatives along the equilibria when needed.

    Attributes
    ----------
    instance : ProgramInstance
    equilibrium : Equilibrium
        An equilibrium on the mesh of the problem.
    x, p : (n_x,), (n_p,)
        Unknowns and parameters of the program.
    f : float
        Objective.
    rows : (m,)
        Design rows.
    """

    def __init__(self, instance: ProgramInstance, equilibrium: Equilibrium, p: Array) -> None:
        program = instance.program
        self.instance = instance
        self.equilibrium = equilibrium
        self.x = instance.complete(equilibrium.tensions, equilibrium.states)
        self.p = instance.parameters_at(self.x, p)
        f, self._gradient, g, self._jacobian = program.evaluate(self.x, self.p)
        self.f = float(f[0])
        self.rows = g[: program.n_design_rows]

    @cached_property
    def _factors(self) -> SuperLU:
        """The factors of the derivatives of the equations by states and dependents."""
        m, n = self.rows.size, self.instance.program.n_decision
        return factorised(self._jacobian[m:].tocsc()[:, n + 1 :])

    @cached_property
    def _basis(self) -> Array:
        """The derivatives of all unknowns by tensions and decisions (n_x, n)."""
        m, n = self.rows.size, self.instance.program.n_decision
        by_decisions = -self._factors.solve(self._jacobian[m:, :n].toarray())
        return np.vstack([np.eye(n), np.zeros((1, n)), by_decisions])

    @cached_property
    def gradient(self) -> Array:
        """The derivatives of the objective by tensions and decisions (n,), scaled."""
        return np.asarray(self._gradient @ self._basis)

    @cached_property
    def jacobian(self) -> Array:
        """The derivatives of the design rows by tensions and decisions (m, n)."""
        return np.asarray(self._jacobian[: self.rows.size] @ self._basis)

    def along(self, d: Array) -> Array:
        """Return the derivative of the states (n_states,) along a step d (n,)."""
        states = self.instance.program.states
        return np.asarray(self._basis[states] @ d * self.instance.scale[states])

    @property
    def row_bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the design rows."""
        _, _, lower, upper = self.instance.bounds
        return lower[: self.rows.size], upper[: self.rows.size]

    def multipliers(self, lam: Array) -> Array:
        """Return the multipliers of all rows, given those of the design rows (m,)."""
        slope = self._gradient + self._jacobian[: lam.size].T @ lam
        return np.append(lam, self._factors.solve(-slope[-self._factors.shape[0] :], "T"))

    def curvature(self, lam: Array) -> Array:
        """Return the Hessian of the Lagrangian along the equilibria (n, n)."""
        H = self.instance.program.hessian(self.x, self.p, self.multipliers(lam))
        return np.asarray(self._basis.T @ (H @ self._basis))

    def hessian(self, lam: Array) -> Array:
        """Return a definite matrix (n, n) in place of the Hessian along the equilibria.

        Eigenvalues are replaced by their absolute values. Before, curvature is added along the
        equalities, because the rows determine the step there.
        """
        H = self.curvature(lam)
        lower, upper = self.row_bounds
        size = float(np.linalg.norm(H, 2))
        _, values, directions = np.linalg.svd(self.jacobian[lower == upper], full_matrices=False)
        along = directions[values > _RANK_TOL * values.max(initial=0.0)]
        values, modes = np.linalg.eigh(H + _CURVATURE_ALONG_ROWS * size * along.T @ along)
        values = np.maximum(np.abs(values), _LEAST_CURVATURE * size + np.finfo(float).tiny)
        return np.asarray((modes * values) @ modes.T)

    def violation(self, rows: Array) -> Array:
        """Return the violations (m,) of values of the design rows."""
        lower, upper = self.row_bounds
        return np.maximum(np.maximum(lower - rows, rows - upper), 0.0)

    def violation_after(self, d: Array) -> float:
        """Return the sum of the violations after a step d (n,), by linearised rows."""
        return float(self.violation(self.rows + self.jacobian @ d).sum())

    def box(self, width: float) -> tuple[Array, Array]:
        """Return the bounds (n,) of a step; tensions and base joints change by `width` at most."""
        lbx, ubx, _, _ = self.instance.bounds
        n = self.instance.program.n_decision
        low, high = lbx[:n] - self.x[:n], ubx[:n] - self.x[:n]
        controls = self.instance.controls
        low[controls] = np.maximum(low[controls], -width)
        high[controls] = np.minimum(high[controls], width)
        return np.minimum(low, 0.0), np.maximum(high, 0.0)


class Step(NamedTuple):
    """The solution of an elastic quadratic program.

    Attributes
    ----------
    change : (n,)
        Change of tensions and decisions.
    lam : (m,)
        Multipliers of the rows, negative at a lower bound.
    """

    change: Array
    lam: Array


def elastic_step(
    point: ReducedProgram, H: Array, rows: Array, penalty: float, width: float
) -> Step | None:
    """Return the step d that minimises a quadratic model within a box, or None.

    Minimise f' d + d H d / 2 + penalty sum s subject to lower - s <= rows + J d <= upper + s and
    s >= 0, where J is the Jacobian of the design rows along the equilibria. By clarabel (Goulart
    and Chen, arXiv:2405.12762, 2024). None if the solver fails.
    """
    low, high = point.box(width)
    free = high > low
    n, m = int(free.sum()), rows.size
    lower, upper = point.row_bounds
    above, below = np.isfinite(upper), np.isfinite(lower)
    J, slack = point.jacobian[:, free], np.eye(m)
    changes, slacks = np.eye(n, n + m), np.eye(m, n + m, n)
    bounded_above, bounded_below = np.isfinite(high[free]), np.isfinite(low[free])
    A = np.vstack(
        [
            np.hstack([J, -slack])[above],
            np.hstack([-J, -slack])[below],
            -slacks,
            changes[bounded_above],
            -changes[bounded_below],
        ]
    )
    b = np.concatenate(
        [
            (upper - rows)[above],
            (rows - lower)[below],
            np.zeros(m),
            high[free][bounded_above],
            -low[free][bounded_below],
        ]
    )
    quadratic = np.zeros((n + m, n + m))
    quadratic[:n, :n] = np.triu(H[np.ix_(free, free)])
    cost = np.append(point.gradient[free], np.full(m, penalty))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones = [clarabel.NonnegativeConeT(b.size)]
    args = csc_array(quadratic), cost, csc_array(A), b, cones, settings
    solution = clarabel.DefaultSolver(*args).solve()
    if str(solution.status) not in ("Solved", "AlmostSolved"):
        return None
    change = np.zeros(low.size)
    change[free] = np.array(solution.x)[:n]
    forces = np.array(solution.z)
    lam = np.zeros(m)
    lam[above] = forces[: above.sum()]
    lam[below] -= forces[above.sum() : above.sum() + below.sum()]
    return Step(np.clip(change, low, high), lam)
