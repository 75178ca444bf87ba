"""How clear an arm is between two sets of tensions, from how far its points move.

While tensions go from one set to the other along a line, no point of the arm is farther from where
it was at one of the ends than it travels. How far that is, is known of points that move along
nearly straight lines at a nearly constant pace: their place at half the way tells, and the ends are
parted until it does. So of two ends with gaps a and b the gap between is at least (a + b - d) / 2,
d the farthest that a point travels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from model.centreline import Centreline
from model.clearance import clearances, rough_gaps
from model.paths import Array
from planner.avoidance.asked import Surroundings

Settled = Callable[[Array], Centreline | None]
# How far off the middle of a line a point may be for it to count as one, over
# its length, and how much longer than the line its way may be then; how close bounds come.
_STRAIGHT, _LONGER, _CLOSE, _DEEPEST = 0.15, 1.25, 2e-5, 12
# Shares of the way where a further waypoint parts it.
_INSIDE = 0.02
# Those that are looked at first.
_LOOKED = (0.5, 0.25, 0.75, 0.125, 0.375, 0.625, 0.875)


@dataclass(frozen=True, eq=False)
class Moment:
    """An arm at a share of the way.

    Attributes
    ----------
    share : float
    line : Centreline
    gap : float
        A lower bound of its gap less what is asked [m].
    places : (K, 3)
        Of its midline [m].
    sharp : bool
        Whether the bound is close.
    """

    share: float
    line: Centreline
    gap: float
    places: Array
    sharp: bool = False


@dataclass(frozen=True)
class Swept:
    """The least gap on the way less what is asked: a bound, the least seen, and where that was."""

    bound: float
    seen: float
    share: float


@dataclass(frozen=True, eq=False)
class Sweep:
    """The way from tensions to others (n_tendons,) [N], and what the arm keeps clear of on it."""

    settled: Settled
    start: Array
    end: Array
    asked: Surroundings

    def swept(self) -> Swept:
        """Return how clear an arm stays; the bound is refined until it is 0 or close to the truth.

        Close bounds of single arms are found only where rough ones do not do.
        """
        first, last = self.moment(0.0), self.moment(1.0)
        if first is None or last is None:
            return Swept(-np.inf, -np.inf, 0.0)
        seen = min(first, last, key=lambda moment: moment.gap)
        close = _CLOSE * float(np.abs(first.places - first.places[0]).max())
        bound, left = min(first.gap, last.gap), [(first, last, 0)]
        if bound < 0:
            first, last = self.sharpened(first), self.sharpened(last)
            seen = min(first, last, key=lambda moment: moment.gap)
            bound, left = seen.gap, [(first, last, 0)]
        while left:
            a, b, depth = left.pop()
            middle = self.moment((a.share + b.share) / 2)
            if middle is None:
                return Swept(-np.inf, seen.gap, (a.share + b.share) / 2)
            lower = _lower(a, middle, b)
            if lower < 0:
                a, middle, b = (self.sharpened(moment) for moment in (a, middle, b))
                seen = min(seen, a, middle, b, key=lambda moment: moment.gap)
                lower = _lower(a, middle, b)
            if lower >= min(0.0, seen.gap - close) or depth == _DEEPEST:
                bound = min(bound, lower)
            else:
                left += [(a, middle, depth + 1), (middle, b, depth + 1)]
        return Swept(min(bound, seen.gap), seen.gap, seen.share)

    def crossed(self) -> float | None:
        """Return where on the way an arm is nearest, if it is too near there."""
        found = self.swept()
        if found.bound >= 0:
            return None
        looked = [self.moment(share) for share in _LOOKED]
        seen = [self.sharpened(moment) for moment in looked if moment is not None]
        nearest = min(seen, key=lambda moment: moment.gap, default=None)
        if nearest is None or nearest.gap < 0:
            return None if nearest is None else nearest.share
        return found.share if _INSIDE < found.share < 1 - _INSIDE else None

    def moment(self, share: float) -> Moment | None:
        """Return the arm at a share of the way, with a rough bound; None if it does not settle."""
        line = self.settled(self.start + share * (self.end - self.start))
        if line is None:
            return None
        found, places = rough_gaps(line, self.asked.obstacles, self.asked.least)
        return Moment(share, line, self._least(found), places)

    def sharpened(self, moment: Moment) -> Moment:
        """Return a moment with a close bound."""
        if moment.sharp:
            return moment
        found = clearances(moment.line, self.asked.obstacles, self.asked.least)
        gap = self._least({name: clear.gap for name, clear in found.items()})
        return replace(moment, gap=gap, sharp=True)

    def _least(self, gaps: dict[str, float]) -> float:
        least = self.asked.least.items()
        return min((gaps[name] - gap for name, gap in least), default=np.inf)


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
