"""Whether a point is an optimum: multipliers, residuals of the first-order conditions.

With unknowns (a, S), a before the states, equations of equilibrium c(a, S) = 0 with a square and
regular Jacobian c_S, a function r of both has, along the equilibrium, the derivative

    dr/da = r_a + mu^T c_a,    c_S^T mu = -r_S.

So the states are eliminated of the objective and of all other constraints; and with multipliers lam
of the latter those of the equations are mu of the Lagrangian.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear

from model.paths import Array
from planner.program.problem import Bounds, Problem
from planner.program.program import factorised

# The farthest from its bound that a multiplier counts with.
_ROOM = 1e3
# Under what stationarity is measured against: multipliers of 0 leave no scale.
_LEAST_SCALE = 1e-2
# Constraints and bounds that are as near are active, in scaled units.
_ACTIVE = 1e-7


class Point:
    """Unknowns x in equilibrium, and the first-order conditions there.

    Multipliers lam_x (n_free,) of the unknowns before the states and lam_g (n_outer,) of the
    constraints besides equilibrium are of CasADi's signs: below 0 at a lower bound. Bounds are the
    problem's, unless others are given.
    """

    def __init__(self, problem: Problem, x: Array, p: Array, bounds: Bounds | None = None) -> None:
        self.x = x
        self._n, self._m = problem.n_free, problem.n_outer
        self._evaluated = problem.program.evaluate(x, p)
        inner = self._evaluated.jacobian[self._m :].tocsc()
        self._factors = factorised(inner[:, self._n + 1 :])
        values = np.append(x[: self._n], self._evaluated.g[: self._m])
        lbx, ubx, lbg, ubg = bounds or problem.bounds
        # How far unknowns before the states and constraints are above and below their bounds.
        self._above = values - np.append(lbx[: self._n], lbg[: self._m])
        self._below = np.append(ubx[: self._n], ubg[: self._m]) - values
        # Derivatives by a, along the equilibrium, of the objective and of each constraint.
        rows = np.vstack([self._evaluated.gradient, self._evaluated.jacobian[: self._m].toarray()])
        mu = self._factors.solve(np.ascontiguousarray(-rows[:, self._n + 1 :].T), "T")
        self._reduced = rows[:, : self._n] + (inner[:, : self._n].T @ mu).T

    def extended(self, lam_x: Array, lam_g: Array) -> tuple[Array, Array]:
        """Return the multipliers of all unknowns and constraints from those besides equilibrium."""
        slope = self._evaluated.gradient + self._evaluated.jacobian[: self._m].T @ lam_g
        of_states = self._factors.solve(-slope[self._n + 1 :], "T")
        return np.append(lam_x, np.zeros(self.x.size - self._n)), np.append(lam_g, of_states)

    def slope(self, lam_g: Array) -> Array:
        """Return the Lagrangian's gradient in a (n_free,), without the multipliers of bounds."""
        return np.asarray(self._reduced[0] + lam_g @ self._reduced[1:])

    def multipliers(self) -> tuple[Array, Array, Array]:
        """Return lam_x and lam_g that leave least of the Lagrangian's gradient, and the rest.

        Where constraints depend on each other there are many such; 0 of what is not active.
        """
        low, high = self._above <= _ACTIVE, self._below <= _ACTIVE
        active, lam = np.flatnonzero(low | high), np.zeros(low.size)
        rows = np.vstack([np.eye(self._n), self._reduced[1:]])[active]
        ends = np.where(low[active], -np.inf, 0.0), np.where(high[active], np.inf, 0.0)
        if active.size:
            lam[active] = lsq_linear(rows.T, -self._reduced[0], ends, "bvls").x
        return lam[: self._n], lam[self._n :], self._reduced[0] + rows.T @ lam[active]

    def residual(self, lam_x: Array, lam_g: Array) -> float:
        """Return how far the point is from the first-order conditions, scaled.

        The largest of: a component of the Lagrangian's gradient; a violation of a constraint or a
        bound; the product of a multiplier and the distance to its bound. NaN counts as infinite.
        """
        above, below = self._above, self._below
        lam, rest = np.append(lam_x, lam_g), self.slope(lam_g) + lam_x
        scale = _LEAST_SCALE + _most(self._evaluated.gradient[: self._n]) + _most(lam_g)
        room = np.minimum(np.abs(np.where(lam < 0, above, below)), _ROOM)
        violation = np.maximum(-np.minimum(above, below), 0.0)
        worst = _most(np.concatenate([rest / scale, violation, lam * room / scale]))
        return worst if np.isfinite(worst) else np.inf


def _most(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))
