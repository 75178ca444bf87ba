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
        for key, T in zip(keys, self._tensions(stretch, share), strict=True):
            if key not in self._known:
                self._known[key] = self._lines(T)
        return [self._known[key] for key in keys]

    def spread(self, stretch: Counts, start: Array, end: Array) -> Spread:
        """Return how far strains are from straight lines from shares (P,) to others.

        Proven without loads, estimated under loads; see model.clearance.strain_bounds.
        """
        ends = np.array([_strains(self.lines(stretch, share)) for share in (start, end)])
        if not self._lines.loaded:
            T = np.array([self._tensions(stretch, share) for share in (start, end)])
            return proven(self._lines.sections, T, ends[..., 1:4])
        halfway = _strains(self.lines(stretch, (start + end) / 2))
        return estimated(ends, halfway, self._lines.arm.length)


Way = Still | Moving


def _strains(lines: list[Centreline | None]) -> Array:
    """Return kappa and nu (K, N, 6) at the stages of arms; NaN, or (K, 1, 6), without them."""
    none = np.full((1, 6), np.nan)
    rows = [
        none if line is None else np.concatenate([line.kappa, line.nu], axis=2).reshape(-1, 6)
        for line in lines
    ]
    return np.array(np.broadcast_arrays(*rows))
