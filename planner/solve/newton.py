"""Newton's method on the active constraints: the last digits, and tensions that are exactly zero.

An interior-point method stops a little inside the bounds and on the mesh it was given. From there
the active set is known, and the optimality conditions are a square system: a few Newton steps give
the optimum of the fine mesh to rounding. The result is only taken if it is one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs

from model.errors import OctoplanError
from model.paths import Array
from model.time_limit import check_time
from planner.program.condensed import Condensed
from planner.program.explicit import Explicit
from planner.program.problem import TRACES, Bounds, Problem
from planner.program.reduced import Reduced
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
# The farthest from its bound that a multiplier counts with.
_ROOM = 1e3
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
    multipliers = np.concatenate([lam_x, lam_g])
    return _residuals(problem.condensed.first(x, p), x, multipliers, _Bounds.of(bounds))


@dataclass(frozen=True, eq=False)
class _Bounds:
    """The bounds of unknowns, then of constraints; `even` are those that leave no room."""

    low: Array
    high: Array
    even: Mask

    @classmethod
    def of(cls, bounds: Bounds) -> _Bounds:
        lbx, ubx, lbg, ubg = bounds
        low, high = np.concatenate([lbx, lbg]), np.concatenate([ubx, ubg])
        return cls(low, high, np.equal(low, high))


def _residuals(at: Reduced, x: Array, multipliers: Array, bounds: _Bounds) -> Optimality:
    n, values = x.size, np.concatenate([x, at.g])
    lam_g = multipliers[n:]
    scale = 1e-2 + _most(at.gradient) + _most(lam_g)
    slope = at.gradient + at.jacobian.T @ lam_g + multipliers[:n]
    above, below = values - bounds.low, bounds.high - values
    room = np.abs(np.where(multipliers < 0, above, below))
    return Optimality(
        _most(slope) / scale,
        max(0.0, -float(np.minimum(above, below).min(initial=0.0))),
        _most(multipliers * np.minimum(room, _ROOM)) / scale,
    )


def _most(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def newton(
    problem: Problem, start: Solution, p: Array, bounds: Bounds, lifted: bool = False
) -> Solution:
    """Return the optimum near a solution, or the solution as it was if there is none like it.

    Of a solution without the states; see Solution.free. The arm is settled at each step, unless the
    states are `lifted`: then they follow, linearised and corrected, from those that are known.
    """
    best, accepted, n = start, _ACCEPTED, start.x.size
    within, magnified = _Bounds.of(bounds), problem.magnified(TRACES[-1])
    values = np.concatenate([start.x, start.g])
    held = _active(values, np.concatenate([magnified * start.lam_x, start.lam_g]), within)
    values = np.where(held.low, within.low, np.where(held.high, within.high, values))
    x, lam_g = values[:n], np.where(held.fixed[n:], start.lam_g, 0.0)
    points = (_Lifted if lifted else _Settled)(problem.condensed, p)
    enough = _ACCEPTED if lifted else _ROUNDING
    at = points.first(x)
    hessian, previous, astray = np.zeros(0), np.inf, 0
    for _ in range(_STEPS):
        check_time()
        if at is None:
            break
        lam_x = np.where(held.fixed[:n], -(at.gradient + at.jacobian.T @ lam_g), 0.0)
        found = max(_residuals(at, x, np.concatenate([lam_x, lam_g]), within).worst, at.off)
        if found <= accepted:
            best, accepted = replace(start, x=x, lam_x=lam_x, lam_g=lam_g, g=at.g, f=at.f), found
            points.stay(at)
        stuck = abs(found - previous) <= _STUCK * found
        astray += found > previous
        if found <= enough or stuck or astray > _ASTRAY or not np.isfinite(found):
            break
        more = np.zeros(n)
        if found > _SLOW * previous or not hessian.size:
            hessian, more = points.second(at, lam_g)
        previous = found
        x, lam_g, held = _Quadratic(hessian, at, at.gradient + more, x, within).solve(held)
        at = points.after(at, x)
    return best


class _Settled:
    """The points of Newton's method where the arm is settled at each."""

    def __init__(self, condensed: Condensed | Explicit, p: Array) -> None:
        self.condensed, self.p = condensed, p

    def first(self, x: Array) -> Reduced | None:
        """Return values and first derivatives at the unknowns to begin with."""
        return self.condensed.first(x, self.p)

    def after(self, at: Reduced, x: Array) -> Reduced | None:
        """Return them at other unknowns."""
        return self.condensed.first(x, self.p)

    def second(self, at: Reduced, lam: Array) -> tuple[Array, Array]:
        """Return the Hessian of the Lagrangian, and the slope that states off add."""
        return self.condensed.curvature(at, self.p, 1.0, lam)

    def stay(self, at: Reduced) -> None:
        """Take a point for what was found last: it is."""


