"""How clear an arm is on its way through tensions: see model.clearance.swept."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from model.centreline import Centreline, Counts
from model.clearance.lines import Lines
from model.clearance.swept import Around, Swept, swept
from model.obstacles.bodies import Bodies
from model.paths import Array
from planner.avoidance.asked import Surroundings
from planner.avoidance.places import base_plane


def between(lines: Lines, tensions: Array, times: Array, asked: Surroundings) -> Swept:
    """Return how clear an arm stays from each of tensions (N + 1, n_tendons) [N] to the next.

    At times (N + 1,) [s], with a steady pace in between where obstacles move.
    """
    which, low, high = _steady(times, asked)

    def settled(part: Counts, share: Array) -> list[Centreline | None]:
        k, along = which[part], low[part] + share * (high - low)[part]
        return lines.many(tensions[k] + along[:, None] * (tensions[k + 1] - tensions[k]))

    starts, steps = times[which], np.diff(times)[which]
    ends = np.stack([starts + low * steps, starts + high * steps], axis=1)
    found = swept(settled, which.size, _around(lines, asked, ends))
    first = np.lexsort((found.bound, which))[np.searchsorted(which, np.arange(times.size - 1))]
    share = low[first] + found.share[first] * (high - low)[first]
    return Swept(found.bound[first], found.seen[first], share)


def _steady(times: Array, asked: Surroundings) -> tuple[Counts, Array, Array]:
    """Return parts of stretches on which obstacles move steadily: which stretch, shares (P,)."""
    breaks = np.array(sorted({t for own in asked.moving for t in own.times}))
    which, low, high = [], [], []
    for k, (start, end) in enumerate(pairwise(times)):
        inside = breaks[(breaks > start) & (breaks < end)]
        cuts = np.concatenate([[0.0], (inside - start) / max(end - start, 1e-300), [1.0]])
        which += [k] * (cuts.size - 1)
        low.append(cuts[:-1])
        high.append(cuts[1:])
    return np.array(which), np.concatenate(low), np.concatenate(high)


def _around(lines: Lines, asked: Surroundings, ends: Array) -> Around:
    """Return what is to be kept clear of from times to others (P, 2); the base plane is last."""
    arm, bodies = lines.arm, [*asked.obstacles, *(own.obstacle for own in asked.moving)]
    turns = np.zeros(len(bodies) + asked.of_itself)
    moved = np.zeros((len(ends), 2, turns.size, 3))
    for i, own in enumerate(asked.moving, start=len(asked.obstacles)):
        moved[:, :, i] = own.moved(ends)
    if asked.of_itself:
        bodies.append(base_plane(arm))
        turns[-1] = np.pi / 2
    return Around(Bodies(bodies), moved, turns, asked.of_itself, asked.clearance)
