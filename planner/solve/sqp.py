"""Sequential quadratic programming for explicit programs: where tensions are the only unknowns.

Of a dozen unknowns a quadratic program is solved in less time than ipopt takes for an iteration,
and exact Hessians take 4 to 8 of them. What equality constraints lack is softened within a step,

    minimise  d . H d / 2 + gradient . d + |J d + c + SOFT lam|^2 / (2 SOFT),

the method of multipliers: a step is there even where constraints contradict each other, and the
soft term goes as the multipliers settle. Source: Nocedal, Wright, Numerical Optimization, 2nd ed.,
2006, chapters 17 and 18. The quadratic programs are DAQP's. Where it does not converge soon there
is no answer, and ipopt is asked.
"""

from __future__ import annotations

import logging
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from model.machine.buffered import Buffered
from model.paths import Array
from model.time_limit import check_time
from planner.program.condensed import First
from planner.program.explicit import Explicit
from planner.program.problem import Bounds, Problem
from planner.solve.ipopt import Solution

LOG = logging.getLogger(__name__)
Mask = NDArray[np.bool_]
_STEPS, _MET = 12, 1e-7
_SOFT = 1e-6
# How much of what constraints lack one step is to make up for, how far it goes in an unknown, and
# from what length on it is taken only where it helps, halved so often at most.
_CLOSED, _LONGEST, _LOCAL, _HALVED = 0.15, 1.0, 0.02, 9
# Multipliers that grow beyond tell that the constraints contradict each other near this start.
_LOST = 1e4
# An unknown so near to its bound is at it.
_AT = 1e-9


def solve_explicit(problem: Problem, x: Array, p: Array, bounds: Bounds) -> Solution | None:
    """Return the optimum of an explicit program near x, None where it does not converge soon."""
    if not isinstance(problem.program, Explicit) or problem.statement.mode != "exact":
        return None
    found = _Sqp(problem.program, p, bounds).run(x)
    if found is None:
        LOG.debug("not met in %d steps", _STEPS)
    else:
        LOG.debug("met after %d steps, objective %.6g", found.iterations, found.f)
    return found


