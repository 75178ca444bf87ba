"""What is left to look at on a way: parts of it, and pieces of the arm there; and its halves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.centreline import Counts
from model.clearance.parts import Parts, Pieces
from model.clearance.smooth import SHARES, Mask
from model.paths import Array


@dataclass(frozen=True, eq=False)
class Worklist:
    """Parts of stretches of a way, and of the arm what is to be looked at there.

    Attributes
    ----------
    stretch, start, end : (P,)
        The parts: which stretch, and from which share of it to which.
    part : (K,)
        What each row is of.
    element, low, high : (K, 1 or 2)
        A piece that may come near to bodies, or two that may meet: the elements that they are of,
        and from which share of it to which.
    """

    stretch: Counts
    start: Array
    end: Array
    part: Counts
    element: Counts
    low: Array
    high: Array

    @classmethod
    def whole(cls, count: int, part: Counts, element: Counts) -> Worklist:
        """Return whole elements (K, 1 or 2) during so many whole stretches."""
        zeros, none = np.zeros(count), np.zeros(element.shape)
        return cls(np.arange(count), zeros, zeros + 1, part, element, none, none + 1)

    @property
    def instants(self) -> Array:
        """The instants of the parts (P, 5), as shares of their stretches."""
        return np.asarray(self.start[:, None] + (self.end - self.start)[:, None] * SHARES)

    def pieces(self, parts: Parts) -> list[Pieces]:
        """Return the pieces, by columns."""
        columns = zip(self.element.T, self.low.T, self.high.T, strict=True)
        return [parts.pieces(self.part, *column) for column in columns]

    def without(self, stretches: Mask) -> Worklist:
        """Return the list without some of the stretches."""
        keep = ~stretches[self.stretch]
        index, rows = np.cumsum(keep) - 1, keep[self.part]
        parts = (self.stretch[keep], self.start[keep], self.end[keep], index[self.part[rows]])
        return Worklist(*parts, self.element[rows], self.low[rows], self.high[rows])

    def halved(self, late: Counts, piece: Counts, column: Counts) -> Worklist:
        """Return both halves of some rows: of the part of `late` ones, of others of a piece.

        The piece is that of the `column` (len(piece),).
        """
        kept, at = np.unique(self.part[piece], return_inverse=True)
        cut, half = np.unique(self.part[late], return_inverse=True)
        middle = (self.start[cut] + self.end[cut]) / 2
        low, high = (np.repeat(own[piece], 2, axis=0) for own in (self.low, self.high))
        first = 2 * np.arange(piece.size)
        mean = (low[first, column] + high[first, column]) / 2
        high[first, column] = low[first + 1, column] = mean
        late_parts = kept.size + half
        return Worklist(
            np.concatenate([self.stretch[kept], self.stretch[cut], self.stretch[cut]]),
            np.concatenate([self.start[kept], self.start[cut], middle]),
            np.concatenate([self.end[kept], middle, self.end[cut]]),
            np.concatenate([np.repeat(at, 2), late_parts, late_parts + cut.size]),
            np.concatenate([np.repeat(self.element[piece], 2, axis=0), *[self.element[late]] * 2]),
            np.concatenate([low, *[self.low[late]] * 2]),
            np.concatenate([high, *[self.high[late]] * 2]),
        )
