"""The way of an arm: at rest, or with tensions that change steadily on each of its stretches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from model.centreline import Centreline, Counts
from model.clearance.lines import Lines
from model.clearance.strain_bounds import Spread, estimated, proven
from model.paths import Array

# Which stretches (K,) and shares of them (K,) -> tensions (K, n_tendons), on a straight line each.
Tensions = Callable[[Counts, Array], Array]


@dataclass(frozen=True)
class Still:
    """An arm at rest: a way of one stretch that takes no time; see Moving."""

    line: Centreline
    moves = False

    def lines(self, stretch: Counts, share: Array) -> Sequence[Centreline | None]:
        """See Moving.lines."""
        return [self.line] * share.size

    def spread(self, stretch: Counts, start: Array, end: Array) -> Spread | None:
        """See Moving.spread."""
        return None


class Moving:
    """A way by its tensions, of stretches that take time."""

    moves = True

    def __init__(self, lines: Lines, tensions: Tensions) -> None:
        self._lines, self._tensions = lines, tensions
        self._known: dict[tuple[int, float], Centreline | None] = {}

    def lines(self, stretch: Counts, share: Array) -> list[Centreline | None]:
        """Return the arms at shares (K,) of stretches (K,); None where one has no equilibrium."""
        keys = list(zip(stretch.tolist(), share.tolist(), strict=True))
        new = sorted({key for key in keys if key not in self._known})
        if new:
            which, shares = np.array([i for i, _ in new]), np.array([u for _, u in new])
            result = self._lines.many(self._tensions(which, shares))
            self._known.update(zip(new, result, strict=True))
        return [self._known[key] for key in keys]

    def spread(self, stretch: Counts, start: Array, end: Array) -> Spread:
        """Return how far strains are from straight lines from shares (P,) to others.

        Proven without loads, estimated under loads; see model.clearance.strain_bounds.
        """
        first, last = (_strains(self.lines(stretch, share)) for share in (start, end))
        if not self._lines.loaded:
            T = self._tensions(stretch, start), self._tensions(stretch, end)
            return proven(self._lines.sections, T, (first[..., 1:4], last[..., 1:4]))
        halfway = self.lines(stretch, (start + end) / 2)
        there = np.array([each is not None for each in halfway])
        pairs = zip(halfway, self.lines(stretch, start), strict=True)
        filled = _strains([each or known for each, known in pairs])
        result = estimated(first, filled, last, self._lines.arm.length)
        return result._replace(known=result.known & there)


Way = Still | Moving


def _strains(lines: list[Centreline | None]) -> Array:
    """Return kappa and nu (K, N, 6) at the stages of arms."""
    known = [line for line in lines if line is not None]
    kappa, nu = (np.array([getattr(each, name) for each in known]) for name in ("kappa", "nu"))
    return np.concatenate([kappa, nu], axis=3).reshape(len(known), -1, 6)