class _Sqp:
    """One program with its numbers; constraints are equalities, or inequalities of one side."""

    def __init__(self, program: Explicit, p: Array, bounds: Bounds) -> None:
        self.program, self.p, self.bounds = program, p, bounds
        lbx, ubx, lbg, ubg = bounds
        self.equal, self.fixed = np.equal(lbg, ubg), np.equal(lbx, ubx)
        self.quadratic = _quadratic(lbx.size, int(np.sum(~self.equal)))

    def run(self, x: Array) -> Solution | None:
        """Return the optimum near x."""
        lam, here = np.zeros(self.equal.size), self._at(np.clip(x, *self.bounds[:2]))
        for count in range(1, _STEPS + 1):
            check_time()
            step = self._step(*here, lam)
            if step is None:
                return None
            change, after = step
            x, share = self._line(*here, change, 2 * float(np.abs(after).max(initial=0.0)) + 1e-3)
            here, lam = self._at(x), lam + share * (after - lam)
            if not np.isfinite(here[1].f) or np.abs(lam).max(initial=0.0) > _LOST:
                return None
            if self._residual(*here, lam) <= _MET:
                x, first = here
                slope = first.gradient + first.jacobian.T @ lam
                lam_x = np.where(self._held(x, first, lam), -slope, 0.0)
                return Solution(x, lam_x, lam, first.f, first.g, True, "", count)
        return None

    def _at(self, x: Array) -> tuple[Array, First]:
        return x, self.program.first(x, self.p)

    def _step(self, x: Array, first: First, lam: Array) -> tuple[Array, Array] | None:
        """Return the step of the quadratic program, and the multipliers after it."""
        lbx, ubx, lbg, ubg = self.bounds
        equal, g, J = self.equal, first.g, first.jacobian
        lack = (g - lbg)[equal]
        lack *= min(1.0, _CLOSED / max(float(np.linalg.norm(lack)), 1e-300))
        softened = self.program.second(x, self.p, 1.0, lam) + J[equal].T @ J[equal] / _SOFT
        H = self._convex(softened, self._held(x, first, lam))
        if H is None:
            return None
        slope = first.gradient + J[equal].T @ (lam[equal] + lack / _SOFT)
        low, high = np.maximum(lbx - x, -_LONGEST), np.minimum(ubx - x, _LONGEST)
        rows = (lbg - g)[~equal], (ubg - g)[~equal]
        solved = self.quadratic(H.ravel(), slope, J[~equal].ravel("F"), *rows, low, high)
        change, _, own, _ = (value.ravel() for value in solved)
        after = np.zeros(g.size)
        after[equal], after[~equal] = lam[equal] + (J[equal] @ change + lack) / _SOFT, own
        found = bool(np.all(np.isfinite(change)) and np.all(np.isfinite(after)))
        return (change, after) if found else None

    def _held(self, x: Array, first: First, lam: Array) -> Mask:
        """Return which unknowns are held by their bounds."""
        lbx, ubx, _, _ = self.bounds
        slope = first.gradient + first.jacobian.T @ lam
        low, high = (x <= lbx + _AT) & (slope > 0), (x >= ubx - _AT) & (slope < 0)
        return np.asarray(low | high | self.fixed)

    @staticmethod
    def _convex(H: Array, held: Mask) -> Array | None:
        """Return a Hessian made convex: among what is not held by as little as that takes.

        None where it is not finite.
        """
        if not np.all(np.isfinite(H)):
            return None
        most, free, more = float(np.abs(np.diag(H)).max()) * _SOFT, ~held, np.zeros(held.size)
        if _is_convex(H):
            return H
        inner, shift = H[np.ix_(free, free)], 0.0
        while not _is_convex(inner + shift * np.eye(len(inner))):
            shift = max(1e-2 * most, 4 * shift)
        more[free], extra = shift, max(shift, most)
        more[held] = extra
        while not _is_convex(H + np.diag(more)):
            more[held] = extra = 4 * extra
        return np.asarray(H + np.diag(more))

    def _line(self, x: Array, first: First, change: Array, weight: float) -> tuple[Array, float]:
        """Return unknowns along a step, and how much of it was gone: as much as helps."""
        before, most = self._merit(first.f, first.g, weight), float(np.abs(change).max())
        share = 1.0
        for _ in range(_HALVED):
            trial = np.clip(x + share * change, *self.bounds[:2])
            after = self._merit(*self.program.value(trial, self.p), weight)
            if np.isfinite(after) and (after < before or share * most < _LOCAL):
                break
            share /= 2
        return trial, share

    def _merit(self, f: float, g: Array, weight: float) -> float:
        return f + weight * float(self._violations(g).sum())

    def _violations(self, g: Array) -> Array:
        _, _, lbg, ubg = self.bounds
        return np.maximum(0.0, np.maximum(lbg - g, g - ubg))

    def _residual(self, x: Array, first: First, lam: Array) -> float:
        """Return the residual of the first-order conditions, scaled as planner.solve.newton's."""
        _, _, lbg, ubg = self.bounds
        slope = first.gradient + first.jacobian.T @ lam
        slope[self._held(x, first, lam)] = 0.0
        room = np.minimum(np.abs(np.where(lam > 0, ubg, lbg) - first.g), 1e3)
        idle = np.abs(lam[~self.equal]) * room[~self.equal]
        scale = 1e-2 + np.abs(first.gradient).max() + np.abs(lam).max(initial=0.0)
        violated = float(self._violations(first.g).max(initial=0.0))
        return max(violated, float(max(np.abs(slope).max(), idle.max(initial=0.0)) / scale))


def _is_convex(H: Array) -> bool:
    try:
        np.linalg.cholesky(H)
    except np.linalg.LinAlgError:
        return False
    return True


@lru_cache(maxsize=64)
def _quadratic(n: int, m: int) -> _Quadratic:
    return _Quadratic(n, m)


class _Quadratic:
    """DAQP for n unknowns with bounds and m constraints with bounds."""

    def __init__(self, n: int, m: int) -> None:
        shapes = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}
        self._call = Buffered(ca.conic("quadratic", "daqp", shapes, {"error_on_fail": False}))
        self._rest = [np.zeros(k) for k in (n, n, m, 0, 0)]

    def __call__(
        self, H: Array, slope: Array, A: Array, lba: Array, uba: Array, lbx: Array, ubx: Array
    ) -> list[Array]:
        """Return the solution, its objective, multipliers of constraints and of bounds."""
        return self._call(H, slope, A, lba, uba, lbx, ubx, *self._rest)
