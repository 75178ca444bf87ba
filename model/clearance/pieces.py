"""Pieces of an arm during parts of a motion, and bounds on where each of them is.

Along the arm: a curve of length l between two points a distance c apart stays within
sqrt(l^2 - c^2) / 2 of the line between them, as from any of its points the ways to both ends add up
to l at the most, and an ellipsoid with these foci is so wide.

In time: let curvature kappa and tangent nu, per unit reference length in the local frame, go from
their values at the beginning of a part to those at its end in straight lines, while t goes from 0
to 1, with O(s) the integral of |dkappa/dt| from the base. Frames R turn at w with |w| <= O, and
|dw/dt| <= O^2 / 2, so that the acceleration of a place r(s), the integral of (R nu)'' from the
base, is at most the integral of 3/2 O^2 |nu| + 2 O |dnu/dt|; an eighth of that bounds how far a
place is from the line between where it begins and ends. By how much strains are off from straight
lines, e_kappa and e_nu (model.clearance.strain_bounds), moves it by at most the integral of e_nu
plus e_kappa times the arm's length from there to s. Both grow along the arm.

So a piece during a part is in the convex hull of four points, widened by a length.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.centreline import Centreline, Counts
from model.clearance.strain_bounds import Mask, Spread
from model.effects import NeoHookean
from model.equilibrium.newton import STAGES
from model.paths import Array
from model.transcription.collocation import gauss

# The most of a section's stretch that it may be off by.
_SHORT = 0.5


@dataclass(frozen=True, eq=False)
class Parts:
    """P parts of a motion, by the arm where each begins and ends.

    Attributes
    ----------
    lines : Centreline
        All arms that are known, joined.
    rows : (P, I)
        Which of them are those of each part: two, or one of a part that takes no time.
    known : (P,)
        Whether it is known how far strains are from straight lines.
    turned : (P, I, N + 1)
        How far tangents have turned from the base to each node [rad].
    turns_off, goes_off : (P, N)
        By how much more tangents may turn up to an element's end in between [rad], and how far
        places go off the line [m].
    swell : (P, N)
        How many times wider sections may be in between than where parts begin and end.
    """

    lines: Centreline
    rows: Counts
    known: Mask
    turned: Array
    turns_off: Array
    goes_off: Array
    swell: Array

    @classmethod
    def of(cls, lines: Centreline, rows: Counts, spread: Spread | None) -> Parts:
        """Return parts by how far strains are from straight lines; None where they take no time."""
        N, P = int(np.argmax(lines.s)), len(rows)
        turns = np.append(lines.sizes[1], 0.0).reshape(-1, N + 1)
        turned = np.cumsum(np.roll(turns, 1, axis=1) * (np.arange(N + 1) > 0), axis=1)[rows]
        none, always = np.zeros((P, N)), np.ones(P, dtype=bool)
        if spread is None:
            return cls(lines, rows, always, turned, none, none, none + 1)

        def at_stages(values: Array) -> Array:
            """Return values of the lines by part, end, stage (P, I, N stages, 3)."""
            by_line = values.reshape(-1, N + 1, STAGES, 3)[:, :-1]
            return by_line.reshape(len(by_line), -1, 3)[rows]

        def integrated(values: Array) -> Array:
            """Return integrals over the elements (P, N) of values at stages (P, N stages)."""
            return np.asarray(
                values.reshape(P, N, STAGES) @ gauss(STAGES).b * np.diff(lines.s[: N + 1])
            )

        nu_at, kappa, nu = at_stages(lines.nu), integrated(spread.kappa), integrated(spread.nu)
        turn, slide = (
            integrated(np.linalg.norm(each[:, -1] - each[:, 0], axis=2))
            for each in (at_stages(lines.kappa), nu_at)
        )
        long = integrated(np.linalg.norm(nu_at, axis=3).max(axis=1))
        swept, bent = np.cumsum(turn, axis=1), np.cumsum(kappa, axis=1)
        places = np.cumsum(1.5 * swept**2 * long + 2 * swept * slide, axis=1) / 8
        reach = np.cumsum(long + nu, axis=1)
        places += np.cumsum(nu, axis=1) + reach * bent
        places -= np.cumsum(kappa * (reach - long - nu), axis=1)
        # The share of their stretch that sections may be shorter by.
        short = spread.nu / np.maximum(nu_at[..., 0].min(axis=1), 1e-3)
        short = short.reshape(P, N, STAGES).max(axis=2)
        known = spread.known & (short < _SHORT).all(axis=1)
        rubber = lines.scene.has(NeoHookean)
        swell = 1 / np.sqrt(1 - rubber * np.minimum(short, _SHORT))
        return cls(lines, rows, known, turned, bent, places, swell)

    @property
    def elements(self) -> int:
        """How many elements an arm has."""
        return int(self.swell.shape[1])

    def pieces(self, part: Counts, element: Counts, start: Array, end: Array) -> Pieces:
        """Return pieces (K,) by their part, element, and the shares of it where they are."""
        rows = self.rows[part] * (self.elements + 1) + element[:, None]
        turned = self.turned[part, :, element][:, :, None]
        if not start.any() and (end == 1).all():
            u, (lengths, turns) = self.lines.poses[:, 4:], self.lines.sizes
            ends = np.stack([u[rows], u[rows + 1]], axis=2)
            turned = turned + np.stack([0 * turns[rows], turns[rows]], axis=2)
            return Pieces(self, part, element, start, end, ends, turned, lengths[rows])
        a, b = (np.repeat(share, rows.shape[1]) for share in (start, end))
        arguments = np.tile(rows.ravel(), 2), np.append(0 * a, a), np.append(a, b)
        at, long, swept = (np.split(each, 2) for each in self.lines.along(*arguments))
        turned = turned + np.stack([swept[0], swept[0] + swept[1]], -1).reshape(*rows.shape, 2)
        ends = np.stack(at, axis=1).reshape(*rows.shape, 2, 3)
        return Pieces(self, part, element, start, end, ends, turned, long[1].reshape(rows.shape))


@dataclass(frozen=True, eq=False)
class Pieces:
    """K pieces of an arm during parts of a motion.

    Attributes
    ----------
    of : Parts
    part, element : (K,)
        What each is a piece of.
    start, end : (K,)
        Shares of the element, from 0 to 1, where it begins and ends.
    ends : (K, I, 2, 3)
        Where these are when the part begins and ends [m].
    turned : (K, I, 2)
        How far tangents have turned from the base to there, all in all [rad].
    lengths : (K, I)
        Of it then [m].
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
        return Pieces(self.of, *at, self.ends[which], self.turned[which], self.lengths[which])

    @property
    def hull(self) -> Array:
        """The points (K, 2 I, 3) whose convex hull holds the lines between the ends [m]."""
        return self.ends.reshape(len(self.ends), -1, 3)

    @cached_property
    def middle(self) -> Array:
        """A place in the middle (K, 3) [m]."""
        return np.asarray(self.hull.mean(axis=1))

    @property
    def size(self) -> Array:
        """About how long the pieces are (K,) [m]."""
        return np.asarray(self.lengths.max(axis=1))

    @property
    def travel(self) -> Array:
        """About how far the ends travel during the part (K,) [m]."""
        way = np.linalg.norm(self.ends[:, -1] - self.ends[:, 0], axis=2).max(axis=1)
        return np.asarray(way + self.of.goes_off[self.part, self.element])

    @property
    def most_turned(self) -> Array:
        """How far the tangent may have turned at the end of each piece, at the most (K,) [rad]."""
        return np.asarray(self.turned[:, :, 1].max(axis=1) + self._more_turned)

    def may_meet(self, other: Pieces) -> Mask:
        """Return whether the arm may turn by half a turn from these to other pieces (K,)."""
        turn = (other.turned[:, :, 1] - self.turned[:, :, 0]).max(axis=1)
        return np.asarray(turn + other._more_turned >= np.pi)

    @property
    def _more_turned(self) -> Array:
        return np.asarray(self.of.turns_off[self.part, self.element])

    @property
    def radii(self) -> Array:
        """The arm's radius (K, I, 3) at both ends of each piece and in its middle [m].

        Where it jumps the larger one of both sides is that of the other piece.
        """
        rows = self.of.rows[self.part] * (self.of.elements + 1) + self.element[:, None]
        shares = np.array([self.start, (self.start + self.end) / 2, self.end])
        repeated = np.repeat(shares, rows.shape[1], axis=1)
        result = self.of.lines.radius(np.tile(rows.ravel(), 3), repeated.ravel())
        return np.moveaxis(result.reshape(3, *rows.shape), 0, 2)

    @property
    def wide(self) -> Array:
        """How far the surface may be from the hull (K,) [m].

        Along a piece the radius is a parabola, but for terms of third order.
        """
        chord = np.linalg.norm(self.ends[:, :, 1] - self.ends[:, :, 0], axis=2)
        sag = np.sqrt(np.maximum(self.lengths**2 - chord**2, 0.0)).max(axis=1) / 2
        radii = self.radii
        bent = np.abs(radii[..., 0] - 2 * radii[..., 1] + radii[..., 2])
        most = (radii.max(axis=2) + bent).max(axis=1)
        at = self.part, self.element
        return np.asarray(sag + most * self.of.swell[at] + self.of.goes_off[at])

    @property
    def places(self) -> Array:
        """Arc lengths of both ends (K, 2) [m]."""
        s, h = self.of.lines.s, np.diff(self.of.lines.s)
        shares = np.column_stack([self.start, self.end])
        return np.asarray(s[self.element, None] + shares * h[self.element, None])
