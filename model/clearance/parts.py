"""Pieces of an arm during parts of a motion: where each of them can be.

A part of a motion is known at five instants. In between, each node of the arm is near the
polynomial through its places, within what model.clearance.smooth says; and each piece of the arm is
within its sag and radius of the line between its nodes. So a piece during a part is in the convex
hull of ten points, widened by a length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.centreline import Centreline, Counts
from model.clearance.smooth import INSTANTS, Mask, chebyshev, control, falls, highest, tail
from model.paths import Array

# What counts as rounding, over L: the equations of equilibrium are solved so well.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Parts:
    """Parts of a motion.

    Attributes
    ----------
    lines : Centreline
        All arms of the motion that are known, joined.
    rows : (P, 5)
        Which of them are those of each part.
    """

    lines: Centreline
    rows: Counts

    @classmethod
    def of(cls, lines: Sequence[Centreline], rows: Counts) -> Parts:
        """Return parts by lists of centrelines."""
        return cls(Centreline.joined(lines), rows)

    @property
    def elements(self) -> int:
        """How many elements an arm has."""
        return int(np.argmax(self.lines.s)) if self.lines.s.size else 0

    @cached_property
    def _places(self) -> Array:
        """Where the nodes of each part are (P, 5, N + 1, 3) [m]."""
        return self.lines.poses[:, 4:].reshape(-1, self.elements + 1, 3)[self.rows]

    @cached_property
    def _changes(self) -> Array:
        """The sizes (P, 5) of the Chebyshev coefficients of a part's places [m], of all nodes."""
        return np.asarray(np.linalg.norm(chebyshev(self._places), axis=3).max(axis=2))

    @cached_property
    def known(self) -> Mask:
        """Whether instants are close enough to tell what is in between (P,)."""
        return falls(self._changes, _ROUNDING * self.lines.arm.length)

    @cached_property
    def tail(self) -> Array:
        """What places may differ by from polynomials, of all nodes of a part (P,) [m]."""
        return tail(self._changes)

    @cached_property
    def turned(self) -> Array:
        """How far tangents have turned from the base to each node (P, 5, N + 1) [rad]."""
        own = np.append(self.lines.sizes[1], 0.0).reshape(-1, self.elements + 1)
        own = np.hstack([np.zeros((len(own), 1)), own[:, :-1]])
        return np.asarray(np.cumsum(own, axis=1)[self.rows])

    def pieces(self, part: Counts, element: Counts, start: Array, end: Array) -> Pieces:
        """Return pieces (K,) by their part, element, and the shares of it where they are."""
        row = self.rows[part] * (self.elements + 1) + element[:, None]
        if start.any() or (end < 1).any():
            a, b = (np.repeat(share, INSTANTS) for share in (start, end))
            first, _, before = self.lines.moved(row.ravel(), 0 * a, a)
            last, lengths, own = self.lines.moved(row.ravel(), a, b)
            ends = np.stack([first, last], axis=1).reshape(-1, INSTANTS, 2, 3)
            turned = np.column_stack([before, before + own]).reshape(-1, INSTANTS, 2)
            turned += self.turned[part, :, element][:, :, None]
            lengths = lengths.reshape(-1, INSTANTS)
        else:
            u, turn = self.lines.poses[:, 4:], self.turned[part, :, element]
            ends = np.stack([u[row], u[row + 1]], axis=2)
            lengths, own = (size[row] for size in self.lines.sizes)
            turned = np.stack([turn, turn + own], axis=2)
        return Pieces(self, part, element, start, end, ends, turned, lengths)


@dataclass(frozen=True, eq=False)
class Pieces:
    """Pieces of an arm during parts of a motion.

    Attributes
    ----------
    of : Parts
    part, element : (K,)
        What each is a piece of.
    start, end : (K,)
        Shares of the element, from 0 to 1, where it begins and ends.
    ends : (K, 5, 2, 3)
        Where these are at the instants [m].
    turned : (K, 5, 2)
        How far tangents have turned from the base to there, all in all [rad].
    lengths : (K, 5)
        Of it at the instants [m].
    """

    of: Parts
    part: Counts
    element: Counts
    start: Array
    end: Array
    ends: Array
    turned: Array
    lengths: Array

    def __getitem__(self, which: Mask | Counts) -> Pieces:
        """Return some of the pieces."""
        at = (self.part[which], self.element[which], self.start[which], self.end[which])
        own = (self.ends[which], self.turned[which], self.lengths[which])
        return Pieces(self.of, *at, *own)

    @cached_property
    def hull(self) -> Array:
        """The points (K, 10, 3) whose convex hull holds the line between the ends [m]."""
        return control(self.ends).reshape(-1, 2 * INSTANTS, 3)

    @cached_property
    def middle(self) -> Array:
        """A place in the middle (K, 3) [m]."""
        return np.asarray(self.ends[:, INSTANTS // 2].mean(axis=1))

    @cached_property
    def known(self) -> Mask:
        """See Parts.known (K,)."""
        return self.of.known[self.part]

    @cached_property
    def size(self) -> Array:
        """About how long the pieces are (K,) [m]."""
        middle = self.ends[:, INSTANTS // 2]
        return np.asarray(np.linalg.norm(middle[:, 1] - middle[:, 0], axis=1))

    @cached_property
    def travel(self) -> Array:
        """About how far the ends travel during the part (K,) [m]."""
        return np.asarray(np.linalg.norm(self.ends[:, -1] - self.ends[:, 0], axis=2).max(axis=1))

    @cached_property
    def radii(self) -> Array:
        """The arm's radius (K, 5, 3) at the instants, at both ends and in the middle [m]."""
        lines, size = self.of.lines, self.of.elements + 1
        rows = (self.of.rows[self.part] * size + self.element[:, None]).ravel()
        places = (self.start, (self.start + self.end) / 2, self.end)
        shares = [np.repeat(share, INSTANTS) for share in places]
        found = np.stack([lines.radius(rows, share) for share in shares], axis=1)
        return np.asarray(found.reshape(-1, INSTANTS, 3))

    @cached_property
    def wide(self) -> Array:
        """How far the surface may be from the hull (K,) [m].

        See model.clearance.pieces for the sag and for the largest radius.
        """
        chord = np.linalg.norm(self.ends[:, :, 1] - self.ends[:, :, 0], axis=2)
        square = highest(np.maximum(self.lengths**2 - chord**2, 0.0))
        radii = highest(self.radii)
        bent = np.abs(radii[:, 0] - 2 * radii[:, 1] + radii[:, 2])
        sag = np.sqrt(np.maximum(square, 0.0)) / 2
        return np.asarray(sag + radii.max(axis=1) + bent + self.of.tail[self.part])
