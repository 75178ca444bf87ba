"""Whether a point is an optimum: multipliers of the equilibrium, residuals of optimality.

With unknowns (a, S), a before the states, equations of equilibrium c(a, S) = 0 with a square and
regular Jacobian c_S, and the multipliers lam of all other constraints g, those of c follow:

    c_S^T mu = -(f_S + g_S^T lam)            then the Lagrangian's gradient in S is 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.paths import Array
from planner.program.problem import Bounds, Problem
from planner.program.program import Evaluated, factorised

# The farthest from its bound that a multiplier counts with.
_ROOM = 1e3
# Under what stationarity is measured against: multipliers of 0 leave no scale.
_LEAST_SCALE = 1e-2


@dataclass(frozen=True)
class Optimality:
    """How far a point is from the first-order conditions, in scaled quantities.

    Attributes
    ----------
    stationarity : largest component of the Lagrangian's gradient
    feasibility : largest violation of a constraint or a bound
    complementarity : largest product of a multiplier and the distance to its bound
    """

    stationarity: float
    feasibility: float
    complementarity: float

    @property
    def worst(self) -> float:
        """The largest of the three, NaN counting as infinite."""
        worst = max(self.stationarity, self.feasibility, self.complementarity)
        return worst if np.isfinite(worst) else np.inf


def multipliers(problem: Problem, here: Evaluated, lam_g: Array) -> tuple[Array, Array]:
    """Return the multipliers of all constraints at a point, and the Lagrangian's gradient in a.

    `lam_g` are those of the constraints besides equilibrium. The gradient (n_free,) is without the
    multipliers of bounds, which are its negative where a bound is met.
    """
    n, m = problem.n_free, problem.n_outer
    slope, inner = here.gradient + here.jacobian[:m].T @ lam_g, here.jacobian[m:].tocsc()
    mu = factorised(inner[:, n + 1 :]).solve(-slope[n + 1 :], "T")
    return np.concatenate([lam_g, mu]), slope[:n] + inner[:, :n].T @ mu


def optimality(
    problem: Problem, x: Array, p: Array, lam_x: Array, lam_g: Array, bounds: Bounds
) -> Optimality:
    """Return the residuals of the first-order conditions at x, which is in equilibrium.

    Multipliers in CasADi's convention, and bounds, are those without states and equilibrium.
    """
    n = problem.n_free
    lbx, ubx, lbg, ubg = bounds
    here = problem.program.evaluate(x, p)
    _, slope = multipliers(problem, here, lam_g)
    values, lam = np.concatenate([x[:n], here.g[: lam_g.size]]), np.concatenate([lam_x, lam_g])
    scale = _LEAST_SCALE + _most(here.gradient[:n]) + _most(lam_g)
    above, below = values - np.concatenate([lbx, lbg]), np.concatenate([ubx, ubg]) - values
    room = np.abs(np.where(lam < 0, above, below))
    return Optimality(
        _most(slope + lam_x) / scale,
        max(0.0, -float(np.minimum(above, below).min(initial=0.0))),
        _most(lam * np.minimum(room, _ROOM)) / scale,
    )


def _most(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))
