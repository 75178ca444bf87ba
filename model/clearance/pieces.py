"""Pieces of an arm, and bounds on where each of them is.

A curve of length l between two points a distance c apart stays within sqrt(l^2 - c^2) / 2 of the
line between them: from any of its points the ways to both ends add up to l at the most, and an
ellipsoid with these foci is so wide. So a piece of the arm lies within that and its own radius of
a line segment, whatever it does in between; both shrink with the square of its length.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from model.centreline import Centreline, Counts
from model.paths import Array

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Pieces:
    """Consecutive pieces of an arm, from base to tip.

    Attributes
    ----------
    line : Centreline
    element : (K,)
        That each piece is part of.
    start, end : (K,)
        Shares of the element, from 0 to 1, where it begins and ends.
    points : (K, 3)
        Where each ends [m].
    length, turn : (K,)
        Of each, deformed [m], and the angle that its tangent sweeps [rad].
    """

    line: Centreline
    element: Counts
    start: Array
    end: Array
    points: Array
    length: Array
    turn: Array

    @classmethod
    def of(cls, line: Centreline, each: int) -> Pieces:
        """Return pieces of a centreline, so many to an element."""
        n = line.s.size - 1
        element = np.repeat(np.arange(n), each)
        start = np.tile(np.arange(each) / each, n)
        end = np.tile((np.arange(each) + 1) / each, n)
        return cls(line, element, start, end, *line.moved(element, start, end))

    def halved(self, which: Mask) -> Pieces:
        """Return the pieces with some of them cut in the middle."""
        counts = 1 + which
        element, first = np.repeat(self.element, counts), np.cumsum(counts)[which] - 2
        start, end = np.repeat(self.start, counts), np.repeat(self.end, counts)
        start[first + 1] = end[first] = (start[first] + end[first]) / 2
        points = np.repeat(self.points, counts, axis=0)
        length, turn = np.repeat(self.length, counts), np.repeat(self.turn, counts)
        new = np.concatenate([first, first + 1])
        points[new], length[new], turn[new] = self.line.moved(element[new], start[new], end[new])
        return Pieces(self.line, element, start, end, points, length, turn)

    @cached_property
    def nodes(self) -> Array:
        """Both ends of all pieces (K + 1, 3) [m]."""
        return np.vstack([self.line.poses[:1, 4:], self.points])

    @cached_property
    def s(self) -> Array:
        """Arc lengths of the nodes (K + 1,) [m]."""
        s, h = self.line.s, np.diff(self.line.s)
        return np.append(s[0], s[self.element] + self.end * h[self.element])

    @cached_property
    def turned(self) -> Array:
        """How far the tangent has turned from the base to each node (K + 1,) [rad], all in all."""
        return np.append(0.0, np.cumsum(self.turn))

    @cached_property
    def sag(self) -> Array:
        """The farthest that each piece may be from the line between its ends (K,) [m]."""
        chord = np.linalg.norm(np.diff(self.nodes, axis=0), axis=1)
        return np.asarray(np.sqrt(np.maximum(self.length**2 - chord**2, 0.0)) / 2)

    @cached_property
    def radii(self) -> Array:
        """The arm's radius at both ends and the middle of each piece (3, K) [m]."""
        middle = (self.start + self.end) / 2
        shares = (self.start, middle, self.end)
        return np.array([self.line.radius(self.element, share) for share in shares])

    @cached_property
    def most(self) -> Array:
        """The arm's largest radius in each piece (K,) [m].

        Between the three places where it is known it is a parabola, but for terms of third order.
        """
        bent = np.abs(self.radii[0] - 2 * self.radii[1] + self.radii[2])
        return np.asarray(self.radii.max(axis=0) + bent)

    @cached_property
    def least(self) -> Array:
        """The radius at the nodes (K + 1,) [m], where it jumps the larger one."""
        before, after = self.radii[2], self.radii[0]
        inner = np.maximum(before[:-1], after[1:])
        return np.concatenate([after[:1], inner, before[-1:]])


def segment_gaps(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return distances (K,) between line segments a b and c d, each (K, 3) [m].

    Source: Ericson, "Real-Time Collision Detection" (2005), 5.1.9.
    """
    u, v, w = b - a, d - c, a - c
    uu, vv, uv = (np.einsum("ki,ki->k", x, y) for x, y in ((u, u), (v, v), (u, v)))
    uw, vw = (np.einsum("ki,ki->k", x, w) for x in (u, v))
    tiny = 1e-300
    cross = uu * vv - uv**2
    p = np.where(cross > 1e-12 * uu * vv, (uv * vw - uw * vv) / np.maximum(cross, tiny), 0.0)
    p = np.clip(p, 0.0, 1.0)
    q = np.clip((uv * p + vw) / np.maximum(vv, tiny), 0.0, 1.0)
    p = np.clip((uv * q - uw) / np.maximum(uu, tiny), 0.0, 1.0)
    q = np.clip((uv * p + vw) / np.maximum(vv, tiny), 0.0, 1.0)
    found = [np.linalg.norm(w + p[:, None] * u - q[:, None] * v, axis=1)]
    # Parallel lines are nearest at some end.
    for x, low, high in ((a, c, d), (b, c, d), (c, a, b), (d, a, b)):
        found.append(_to_segment(x, low, high))
    return np.asarray(np.min(found, axis=0))


def _to_segment(x: Array, a: Array, b: Array) -> Array:
    """Return distances (K,) of points x from segments a b."""
    along = b - a
    square = np.maximum(np.einsum("ki,ki->k", along, along), 1e-300)
    share = np.clip(np.einsum("ki,ki->k", x - a, along) / square, 0.0, 1.0)
    return np.asarray(np.linalg.norm(x - a - share[:, None] * along, axis=1))
