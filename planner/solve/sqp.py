"""Sequential quadratic programming in the tensions: states follow, linearised and corrected.

Of a dozen unknowns a quadratic program is solved in less time than ipopt takes for an iteration,
and exact Hessians take 4 to 8 of them. What equality constraints lack is softened within a step,

    minimise  d . H d / 2 + gradient . d + |J d + c + SOFT lam|^2 / (2 SOFT),

the method of multipliers: a step is there even where constraints contradict each other, and the
soft term goes as the multipliers settle. Source: Nocedal, Wright, Numerical Optimization, 2nd ed.,
2006, chapters 17 and 18. The quadratic programs are DAQP's. How states are eliminated is told in
planner.program.reduced.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf

from model.paths import Array
from model.time_limit import check_time
from planner.program.condensed import Condensed
from planner.program.condensed_in_c import CondensedInC
from planner.program.explicit import Explicit
from planner.program.explicit_in_c import ExplicitInC
from planner.program.problem import Bounds, Problem
from planner.program.reduced import Reduced
from planner.solve.ipopt import Solution
from planner.solve.quadratic import quadratic
from planner.solve.sqp_in_c import run

LOG = logging.getLogger(__name__)
Mask = NDArray[np.bool_]
_STEPS, _STEPS_IF_CLOSEST, _MET = 40, 60, 1e-7
_SOFT = 1e-6
# Hessians of Lagrangians that are not convex are shifted by so much of themselves at least: of
# what softened constraints add a part is so large that it leaves hardly a step. No shift is less
# than rounding.
_SHIFTED, _ROUNDING = 1e-3, 1e-16
# What it is from some steps on: where constraints are nearly dependent their multipliers are large,
# and grow by little at a time as long as much is soft.
_LATE, _SOFT_LATE = 8, 1e-8
# How much of what constraints lack one step is to make up for, how far it goes in an unknown, and
# from what length on it is taken only where it helps, halved so often at most.
_CLOSED, _LONGEST, _LOCAL, _HALVED = 0.15, 1.0, 0.02, 9
# Multipliers that grow beyond tell that the constraints contradict each other near this start.
_LOST = 1e4
_REASON = "quadratic programs did not lead to an optimum in a few steps"
# An unknown so near to its bound is at it.
_AT = 1e-9
# Steps that come so near to a known optimum, over its norm, with so little left of the first-order
# conditions, lead there.
_JOINED, _NEAR = 0.01, 0.01
# Late steps creep whose residuals stay within this factor for so many.
_CREEPS, _ALIKE = 6, 1.3
# The same by name, for the steps in C.
_RULES = {
    "met": _MET,
    "soft": _SOFT,
    "soft_late": _SOFT_LATE,
    "shifted": _SHIFTED,
    "rounding": _ROUNDING,
    "closed": _CLOSED,
    "longest": _LONGEST,
    "local": _LOCAL,
    "lost": _LOST,
    "at": _AT,
    "joined": _JOINED,
    "near": _NEAR,
    "alike": _ALIKE,
    "late": _LATE,
    "creeps": _CREEPS,
    "halved": _HALVED,
}


def solve_quadratic(
    problem: Problem,
    x: Array,
    p: Array,
    bounds: Bounds,
    lam: Array | None = None,
    known: Sequence[Solution] = (),
) -> Solution | None:
    """Return where a few steps from unknowns x lead, an optimum if it is `met`.

    None where that is nowhere, or the program is one of least squares, which take ipopt's care; but
    not where a stiffness comes as near as the limits allow. `bounds` are those without the states,
    `lam` the multipliers to begin with, `known` optima of the same program: what comes near to one
    of them is taken for it.
    """
    mode = problem.statement.mode
    if mode == "nearest" or (mode == "closest" and not problem.requests):
        return None
    steps = _STEPS if mode == "exact" else _STEPS_IF_CLOSEST
    program = problem.condensed
    lam = np.zeros(bounds[2].size) if lam is None else lam
    if program.in_c is None:
        found = _Sqp(program, p, bounds, steps, known).run(x, lam)
    else:
        found = _by_c(program.in_c, p, bounds, known, steps, x, lam)
    if found is not None:
        told = "met" if found.met else "not met"
        LOG.debug("%s after %d steps, objective %.6g", told, found.iterations, found.f)
    return found


def _by_c(
    program: ExplicitInC | CondensedInC,
    p: Array,
    bounds: Bounds,
    known: Sequence[Solution],
    most: int,
    x: Array,
    lam: Array,
) -> Solution | None:
    check_time()
    n = bounds[0].size
    x = np.concatenate([np.clip(x[:n], *bounds[:2]), x[n:]])
    done = run(program, p, bounds, known, {**_RULES, "most": most}, x, lam)
    if done is None:
        return None
    found, which = done
    if which >= 0:
        return replace(known[which], iterations=found.iterations)
    return found if found.met else replace(found, reason=_REASON)


class _Sqp:
    """One program with its numbers; constraints are equalities, or inequalities of one side."""

    def __init__(
        self,
        program: Condensed | Explicit,
        p: Array,
        bounds: Bounds,
        most: int = _STEPS,
        known: Sequence[Solution] = (),
    ) -> None:
        self.program, self.p, self.bounds, self.most = program, p, bounds, most
        self.known, self.residuals = known, list[float]()
        lbx, ubx, lbg, ubg = bounds
        self.equal, self.fixed = np.equal(lbg, ubg), np.equal(lbx, ubx)
        self.uneven = ~self.equal
        self.quadratic = quadratic(lbx.size, int(np.sum(self.uneven)))

    def run(self, x: Array, lam: Array) -> Solution | None:
        """Return where the steps from unknowns x lead; None where that is nowhere."""
        n = self.fixed.size
        x = np.concatenate([np.clip(x[:n], *self.bounds[:2]), x[n:]])
        here, steps, last = self.program.at(x, self.p), 0, None
        while here is not None and np.isfinite(here.f) and _most(lam) <= _LOST:
            slope = here.gradient + _sum(here.jacobian * lam[:, None])
            last = point = _Point(here, lam, slope, steps)
            point.held = self._held(point)
            self.residuals.append(self._residual(point))
            point.met = self.residuals[-1] <= _MET
            joined = self._joined(here.x[:n])
            if joined is not None:
                return replace(joined, iterations=steps)
            done = point.met or steps == self.most or self._creeps
            step = None if done else self._step(point)
            if step is None:
                break
            check_time()
            change, after = step
            x, share = self._line(here, change, 2 * _most(after) + 1e-3)
            if x is here.x:
                break
            here, lam, steps = self.program.at(x, self.p), lam + share * (after - lam), steps + 1
        return None if last is None else last.solution()

    def _joined(self, a: Array) -> Solution | None:
        """Return the known optimum that unknowns are about to come to, if there is one."""
        if self.residuals[-1] > _NEAR:
            return None
        for one in self.known:
            there = one.x[: a.size]
            if np.linalg.norm(a - there) <= _JOINED * np.linalg.norm(there):
                return one
        return None

    @property
    def _creeps(self) -> bool:
        last = self.residuals[_LATE:][-_CREEPS:]
        return len(last) == _CREEPS and max(last) <= _ALIKE * min(last)

    def _step(self, at: _Point) -> tuple[Array, Array] | None:
        """Return the step of the quadratic program, and the multipliers after it."""
        lbx, ubx, lbg, ubg = self.bounds
        here, lam, equal, uneven = at.here, at.lam, self.equal, self.uneven
        g, a = here.g, here.x[: self.fixed.size]
        J, rest = here.jacobian[equal], here.jacobian[uneven]
        lack = (g - lbg)[equal]
        lack *= min(1.0, _CLOSED / max(float(np.sqrt(_sum(lack * lack))), 1e-300))
        soft = _SOFT if at.steps < _LATE else _SOFT_LATE
        H, more = self.program.curvature(here, self.p, 1.0, lam)
        least = _SHIFTED * float(np.abs(np.diag(H)).max())
        convex = self._convex(H + _sum(J[:, :, None] * J[:, None, :]) / soft, at.held, least)
        if convex is None:
            return None
        slope = here.gradient + more + _sum(J * (lam[equal] + lack / soft)[:, None])
        low, high = np.maximum(lbx - a, -_LONGEST), np.minimum(ubx - a, _LONGEST)
        rows = (lbg - g)[uneven], (ubg - g)[uneven]
        solved = self.quadratic(convex.ravel(), slope, rest.ravel("F"), *rows, low, high)
        change, _, own, _ = (value.ravel() for value in solved)
        moved = lam[equal] + (_sum((J * change).T) + lack) / soft
        after = np.zeros(g.size)
        after[equal], after[uneven] = moved, own
        return (change, after) if np.isfinite(change.sum() + after.sum()) else None

    def _held(self, at: _Point) -> Mask:
        """Return which unknowns are held by their bounds."""
        lbx, ubx, _, _ = self.bounds
        slope, a = at.slope, at.here.x[: self.fixed.size]
        low, high = (a <= lbx + _AT) & (slope > 0), (a >= ubx - _AT) & (slope < 0)
        return np.asarray(low | high | self.fixed)

    @staticmethod
    def _convex(H: Array, held: Mask, least: float) -> Array | None:
        """Return a Hessian made convex: among what is not held by as little as that takes.

        From the shift `least` on. None where it is not finite.
        """
        if not np.isfinite(H.sum()):
            return None
        if _is_convex(H):
            return H
        largest, free, more = float(np.abs(H).max()), ~held, np.zeros(held.size)
        most = float(np.abs(np.diag(H)).max()) * _SOFT
        least = max(least, _ROUNDING * largest)
        inner, shift = H[np.ix_(free, free)], 0.0
        while not _is_convex(inner + shift * np.eye(len(inner))):
            shift = max(least, 4 * shift)
        more[free], extra = shift, max(shift, most)
        more[held] = extra
        while not _is_convex(H + np.diag(more)):
            more[held] = extra = 4 * extra
            if extra > largest:  # what is not held is convex by no more than rounding
                more[free] = shift = max(least, 4 * shift)
        return np.asarray(H + np.diag(more))

    def _line(self, here: Reduced, change: Array, weight: float) -> tuple[Array, float]:
        """Return unknowns along a step, and how much of it was gone: as much as helps.

        Those given where the states follow no part of it.
        """
        before, most = self._merit(here.f, here.g, weight), float(np.abs(change).max())
        lbx, ubx, _, _ = self.bounds
        a, trial, share = here.x[: self.fixed.size], here.x, 1.0
        for _ in range(_HALVED):
            inside = np.minimum(np.maximum(a + share * change, lbx), ubx)
            there = self.program.follow(here, inside - a, self.p)
            if there is not None:
                trial = there
                after = self._merit(*self.program.value(trial, self.p), weight)
                if np.isfinite(after) and (after < before or share * most < _LOCAL):
                    break
            share /= 2
        return trial, share

    def _merit(self, f: float, g: Array, weight: float) -> float:
        return f + weight * float(_sum(self._violations(g)))

    def _violations(self, g: Array) -> Array:
        _, _, lbg, ubg = self.bounds
        return np.maximum(0.0, np.maximum(lbg - g, g - ubg))

    def _residual(self, at: _Point) -> float:
        """Return the residual of the first-order conditions, scaled as planner.solve.newton's."""
        _, _, lbg, ubg = self.bounds
        here, lam, slope = at.here, at.lam, np.where(at.held, 0.0, at.slope)
        room = np.minimum(np.abs(np.where(lam > 0, ubg, lbg) - here.g), 1e3)
        scale = 1e-2 + _most(here.gradient) + _most(lam)
        violated = max(float(self._violations(here.g).max(initial=0.0)), here.off)
        return max(violated, max(_most(slope), _most((lam * room)[self.uneven])) / scale)


class _Point:
    """Where the steps are: what is linearised there, multipliers, the Lagrangian's gradient."""

    held: Mask
    met: bool

    def __init__(self, here: Reduced, lam: Array, slope: Array, steps: int) -> None:
        self.here, self.lam, self.slope, self.steps = here, lam, slope, steps

    def solution(self) -> Solution:
        """Return the point as a solution."""
        here, lam_x = self.here, np.where(self.held, -self.slope, 0.0)
        told = here.f, here.g, self.met, "" if self.met else _REASON, self.steps
        return Solution(here.x, lam_x, self.lam, *told)


def _sum(terms: Array) -> Array:
    """Return the sum over the first axis, one after the other, as C adds: to the same digits."""
    return np.add.accumulate(terms)[-1] if len(terms) else np.zeros(terms.shape[1:])


def _most(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def _is_convex(H: Array) -> bool:
    return bool(dpotrf(H, lower=1)[1] == 0)
