"""Continuation: from a problem that is solved to one like it, by steps that adapt."""

from __future__ import annotations

from collections.abc import Callable

from planner.solve.ipopt import Solution

_LEAST_STEP = 1 / 64


def walk(
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
