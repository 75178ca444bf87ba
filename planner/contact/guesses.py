"""Tensions that plans of arms in contact begin with."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import chain

import numpy as np

from model.paths import Array
from planner.solve.guesses import BendCoordinates, initial_guesses, many_places
from planner.solve.task import Task
from planner.targets.hold import Hold

# Arms that are drawn.
_DRAWN = 3000


def guesses(task: Task, holds: Sequence[Hold]) -> Iterable[Array]:
    """Return tensions (n_tendons,) [N], the likeliest first."""
    reaching = (_reaching(task, hold) for hold in holds)
    return chain.from_iterable(reaching) if holds else initial_guesses(task)


def _reaching(task: Task, hold: Hold) -> list[Array]:
    """Return tensions of arms without loads that free would reach into what is held.

    First those that would be pressed apart from it along what balances the wrench, within the cone
    of friction; of these the least tensions first.
    """
    arm, body = task.arm, hold.obstacle
    tendons = frozenset(j for j in range(arm.n_tendons) if task.allowed.upper[j] > 0)
    bends = BendCoordinates(arm, tendons, task.allowed)
    tensions = bends.tensions(bends.draw(_DRAWN))
    points, radius = many_places(arm, task.bare, tensions, task.machine_code)
    gap = body.distance(points.reshape(-1, 3)).reshape(points.shape[:2]) - radius
    gap[np.isnan(gap)] = np.inf
    deepest = gap.argmin(axis=1)
    reach = np.flatnonzero(gap.min(axis=1) < 0)
    force = np.array(hold.wrench[:3])
    force /= max(float(np.linalg.norm(force)), 1e-300)
    against = body.gradient(points[reach, deepest[reach]]) @ force if reach.size else np.zeros(0)
    within = np.minimum(against, 1 / np.hypot(1.0, hold.friction)).round(1)
    effort = np.linalg.norm(tensions[reach], axis=1)
    return [tensions[i] for i in reach[np.lexsort((effort, -within))]]
