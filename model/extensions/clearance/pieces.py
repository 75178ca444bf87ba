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
lines, e_kappa and e_nu (see Spread), moves it by at most the integral of e_nu
plus e_kappa times the arm's length from there to s. Both grow along the arm.

So a piece during a part is in the convex hull of four points, widened by a length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from octoplan.model.centreline import Centreline, Counts
from octoplan.model.effects import NeoHookean
from octoplan.model.equilibrium.newton import STAGES
from octoplan.model.paths import Array, Mask
from octoplan.model.rod.collocation import gauss


class Spread(NamedTuple):
    """By how much strains may be off from a straight line during P parts of a way.

    Attributes
    ----------
    kappa, nu : (P, N)
        Of curvature [1/m] and tangent [-] at N stages, as lengths of vectors.
    known : (P,)
        Whether that holds; else the part is too long to tell.
    """

    kappa: Array
    nu: Array
    known: Mask


class Pieces(NamedTuple):
    """K pieces of an arm during parts of a motion, known where each part begins and ends.

    Attributes
    ----------
    ends : (K, I, 2, 3)
        Where they begin and end [m].
    turned : (K, I, 2)
        How far tangents have turned from the base to there, all in all [rad].
    turns_off : (K,)
        By how much more they may have turned in between [rad].
    radii : (K, I, 3)
        The arm's radius at both ends and in the middle [m]. Where it jumps the larger one of both
        sides is that of the other piece.
    wide : (K,)
        How far the surface may be from the hull of the ends [m].
    s : (K, 2)
        Arc lengths of both ends [m].
    size, travel : (K,)
        About how long pieces are, and how far their ends travel during the part [m].
    """

    ends: Array
    turned: Array
    turns_off: Array
    radii: Array
    wide: Array
    s: Array
    size: Array
    travel: Array

    def some(self, which: Mask) -> Pieces:
        """Return some of the pieces."""
        return Pieces._make(each[which] for each in self)

    @property
    def hull(self) -> Array:
        """The points (K, 2 I, 3) whose convex hull holds the lines between the ends [m]."""
        return self.ends.reshape(len(self.ends), -1, 3)


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
        none = np.zeros((P, N))
        if spread is None:
            return cls(lines, rows, np.ones(P, dtype=bool), turned, none, none, none + 1)

        def integrated(values: Array) -> Array:
            """Return integrals over the elements (P, N) of values at their stages."""
            return np.asarray(
                values.reshape(P, N, STAGES) @ gauss(STAGES).b * np.diff(lines.s[: N + 1])
            )

        # By part, end, element and stage (P, I, N, stages, 3).
        kappa_at, nu_at = (
            each.reshape(-1, N + 1, STAGES, 3)[rows, :-1] for each in (lines.kappa, lines.nu)
        )
        kappa, nu = integrated(spread.kappa), integrated(spread.nu)
        turn, slide = (
            integrated(np.linalg.norm(each[:, -1] - each[:, 0], axis=3))
            for each in (kappa_at, nu_at)
        )
        long = integrated(np.linalg.norm(nu_at, axis=4).max(axis=1))
        swept, bent = np.cumsum(turn, axis=1), np.cumsum(kappa, axis=1)
        places = np.cumsum(1.5 * swept**2 * long + 2 * swept * slide, axis=1) / 8
        reach = np.cumsum(long + nu, axis=1)
        places += np.cumsum(nu, axis=1) + reach * bent
        places -= np.cumsum(kappa * (reach - long - nu), axis=1)
        # What sections keep of their stretch at the least.
        kept = 1 - spread.nu.reshape(P, N, STAGES) / np.maximum(nu_at[..., 0].min(axis=1), 1e-3)
        kept = kept.min(axis=2)
        known = spread.known & (kept > 0).all(axis=1)
        rubber = known[:, None] & lines.scene.has(NeoHookean)
        swell = 1 / np.sqrt(np.where(rubber, kept, 1.0))
        return cls(lines, rows, known, turned, bent, places, swell)

    def pieces(self, part: Counts, element: Counts, start: Array, end: Array) -> Pieces:
        """Return pieces (K,) by their part, element, and the shares of it where they are.

        Along a piece the radius is a parabola, but for terms of third order.
        """
        lines = self.lines
        rows = self.rows[part] * self.turned.shape[2] + element[:, None]
        shares = np.array([start, (start + end) / 2, end]).repeat(self.rows.shape[1], axis=1)
        a, b = shares[0], shares[2]
        if not start.any() and (end == 1).all():
            u, (lengths, turns) = lines.poses[:, 4:], lines.sizes
            ends, long = np.stack([u[rows], u[rows + 1]], axis=2), lengths[rows]
            turned = np.stack([0 * turns[rows], turns[rows]], axis=2)
        else:
            arguments = np.tile(rows.ravel(), 2), np.append(0 * a, a), np.append(a, b)
            at, lengths, turns = lines.along(*arguments)
            ends = np.moveaxis(at.reshape(2, *rows.shape, 3), 0, 2)
            long = lengths.reshape(2, *rows.shape)[1]
            turned = np.moveaxis(turns.reshape(2, *rows.shape).cumsum(axis=0), 0, 2)
        turned = turned + self.turned[part, :, element][:, :, None]
        radii = lines.radius(np.tile(rows.ravel(), 3), shares.ravel())
        radii = np.moveaxis(radii.reshape(3, *rows.shape), 0, 2)
        off, chord = (
            self.goes_off[part, element],
            np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2),
        )
        sag = np.sqrt(np.maximum(long**2 - chord**2, 0.0)).max(axis=1) / 2
        bent = np.abs(radii[..., 0] - 2 * radii[..., 1] + radii[..., 2])
        wide = sag + (radii.max(axis=2) + bent).max(axis=1) * self.swell[part, element] + off
        travel = np.linalg.norm(ends[:, -1] - ends[:, 0], axis=2).max(axis=1) + off
        s = lines.s[element, None] + np.array([start, end]).T * np.diff(lines.s)[element, None]
        turns_off = self.turns_off[part, element]
        return Pieces(ends, turned, turns_off, radii, wide, s, long.max(axis=1), travel)
