"""Back to the constraints of a waypoint: from tensions nearby to those that meet them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dgelss

from model.paths import Array
from planner.program.condensed import Condensed
from planner.program.problem import Bounds, Problem
from planner.program.reduced import Reduced

# Steps back to the constraints, and when they are met.
STEPS, EXACT = 4, 1e-10
# How far states may be from equilibrium: constraints, to first order where it is, are off by the
# square.
_OFF = 1e-7


@dataclass(frozen=True, eq=False)
class Stop:
    """A waypoint as a program of its own: see planner.program.problem.

    `functions` are those of the problem; with a memory of the waypoint's own once it is `apart`.
    """

    problem: Problem
    p: Array
    bounds: Bounds
    functions: Condensed

    def apart(self, a: Array) -> Stop:
        """Return the waypoint with a memory of its own, of what is found at scaled tensions a."""
        self.first(a)
        return replace(self, functions=self.functions.apart())

    def first(self, a: Array) -> Reduced:
        """Return its values and first derivatives at scaled tensions a (n,)."""
        return self.functions.first(a, self.p)

    def moved(self, before: Reduced | None, a: Array) -> Reduced:
        """Return the same after a point nearby, whose states are followed if that leads there.

        They are then near equilibrium, as `Reduced.off` tells.
        """
        if before is not None and before.states is not None:
            x = self.functions.follow(before, a - before.x[: a.size], self.p)
            found = None if x is None else self.functions.at(x, self.p)
            if found is not None:
                return found
        return self.first(a)

    def lack(self, g: Array) -> Array:
        """Return by how much constraints with values g are violated, with the sign of the cure."""
        low, high = self.bounds[2:]
        return np.where(g < low, low - g, np.where(g > high, high - g, 0.0))


def restored(
    stop: Stop,
    a: Array,
    steps: int = STEPS,
    enough: float = EXACT,
    near: Reduced | None = None,
) -> tuple[Array, Reduced]:
    """Return scaled tensions near a that meet the constraints, if a few steps lead there.

    Newton's method for the rows that are violated, by the shortest steps within the bounds, and for
    the states at once, from those of a point nearby if one is given; with the values of the
    program there.
    """
    lbx, ubx, lbg, ubg = stop.bounds
    a = np.clip(a, lbx, ubx)
    at = stop.moved(near, a)
    for _ in range(steps):
        lack = stop.lack(at.g)
        met = np.abs(lack).max(initial=0.0) < enough and at.off < _OFF
        if met or not np.all(np.isfinite(at.jacobian)):
            break
        rows = (np.abs(lack) > EXACT) | np.equal(lbg, ubg)
        a = np.clip(a + _shortest(at.jacobian[rows], lack[rows], lbx - a, ubx - a), lbx, ubx)
        at = stop.moved(at, a)
    if not at.off < _OFF:
        return a, stop.first(a)
    stop.functions.stay(at, stop.p)
    return a, at


def _shortest(J: Array, lack: Array, low: Array, high: Array) -> Array:
    """Return the shortest step with J step = lack, once more without what meets its bounds."""
    step = _least_squares(J, lack)
    free = (step > low) & (step < high)
    if free.all() or not free.any():
        return step
    held = np.clip(step, low, high)
    left = lack - J[:, ~free] @ held[~free]
    held[free] = _least_squares(J[:, free], left)
    return held


def _least_squares(J: Array, right: Array) -> Array:
    """Return the shortest solution (n,) of J x = right in the sense of least squares."""
    m, n = J.shape
    room = np.concatenate([right, np.zeros(max(n - m, 0))])
    return np.asarray(dgelss(J, room, cond=1e-12)[1][:n])