class _Lifted(_Settled):
    """The points where the states follow."""

    def first(self, x: Array) -> Reduced | None:
        """See _Settled."""
        try:
            return self.condensed.at(self.condensed.lifted(x, self.p), self.p)
        except OctoplanError:
            return None

    def after(self, at: Reduced, x: Array) -> Reduced | None:
        """See _Settled; None where the states do not follow."""
        moved = self.condensed.follow(at, x - at.x[: x.size], self.p)
        return None if moved is None else self.condensed.at(moved, self.p)

    def stay(self, at: Reduced) -> None:
        """Begin what is found next at these states."""
        self.condensed.stay(at, self.p)


@dataclass(frozen=True, eq=False)
class _Held:
    """Which unknowns, and then constraints, are at their lower and upper bounds."""

    low: Mask
    high: Mask

    @cached_property
    def fixed(self) -> Mask:
        """What is at a bound."""
        return np.asarray(self.low | self.high)

    def same(self, other: _Held) -> bool:
        """Return whether another is the same."""
        return bool((self.low == other.low).all() and (self.high == other.high).all())


class _Quadratic:
    """The problem to second order at x, solved by the primal-dual active set method.

    Bounds are held by their multipliers' signs and let go of by them, and taken up where a step
    passes them. Source: Hintermueller, Ito, Kunisch, "The primal-dual active set strategy as a
    semismooth Newton method", SIAM J. Optim. 13 (2002).
    """

    def __init__(
        self, hessian: Array, at: Reduced, gradient: Array, x: Array, bounds: _Bounds
    ) -> None:
        n = self.n = x.size
        self.slope, self.values = np.concatenate([gradient, at.g]), np.concatenate([x, at.g])
        size = self.values.size
        # Stationarity of the unknowns and what constraints come to, of steps and multipliers.
        self.matrix = np.zeros((size, size))
        self.matrix[:n, :n], self.matrix[n:, :n] = hessian, at.jacobian
        self.matrix[:n, n:], self.bounds = at.jacobian.T, bounds

    def solve(self, held: _Held) -> tuple[Array, Array, _Held]:
        """Return unknowns, multipliers of the constraints, and what is held there."""
        n, bounds = self.n, self.bounds
        for _ in range(_SETS):
            step = self._step(held)
            changed = self._changed(held, step)
            if changed.same(held):
                break
            held = changed
        x = np.minimum(np.maximum(self.values[:n] + step[:n], bounds.low[:n]), bounds.high[:n])
        return x, step[n:], held

    def _step(self, held: _Held) -> Array:
        """Return the step of the unknowns, and the multipliers of the constraints after it."""
        n, bounds, values, fixed = self.n, self.bounds, self.values, held.fixed
        missed = np.where(fixed, np.where(held.low, bounds.low, bounds.high) - values, 0.0)
        step = missed.copy()
        step[n:] = 0.0
        right = self.matrix[:, :n] @ step[:n]
        right[:n] += self.slope[:n]
        right[n:] -= missed[n:]
        solved = np.concatenate([~fixed[:n], fixed[n:]]).nonzero()[0]
        step[solved] = _newton(self.matrix[solved[:, None], solved], -right[solved])
        return step

    def _changed(self, held: _Held, step: Array) -> _Held:
        """Return what is held after a step, by the signs of multipliers and what bounds say."""
        n, bounds, fixed = self.n, self.bounds, held.fixed
        after = self.matrix @ step + self.slope
        values, multipliers = self.values + step, np.concatenate([-after[:n], step[n:]])
        values[n:] = after[n:]
        low = np.where(fixed, held.low & (multipliers <= 0), values < bounds.low - _ROUNDING)
        high = np.where(fixed, held.high & (multipliers >= 0), values > bounds.high + _ROUNDING)
        return _Held(low | bounds.even, high & ~bounds.even)


def _active(values: Array, multipliers: Array, bounds: _Bounds) -> _Held:
    """Return what is held by its lower and by its upper bound."""
    above, below = values - bounds.low, bounds.high - values
    low = bounds.even | ((above < _NEAR) & (-multipliers > above))
    return _Held(low, (below < _NEAR) & (multipliers > below) & ~low)


def _newton(matrix: Array, right: Array) -> Array:
    """Return the solution of the equality-constrained problem, least squares if singular."""
    if not right.size:
        return right  # LAPACK would print that there is nothing to solve
    if not np.isfinite(matrix.sum() + right.sum()):
        return np.full(right.size, np.nan)
    factors, pivots, _ = dgetrf(matrix)
    if dgecon(factors, float(np.abs(matrix).sum(axis=0).max()))[0] > _SINGULAR:
        return np.asarray(dgetrs(factors, pivots, right)[0])
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=_SINGULAR)[0])
