"""Pieces of an arm during parts of a motion, and bounds of the positions.

Along the arm: a curve of length l between two points at a distance c stays within
sqrt(l^2 - c^2) / 2 of the chord. The distances of each point from both ends add up to at most l,
and an ellipsoid with the ends as foci has this semi-axis.

In time: suppose that curvature kappa and tangent nu, per unit reference length in the local frame,
change linearly during a part, with t from 0 to 1. Let O(s) be the integral of |dkappa/dt| from the
base. The angular velocity w of the frames R satisfies |w| <= O and |dw/dt| <= O^2 / 2. The
acceleration of a point r(s) is the integral of (R nu)'' from the base, and thus at most the
integral of 3/2 O^2 |nu| + 2 O |dnu/dt|. One eighth of this bounds the distance of the point from
the straight line between the positions at the ends of the part. Deviations e_kappa and e_nu of the
strains from linear interpolation (see DeviationBound) move the point by at most the integral of
e_nu plus e_kappa times the length of the arm from there to s. Both bounds increase along the arm.

Therefore a piece during a part lies in the convex hull of four points, extended by a distance.
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


class DeviationBound(NamedTuple):
    """Bound of the deviation of strains from linear interpolation, during P parts of a motion.

    Attributes
    ----------
    kappa, nu : (P, N)
        Bounds for curvature [1/m] and tangent [-] at N stages, as norms of vectors.
    known : (P,)
        Whether the bounds apply; otherwise the part is too long.
    """

    kappa: Array
    nu: Array
    known: Mask


class Pieces(NamedTuple):
    """K pieces of an arm during parts of a motion, with values at the I ends of each part.

    Attributes
    ----------
    ends : (K, I, 2, 3)
        Positions of both ends of the pieces [m].
    turned : (K, I, 2)
        Total rotation of the tangent from the base to both ends [rad].
    turns_off : (K,)
        Bound of additional rotation of the tangent during the part [rad].
    radii : (K, I, 3)
        Radius of the arm at both ends and in the middle [m]. At a discontinuity, the larger radius
        may belong to the neighbouring piece.
    wide : (K,)
        Bound of the distance of the surface from the hull of the ends [m].
    s : (K, 2)
        Arc lengths of both ends [m].
    size, travel : (K,)
        Approximate length of the pieces, and displacement of the ends during the part [m].
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
        """Return a selection of the pieces."""
        return Pieces._make(each[which] for each in self)

    @property
    def hull(self) -> Array:
        """Points (K, 2 I, 3) whose convex hull contains the chords [m]."""
        return self.ends.reshape(len(self.ends), -1, 3)


@dataclass(frozen=True, eq=False)
class Parts:
    """P parts of a motion, with the arms at the ends of each part.

    Attributes
    ----------
    lines : Centreline
        All arms, joined.
    rows : (P, I)
        Indices of the arms of each part: two, or one for a part without duration.
    known : (P,)
        Whether bounds of the deviation of strains apply.
    turned : (P, I, N + 1)
        Total rotation of the tangent from the base to each node [rad].
    turns_off, goes_off : (P, N)
        Bounds, up to the end of each element, of additional rotation of the tangent during the part
        [rad], and of the deviation of points from the straight line [m].
    swell : (P, N)
        Bound of the ratio of cross-section widths during the part and at the ends.
    """

    lines: Centreline
    rows: Counts
    known: Mask
    turned: Array
    turns_off: Array
    goes_off: Array
    swell: Array

    @classmethod
    def of(cls, lines: Centreline, rows: Counts, deviation: DeviationBound | None) -> Parts:
        """Return parts with bounds of the deviation of strains, if the parts have a duration."""
        N = int(np.argmax(lines.s))
        P = len(rows)
        turns = np.append(lines.sizes[1], 0.0).reshape(-1, N + 1)
        turned = np.cumsum(np.roll(turns, 1, axis=1) * (np.arange(N + 1) > 0), axis=1)[rows]
        none = np.zeros((P, N))
        if deviation is None:
            return cls(lines, rows, np.ones(P, dtype=bool), turned, none, none, none + 1)

        def integrated(values: Array) -> Array:
            """Return integrals over the elements (P, N) of values at the stages."""
            return np.asarray(
                values.reshape(P, N, STAGES) @ gauss(STAGES).b * np.diff(lines.s[: N + 1])
            )

        # Values by part, end, element and stage (P, I, N, stages, 3).
        kappa_at, nu_at = (
            each.reshape(-1, N + 1, STAGES, 3)[rows, :-1] for each in (lines.kappa, lines.nu)
        )
        kappa = integrated(deviation.kappa)
        nu = integrated(deviation.nu)
        turn, slide = (
            integrated(np.linalg.norm(each[:, -1] - each[:, 0], axis=3))
            for each in (kappa_at, nu_at)
        )
        long = integrated(np.linalg.norm(nu_at, axis=4).max(axis=1))
        swept = np.cumsum(turn, axis=1)
        bent = np.cumsum(kappa, axis=1)
        places = np.cumsum(1.5 * swept**2 * long + 2 * swept * slide, axis=1) / 8
        reach = np.cumsum(long + nu, axis=1)
        places += np.cumsum(nu, axis=1) + reach * bent
        places -= np.cumsum(kappa * (reach - long - nu), axis=1)
        # Lower bound of the stretch during the part, relative to the smaller end value.
        relative = deviation.nu.reshape(P, N, STAGES) / np.maximum(nu_at[..., 0].min(axis=1), 1e-3)
        kept = (1 - relative).min(axis=2)
        known = deviation.known & (kept > 0).all(axis=1)
        rubber = known[:, None] & lines.scene.has(NeoHookean)
        swell = 1 / np.sqrt(np.where(rubber, kept, 1.0))
        return cls(lines, rows, known, turned, bent, places, swell)

    def pieces(self, part: Counts, element: Counts, start: Array, end: Array) -> Pieces:
        """Return pieces (K,) from parts, elements, and the shares that delimit the pieces.

        Along a piece, the radius is a parabola except for terms of third order.
        """
        lines = self.lines
        rows = self.rows[part] * self.turned.shape[2] + element[:, None]
        shares = np.array([start, (start + end) / 2, end]).repeat(self.rows.shape[1], axis=1)
        a = shares[0]
        b = shares[2]
        if not start.any() and (end == 1).all():
            u = lines.poses[:, 4:]
            lengths, turns = lines.sizes
            ends = np.stack([u[rows], u[rows + 1]], axis=2)
            long = lengths[rows]
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
        off = self.goes_off[part, element]
        chord = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
        sag = np.sqrt(np.maximum(long**2 - chord**2, 0.0)).max(axis=1) / 2
        bent = np.abs(radii[..., 0] - 2 * radii[..., 1] + radii[..., 2])
        wide = sag + (radii.max(axis=2) + bent).max(axis=1) * self.swell[part, element] + off
        travel = np.linalg.norm(ends[:, -1] - ends[:, 0], axis=2).max(axis=1) + off
        s = lines.s[element, None] + np.array([start, end]).T * np.diff(lines.s)[element, None]
        turns_off = self.turns_off[part, element]
        return Pieces(ends, turned, turns_off, radii, wide, s, long.max(axis=1), travel)
