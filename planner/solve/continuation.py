"""Continuation in the target, where a direct solve fails: from what a first guess does attain.

What a first guess is off by is taken from what is asked, so that it meets that; then less and less
of it. The way is found on the coarse mesh, and each step of it is an optimum.
"""

from __future__ import annotations

import numpy as np

from model.paths import Array
from model.time_limit import check_time
from planner.program.problem import Bounds, Problem
from planner.solve.ipopt import Solution, solve
from planner.solve.walk import walk

_FIRST_STEP = 1 / 4


def continued(problem: Problem, x: Array, p: Array, bounds: Bounds) -> Solution | None:
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
    return None if start is None else walk(start, at, _FIRST_STEP)
