"""Newton's method on the active constraints: the last digits, and tensions that are exactly zero.

An interior-point method stops a little inside the bounds and on the mesh it was given. From there
the active set is known, and the optimality conditions are a square system: a few Newton steps give
the optimum of the fine mesh to rounding. The result is only taken if it is one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model.paths import Array
from planner.program.problem import TRACES, Problem
from planner.solve.ipopt import Solution

Bounds = tuple[Array, Array, Array, Array]
Mask = NDArray[np.bool_]
_STEPS = 15
_SLOW = 0.05
# So little changes where the limits that are held are not those of the optimum.
_STUCK = 1e-3
_ACCEPTED = 1e-10
_ROUNDING = 1e-12
_NEAR = 1e-4


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


def optimality(
    problem: Problem, x: Array, p: Array, lam_x: Array, lam_g: Array, bounds: Bounds
) -> Optimality:
    """Return the residuals of the first-order conditions; multipliers in CasADi's convention."""
    gradient, g, jacobian = _slopes(problem, x, p)
    return _residuals(gradient, g, jacobian, x, lam_x, lam_g, bounds)


def _slopes(problem: Problem, x: Array, p: Array) -> tuple[Array, Array, Array]:
    try:
        gradient, g, jacobian = (np.array(value) for value in problem.derivatives.slopes(x, p))
    except RuntimeError:  # a singular matrix, in CasADi's words
        n, m = x.size, problem.nlp["g"].numel()
        return np.full(n, np.nan), np.full(m, np.nan), np.full((m, n), np.nan)
    return gradient.ravel(), g.ravel(), jacobian


def _residuals(
    gradient: Array,
    g: Array,
    jacobian: Array,
    x: Array,
    lam_x: Array,
    lam_g: Array,
    bounds: Bounds,
) -> Optimality:
    lbx, ubx, lbg, ubg = bounds
    scale = 1e-2 + _most(gradient) + _most(lam_g)
    slope = gradient + jacobian.T @ lam_g + lam_x
    outside = [lbx - x, x - ubx, lbg - g, g - ubg]
    slack = [
        *(np.maximum(-lam_x, 0) * _room(x - lbx), np.maximum(lam_x, 0) * _room(ubx - x)),
        *(np.maximum(-lam_g, 0) * _room(g - lbg), np.maximum(lam_g, 0) * _room(ubg - g)),
    ]
    return Optimality(
        _most(slope) / scale,
        max(0.0, *(float(v.max(initial=0.0)) for v in outside)),
        max(_most(v) for v in slack) / scale,
    )


def _room(distance: Array) -> Array:
    return np.minimum(np.abs(distance), 1e3)


def _most(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def polish(problem: Problem, start: Solution, p: Array, bounds: Bounds) -> Solution:
    """Return the optimum near a solution, or the solution as it was if there is none like it."""
    best, least = start, _ACCEPTED
    lbx, ubx, lbg, ubg = bounds
    magnified = problem.magnified(TRACES[-1])
    low, high = _active(start.x, magnified * start.lam_x, lbx, ubx)
    fixed = low | high
    x = np.where(low, lbx, np.where(high, ubx, start.x))
    rows = np.logical_or(*_active(start.g, magnified * start.lam_g, lbg, ubg))
    level = np.where(start.lam_g < 0, lbg, ubg)
    level = np.where(lbg == ubg, lbg, level)
    lam_g = np.where(rows, start.lam_g, 0.0)
    hessian, previous = np.zeros(0), np.inf
    for _ in range(_STEPS):
        gradient, g, jacobian = _slopes(problem, x, p)
        lam_x = np.where(fixed, -(gradient + jacobian.T @ lam_g), 0.0)
        found = _residuals(gradient, g, jacobian, x, lam_x, lam_g, bounds).worst
        if found <= least:
            best, least = replace(start, x=x, lam_x=lam_x, lam_g=lam_g, g=g), found
        stuck = abs(found - previous) <= _STUCK * found
        if found <= _ROUNDING or stuck or not np.isfinite(found):
            break
        if found > _SLOW * previous or not hessian.size:
            hessian = np.array(problem.derivatives.curvature(x, p, 1.0, lam_g))
        previous = found
        step, lam_step = _newton(
            hessian[np.ix_(~fixed, ~fixed)],
            jacobian[np.ix_(rows, ~fixed)],
            (gradient + jacobian.T @ lam_g)[~fixed],
            (g - level)[rows],
        )
        x = x.copy()
        x[~fixed] += step
        lam_g = lam_g.copy()
        lam_g[rows] += lam_step
    return best


def _active(value: Array, lam: Array, lower: Array, upper: Array) -> tuple[Mask, Mask]:
    """Return which are held by their lower and by their upper bound."""
    equal = np.equal(lower, upper)
    low = np.logical_or(equal, (value - lower < _NEAR) & (-lam > value - lower))
    high = (upper - value < _NEAR) & (lam > upper - value) & ~low
    return low, high


def _newton(H: Array, J: Array, slope: Array, residual: Array) -> tuple[Array, Array]:
    """Return the Newton step of the equality-constrained problem, least squares if singular."""
    n, m = H.shape[0], J.shape[0]
    K = np.block([[H, J.T], [J, np.zeros((m, m))]])
    if not np.all(np.isfinite(K)):
        return np.full(n, np.nan), np.full(m, np.nan)
    step = np.linalg.lstsq(K, -np.concatenate([slope, residual]), rcond=1e-13)[0]
    return step[:n], step[n:]
