"""Continuation: from a problem that is solved to one like it, by steps that adapt.

In the target, where a direct solve fails, it begins with what an initial guess does attain: what
that is off by is taken from what is asked, so that it meets that; then less and less of it. Each
step is an optimum, on the coarse mesh.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from model.paths import Array
from model.time_limit import check_time
from planner.program.problem import Bounds, Problem
from planner.solve.ipopt import Solution, solve

_FIRST_STEP, _LEAST_STEP = 1 / 4, 1 / 64


def continuation(
    start: Solution, at: Callable[[Solution, float], Solution | None], step: float = 1.0
) -> Solution | None:
    """Return the solution at share 1, from that at share 0; None where the way there ends.

    `at` solves at a share from a solution near, or returns None: then the step is halved.
    """
    share = 0.0
    while share < 1:
        trial = min(1.0, share + step)
        found = at(start, trial)
        if found is not None:
            start, share, step = found, trial, 2 * step
        elif step <= _LEAST_STEP:
            return None
        else:
            step /= 2
    return start


def continued_targets(problem: Problem, x: Array, p: Array, bounds: Bounds) -> Solution | None:
    """Return the optimum that the way from unknowns x leads to, None where it ends before."""
    lbx, ubx, lbg, ubg = bounds
    g = problem.constraints(x, p)
    off = np.where(lbg == ubg, g - lbg, 0.0)

    def at(near: Solution | None, share: float) -> Solution | None:
        check_time()
        left = (1 - share) * off
        shifted = (lbx, ubx, lbg + left, ubg + left)
        begin = (x, None) if near is None else (near.x, (near.lam_x, near.lam_g))
        found = solve(problem, begin[0], p, shifted, begin[1])
        return found if found.met and found.finite else None

    if not np.all(np.isfinite(g)):
        return None
    start = at(None, 0.0)
    return None if start is None else continuation(start, at, _FIRST_STEP)
