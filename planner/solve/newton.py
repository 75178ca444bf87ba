"""Newton's method on the active constraints: the last digits, and tensions that are exactly zero.

An interior-point method stops a little inside the bounds and on the mesh it was given. From there
the active set is known, and the optimality conditions are a square system: a few Newton steps give
the optimum of the fine mesh to rounding. The result is only taken if it is one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs

from model.paths import Array
from model.time_limit import check_time
from planner.program.problem import TRACES, Bounds, Problem
from planner.solve.ipopt import Solution

Mask = NDArray[np.bool_]
_STEPS, _SETS = 15, 20
# The Hessian is computed anew where residuals shrink by less.
_SLOW = 2e-3
# Steps that lead away, before it is given up.
_ASTRAY = 1
# So little changes where the limits that are held are not those of the optimum.
_STUCK = 1e-3
_ACCEPTED = 1e-10
_ROUNDING = 1e-12
_NEAR = 1e-4
# Matrices of a lower reciprocal condition are singular.
_SINGULAR = 1e-13


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
    """Return the residuals of the first-order conditions; multipliers in CasADi's convention.

    Unknowns, multipliers and bounds are those without the states.
    """
    at = problem.condensed.first(x, p)
    return _residuals(at.gradient, at.g, at.jacobian, x, lam_x, lam_g, bounds)


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


def newton(problem: Problem, start: Solution, p: Array, bounds: Bounds) -> Solution:
    """Return the optimum near a solution, or the solution as it was if there is none like it.

    Of a solution without the states; see Solution.free.
    """
    best, accepted = start, _ACCEPTED
    lbx, ubx, lbg, ubg = bounds
    magnified = problem.magnified(TRACES[-1])
    held = _Held(
        *_active(start.x, magnified * start.lam_x, lbx, ubx),
        *_active(start.g, magnified * start.lam_g, lbg, ubg),
    )
    x = np.where(held.low, lbx, np.where(held.high, ubx, start.x))
    lam_g = np.where(held.rows, start.lam_g, 0.0)
    hessian, previous, astray = np.zeros(0), np.inf, 0
    for _ in range(_STEPS):
        check_time()
        at = problem.condensed.first(x, p)
        gradient, g, jacobian = at.gradient, at.g, at.jacobian
        lam_x = np.where(held.fixed, -(gradient + jacobian.T @ lam_g), 0.0)
        found = _residuals(gradient, g, jacobian, x, lam_x, lam_g, bounds).worst
        if found <= accepted:
            best, accepted = replace(start, x=x, lam_x=lam_x, lam_g=lam_g, g=g), found
        stuck = abs(found - previous) <= _STUCK * found
        astray += found > previous
        if found <= _ROUNDING or stuck or astray > _ASTRAY or not np.isfinite(found):
            break
        if found > _SLOW * previous or not hessian.size:
            hessian = problem.condensed.second(x, p, 1.0, lam_g)
        previous = found
        quadratic = _Quadratic(hessian, gradient, jacobian, g, x, bounds)
        x, lam_g, held = quadratic.solve(held)
    return best


@dataclass(frozen=True, eq=False)
class _Held:
    """Which unknowns are at their lower and upper bounds, and which constraints."""

    low: Mask
    high: Mask
    row_low: Mask
    row_high: Mask

    @property
    def fixed(self) -> Mask:
        """Unknowns at a bound."""
        return np.logical_or(self.low, self.high)

    @property
    def rows(self) -> Mask:
        """Constraints at a bound."""
        return np.logical_or(self.row_low, self.row_high)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _Held):
            return NotImplemented
        ours, theirs = (np.concatenate(list(vars(h).values())) for h in (self, other))
        return bool(np.array_equal(ours, theirs))


@dataclass(frozen=True, eq=False)
class _Quadratic:
    """The problem to second order at x, solved by the primal-dual active set method.

    Bounds are held by their multipliers' signs and let go of by them, and taken up where a step
    passes them. Source: Hintermueller, Ito, Kunisch, "The primal-dual active set strategy as a
    semismooth Newton method", SIAM J. Optim. 13 (2002).
    """

    hessian: Array
    gradient: Array
    jacobian: Array
    g: Array
    x: Array
    bounds: Bounds

    def solve(self, held: _Held) -> tuple[Array, Array, _Held]:
        """Return unknowns, multipliers of the constraints, and what is held there."""
        for _ in range(_SETS):
            step, lam = self._step(held)
            changed = self._changed(held, step, lam)
            if changed == held:
                break
            held = changed
        lbx, ubx, _, _ = self.bounds
        return np.clip(self.x + step, lbx, ubx), lam, held

    def _step(self, held: _Held) -> tuple[Array, Array]:
        lbx, ubx, lbg, ubg = self.bounds
        fixed, rows, free = held.fixed, held.rows, ~held.fixed
        step = np.where(held.low, lbx - self.x, np.where(held.high, ubx - self.x, 0.0))
        step = np.where(fixed, step, 0.0)
        level = np.where(held.row_low, lbg, ubg)[rows]
        slope = (self.gradient + self.hessian @ step)[free]
        missing = (self.g + self.jacobian @ step)[rows] - level
        J = self.jacobian[np.ix_(rows, free)]
        step[free], own = _newton(self.hessian[np.ix_(free, free)], J, slope, missing)
        lam = np.zeros(self.g.size)
        lam[rows] = own
        return step, lam

    def _changed(self, held: _Held, step: Array, lam: Array) -> _Held:
        lbx, ubx, lbg, ubg = self.bounds
        lam_x = -(self.gradient + self.hessian @ step + self.jacobian.T @ lam)
        x, g = self.x + step, self.g + self.jacobian @ step
        even, rows_even = np.equal(lbx, ubx), np.equal(lbg, ubg)
        low = np.where(held.fixed, held.low & (lam_x <= 0), x < lbx - _ROUNDING)
        high = np.where(held.fixed, held.high & (lam_x >= 0), x > ubx + _ROUNDING)
        row_low = np.where(held.rows, held.row_low & (lam <= 0), g < lbg - _ROUNDING)
        row_high = np.where(held.rows, held.row_high & (lam >= 0), g > ubg + _ROUNDING)
        return _Held(
            np.logical_or(even, low),
            np.logical_and(~even, high),
            np.logical_or(rows_even, row_low),
            np.logical_and(~rows_even, row_high),
        )


def _active(value: Array, lam: Array, lower: Array, upper: Array) -> tuple[Mask, Mask]:
    """Return which are held by their lower and by their upper bound."""
    equal = np.equal(lower, upper)
    low = np.logical_or(equal, (value - lower < _NEAR) & (-lam > value - lower))
    high = (upper - value < _NEAR) & (lam > upper - value) & ~low
    return low, high


def _newton(H: Array, J: Array, slope: Array, residual: Array) -> tuple[Array, Array]:
    """Return the Newton step of the equality-constrained problem, least squares if singular."""
    n, m = H.shape[0], J.shape[0]
    if not n + m:
        return np.zeros(0), np.zeros(0)  # LAPACK would print that there is nothing to solve
    K, right = np.zeros((n + m, n + m)), -np.concatenate([slope, residual])
    K[:n, :n], K[n:, :n], K[:n, n:] = H, J, J.T
    if not np.all(np.isfinite(K)):
        return np.full(n, np.nan), np.full(m, np.nan)
    factors, pivots, _ = dgetrf(K)
    if dgecon(factors, float(np.abs(K).sum(axis=0).max()))[0] > _SINGULAR:
        step = dgetrs(factors, pivots, right)[0]
    else:
        step = np.linalg.lstsq(K, right, rcond=_SINGULAR)[0]
    return step[:n], step[n:]
