"""How clear an arm is on its way through tensions: see model.clearance.swept."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from model.centreline import Centreline, Counts
from model.clearance.lines import Lines
from model.clearance.swept import Around, Swept, swept
from model.obstacles.bodies import Bodies
from model.paths import Array
from planner.avoidance.asked import Surroundings
from planner.avoidance.places import base_plane
from planner.trajectory.time_law import TimeLaw


def between(
    lines: Lines,
    tensions: Array,
    times: Array,
    asked: Surroundings,
    laws: Sequence[TimeLaw] | None = None,
) -> Swept:
    """Return how clear an arm stays from each of tensions (N + 1, n_tendons) [N] to the next.

    At times (N + 1,) [s], where obstacles move with the pace of laws in between, or a steady one.
    The shares that are returned are those of the way.
    """
    pace = laws if asked.moving else None
    which, low, high = _steady(times, asked, pace)

    def settled(part: Counts, share: Array) -> list[Centreline | None]:
        k, along = which[part], low[part] + share * (high - low)[part]
        along = _way(pace, k, along)
        return lines.many(tensions[k] + along[:, None] * (tensions[k + 1] - tensions[k]))

    starts, steps = times[which], np.diff(times)[which]
    ends = np.stack([starts + low * steps, starts + high * steps], axis=1)
    found = swept(settled, which.size, _around(lines, asked, ends))
    first = np.lexsort((found.bound, which))[np.searchsorted(which, np.arange(times.size - 1))]
    share = low[first] + found.share[first] * (high - low)[first]
    return Swept(found.bound[first], found.seen[first], _way(pace, which[first], share))


def _way(laws: Sequence[TimeLaw] | None, which: Counts, shares: Array) -> Array:
    """Return the shares of the way (K,) at shares of the time of stretches (K,)."""
    if laws is None:
        return shares
    found = np.zeros(shares.size)
    for k in np.unique(which):
        own, law = which == k, laws[k]
        found[own] = law.at(shares[own] * law.times[-1])[0].clip(0.0, 1.0)
    return found


def _steady(
    times: Array, asked: Surroundings, laws: Sequence[TimeLaw] | None
) -> tuple[Counts, Array, Array]:
    """Return parts of stretches on which obstacles move steadily: which stretch, shares (P,).

    On each the arm's pace is smooth as well. Shares are those of the time.
    """
    breaks = np.array(sorted({t for own in asked.moving for t in own.times}))
    which, low, high = [], [], []
    for k, (start, end) in enumerate(pairwise(times)):
        inside = breaks[(breaks > start) & (breaks < end)]
        own = [] if laws is None else laws[k].times[1:-1] / laws[k].times[-1]
        inner = np.concatenate([(inside - start) / max(end - start, 1e-300), own])
        cuts = np.concatenate([[0.0], np.unique(inner), [1.0]])
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
