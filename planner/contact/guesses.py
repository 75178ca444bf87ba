"""Tensions that plans of arms in contact begin with."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from model.errors import OctoplanError
from model.paths import Array
from model.time_limit import check_time
from planner.contact.equilibria import Equilibria
from planner.initial_guess.guesses import initial_guesses
from planner.initial_guess.many_arms import BendCoordinates, many_places
from planner.program.limits import natural_tensions
from planner.solve.task import Task
from planner.targets.hold import Hold

# Bends towards what is held, in natural tensions, harder and harder.
_HARDER = 0.25 * 1.5 ** np.arange(8)
# Arms that are drawn, and those that are tried, no deeper in what they hold, over their length.
_DRAWN, _TRIED, _DEEP = 3000, 8, 0.2


def guesses(task: Task, equilibria: Equilibria) -> Iterator[Array]:
    """Yield tensions (n_tendons,) [N], the likeliest first."""
    limits = np.array(task.allowed.lower), np.array(task.allowed.upper)
    holds = [target for target in task.targets if isinstance(target, Hold)]
    for hold in holds:
        towards = _towards(task, hold.guess_towards(task.arm))
        yield _pressed(equilibria, [np.clip(c * towards, *limits) for c in _HARDER])
        yield from _reaching(task, hold)
    if not holds:
        yield from initial_guesses(task)


def _towards(task: Task, point: Array) -> Array:
    """Return the natural tensions of the tendons on the side of the arm where a point is."""
    arm, phi = task.arm, np.array([angle for _, angle in task.arm.tendons])
    n, b = (point - np.array(arm.base_position)) @ np.array(arm.base_frame)[:, 1:]
    along = (np.cos(phi) * n + np.sin(phi) * b) / max(np.hypot(n, b), 1e-12)
    natural = np.minimum(natural_tensions(arm), np.array(task.allowed.upper))
    return np.asarray(natural * np.maximum(along, 0.0))


def _pressed(equilibria: Equilibria, row: list[Array]) -> Array:
    """Return those of growing tensions that leave least of the wrenches, up to where it snaps."""
    trials, point = [(np.inf, row[0])], None
    with suppress(OctoplanError):
        for T in row:
            check_time()
            point = equilibria.settled(T, point)
            trials.append((equilibria.wrench_left(point), T))
    return min(trials, key=lambda trial: trial[0])[1]


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
    depth = -gap[np.arange(_DRAWN), deepest]
    reach = np.flatnonzero((depth > 0) & (depth < _DEEP * arm.length))
    force = np.array(hold.wrench[:3])
    force /= max(float(np.linalg.norm(force)), 1e-300)
    against = body.gradient(points[reach, deepest[reach]]) @ force if reach.size else np.zeros(0)
    within = np.minimum(against, 1 / np.hypot(1.0, hold.friction)).round(1)
    effort = np.linalg.norm(tensions[reach], axis=1)
    return [tensions[i] for i in reach[np.lexsort((effort, -within))][:_TRIED]]
