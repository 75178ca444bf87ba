"""What the effort of a designed arm is sensitive to.

With every task's tensions chosen anew, half the sum of the squared tensions changes with a number p
of the arm by the multipliers lambda of the tasks: d/dp = lambda . d(residuals)/dp, where
T + lambda . d(residuals)/dT = 0 for all tensions within their limits. Source: Fiacco, "Introduction
to Sensitivity and Stability Analysis in Nonlinear Programming" (1983), theorem 3.4.1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from model.paths import Array
from planner.design.tasks import Missed
from planner.plan import Plan

# Tensions nearer to a limit than this, over the largest, and inequalities below are held.
_HELD = 1e-6


def effort_jacobian(plans: Sequence[Plan], missed: Sequence[Missed]) -> Array:
    """Return the derivatives (K,) of the root of the sum of squared efforts by the unknowns.

    Of plans of the tasks, and what these miss of them.
    """
    found = np.zeros(missed[0].by_numbers.shape[1])
    for own, task in zip(plans, missed, strict=True):
        T = np.ravel(own.tensions)
        room = np.minimum(T - own.limits.lower, np.array(own.limits.upper) - T)
        free = room > _HELD * max(float(T.max()), 1e-12)
        held = np.concatenate([np.full(task.equality.size, True), task.inequality <= _HELD])
        multipliers = np.linalg.lstsq(task.by_tensions[held][:, free].T, -T[free], rcond=None)[0]
        found += task.by_numbers[held].T @ multipliers
    return found / max(float(np.linalg.norm([own.effort for own in plans])), 1e-300)
