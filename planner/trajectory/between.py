"""How clear an arm is between two sets of tensions, from how far its points move.

While tensions go from one set to the other along a line, no point of the arm is farther from where
it was at one of the ends than it travels. How far that is, is known of points that move along
nearly straight lines at a nearly constant pace: their place at half the way tells, and the ends are
parted until it does. So of two ends with gaps a and b the gap between is at least (a + b - d) / 2,
d the farthest that a point travels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from model.centreline import Centreline
from model.clearance import clearances
from model.paths import Array
from planner.avoidance.asked import Surroundings

Settled = Callable[[Array], Centreline | None]
# Places looked at; how far off the middle of a line a point may be for it to count as one, over
# its length, and how much longer than the line its way may be then; how close bounds come.
_PLACES, _STRAIGHT, _LONGER, _CLOSE, _DEEPEST = 65, 0.15, 1.25, 2e-5, 12
# Shares of the way where a further waypoint parts it.
_INSIDE = 0.02
# Those that are looked at first.
_LOOKED = (0.5, 0.25, 0.75, 0.125, 0.375, 0.625, 0.875)


@dataclass(frozen=True, eq=False)
class Moment:
    """An arm at a share of the way: its gap less what is asked [m], and places (K, 3) [m]."""

    share: float
    gap: float
    places: Array


@dataclass(frozen=True)
class Swept:
    """The least gap on the way less what is asked: a bound, the least seen, and where that was."""

    bound: float
    seen: float
    share: float


def swept(settled: Settled, start: Array, end: Array, asked: Surroundings) -> Swept:
    """Return how clear an arm stays on the way between tensions (n_tendons,) [N].

    The bound is refined until it is 0 or above, or close to what was seen.
    """
    first, last = (_moment(settled, start, end, share, asked) for share in (0.0, 1.0))
    if first is None or last is None:
        return Swept(-np.inf, -np.inf, 0.0)
    seen = min(first, last, key=lambda moment: moment.gap)
    close = _CLOSE * float(np.abs(first.places - first.places[0]).max())
    bound, left = min(first.gap, last.gap), [(first, last, 0)]
    while left:
        a, b, depth = left.pop()
        middle = _moment(settled, start, end, (a.share + b.share) / 2, asked)
        if middle is None:
            return Swept(-np.inf, seen.gap, (a.share + b.share) / 2)
        seen = min(seen, middle, key=lambda moment: moment.gap)
        lower = _lower(a, middle, b)
        if lower >= min(0.0, seen.gap - close) or depth == _DEEPEST:
            bound = min(bound, lower)
        else:
            left += [(a, middle, depth + 1), (middle, b, depth + 1)]
    return Swept(min(bound, seen.gap), seen.gap, seen.share)


def crossed(settled: Settled, start: Array, end: Array, asked: Surroundings) -> float | None:
    """Return where on the way between tensions an arm is nearest, if it is too near there."""
    looked = [_moment(settled, start, end, share, asked) for share in _LOOKED]
    seen = [moment for moment in looked if moment is not None]
    nearest = min(seen, key=lambda moment: moment.gap, default=None)
    if nearest is None or nearest.gap < 0:
        return None if nearest is None else nearest.share
    found = swept(settled, start, end, asked)
    return found.share if found.bound < 0 and _INSIDE < found.share < 1 - _INSIDE else None


def _lower(a: Moment, middle: Moment, b: Moment) -> float:
    """Return a lower bound of the gap between two moments, with that half way between."""
    bounds = []
    line = np.linalg.norm(b.places - a.places, axis=1).max()
    off = np.linalg.norm(middle.places - (a.places + b.places) / 2, axis=1).max()
    if off > _STRAIGHT * line:
        return -np.inf
    for one, other in ((a, middle), (middle, b)):
        travelled = _LONGER * np.linalg.norm(other.places - one.places, axis=1).max()
        bounds.append((one.gap + other.gap - travelled) / 2)
    return float(min(bounds))


def _moment(
    settled: Settled, start: Array, end: Array, share: float, asked: Surroundings
) -> Moment | None:
    line = settled(start + share * (end - start))
    if line is None:
        return None
    found = clearances(line, asked.obstacles, asked.least)
    gap = min((found[name].gap - least for name, least in asked.least.items()), default=np.inf)
    return Moment(share, gap, line.at(np.linspace(0.0, line.arm.length, _PLACES))[0])
