"""How fast a motion may go along its way where accelerations of strokes or of the tip are limited.

The way is straight in the tensions from waypoint to waypoint, so that each is met at rest. On a
stretch with share u of time, lengths l(u), the tip's place x(u) and b = (du/dt)^2 the limits are

    |T'| sqrt(b) <= rate      |l'| sqrt(b) <= stroke rate      |l' b' / 2 + l'' b| <= acceleration
                                                               |x' b' / 2 + x'' b| <= acceleration

linear in b and its slope but for the last, a disc in the plane of x' and x'', for which a polygon
stands. With b linear between even knots, which is a constant d2u/dt2, the least time is a linear
program: what is fastest at one place is fastest at all. Source: Verscheure, Demeulenaere, Swevers,
De Schutter, Diehl, "Time-optimal path tracking for robots: a convex optimization approach", IEEE
Transactions on Automatic Control 54 (2009).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.polynomial import chebyshev
from scipy.sparse import csr_array, diags_array, vstack

from model.errors import ConvergenceError
from model.paths import Array
from planner.trajectory.question import Rates

# Knots of a stretch; between two knots, and at least, so many instants are looked at.
_KNOTS, _BETWEEN, _LEAST = 80, 4, 200
# What b is at most where nothing limits it, in units of acceleration over change.
_FREE = 1e6
# Directions of the half polygon: outside of the disc by 2 % at most.
_DIRECTIONS = np.linspace(0.0, np.pi, 9)
# Degrees that are tried, and what their last coefficients may be, over the largest change.
_DEGREES, _ROUNDING = (8, 16, 32, 64, 128), 1e-8
_REMEDY = "somewhere between two waypoints it snaps: put waypoints where it does not"
_TINY = 1e-12
# Tensions (n_tendons,) -> lengths of the tendons, place of the tip: (n_tendons + 3,) [m].
Places = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Stretch:
    """The lengths of the tendons and the tip's place along the straight way to a waypoint.

    They are the polynomial through Chebyshev points, of a degree that is doubled until its last
    coefficients are rounding: they are smooth functions of the tensions. Source: Trefethen,
    "Approximation Theory and Approximation Practice" (2013), chapter 8.

    Attributes
    ----------
    coefficients : (degree + 1, n_tendons + 3)
        Of Chebyshev polynomials in 2 share - 1 [m].
    """

    coefficients: Array

    @classmethod
    def of(cls, places: Places, start: Array, end: Array) -> Stretch:
        """Return the stretch between tensions (n_tendons,).

        Raises ConvergenceError where it is not smooth, or the arm does not settle.
        """
        for degree in _DEGREES:
            x = chebyshev.chebpts1(degree + 1)
            values = np.array([places(start + (1 + u) / 2 * (end - start)) for u in x])
            if not np.all(np.isfinite(values)):
                raise ConvergenceError(_ROUNDING, np.inf, _REMEDY)
            fitted = chebyshev.chebfit(x, values, degree)
            if np.abs(fitted[-2:]).max() <= _ROUNDING * np.abs(fitted[1:]).max() + _TINY:
                return cls(fitted)
        raise ConvergenceError(_ROUNDING, np.inf, _REMEDY)

    def derivatives(self, share: Array, order: int = 1) -> tuple[Array, Array]:
        """Return derivatives by the share [m], at shares (K,): of lengths (K, n), of the tip."""
        of = chebyshev.chebder(self.coefficients, order, scl=2.0)
        values: Array = np.asarray(chebyshev.chebval(2 * share - 1, of).T)
        lengths, tip = np.split(values, [-3], axis=1)
        return lengths, tip


@dataclass(frozen=True, eq=False)
class TimeLaw:
    """The share of a stretch over time, at knots; in between it is a parabola.

    Attributes
    ----------
    times : (K + 1,)
        From 0 [s].
    shares : (K + 1,)
    speeds : (K + 1,)
        Of the share [1/s], 0 at both ends.
    """

    times: Array
    shares: Array
    speeds: Array

    def slower(self, factor: float) -> TimeLaw:
        """Return the law that takes so many times as long."""
        return TimeLaw(factor * self.times, self.shares, self.speeds / factor)

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Return shares, speeds [1/s] and accelerations [1/s2] (K,) at times (K,) [s]."""
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, self.times.size - 2)
        passed, rise = t - self.times[k], np.diff(self.speeds) / np.diff(self.times)
        speed = self.speeds[k] + rise[k] * passed
        return self.shares[k] + (self.speeds[k] + speed) / 2 * passed, speed, rise[k]

    @classmethod
    def steady(cls, duration: float) -> TimeLaw:
        """Return the law of a steady pace, without regard to accelerations."""
        ends = np.array([0.0, 1.0])
        return cls(duration * ends, ends, np.full(2, 1 / duration))

    def largest(self, stretch: Stretch) -> tuple[float, float, float]:
        """Return the largest stroke rate [m/s], and accelerations of strokes and tip [m/s2].

        At many instants.
        """
        count = max(_BETWEEN * (self.times.size - 1), _LEAST)
        inside = (np.arange(count) + 0.5) / count * (self.times.size - 1)
        k, passed = inside.astype(int), inside % 1
        t = self.times[k] + passed * np.diff(self.times)[k]
        share, speed, rise = self.at(np.concatenate([self.times[:1], t, self.times[1:]]))
        first, second = stretch.derivatives(share), stretch.derivatives(share, 2)
        strokes, tip = (
            one * rise[:, None] + two * speed[:, None] ** 2
            for one, two in zip(first, second, strict=True)
        )
        rate = np.abs(first[0] * speed[:, None]).max()
        return float(rate), float(np.abs(strokes).max()), float(np.linalg.norm(tip, axis=1).max())

    def used(self, stretch: Stretch, way: Array, rates: Rates) -> float:
        """Return in how many times the time all limits are kept.

        Of the way (n_tendons,) [N] from the first tensions to the last.
        """
        speed, acceleration, tip = self.largest(stretch)
        tension = float((np.abs(way) / rates.tension).max() * self.speeds.max())
        most = max(acceleration / rates.acceleration, tip / rates.tip_acceleration)
        return max(tension, speed / rates.stroke, float(np.sqrt(most)))


def fastest(stretch: Stretch, way: Array, rates: Rates) -> TimeLaw:
    """Return the law of the least time from rest to rest along a way (n_tendons,) [N]."""
    u = np.linspace(0.0, 1.0, _KNOTS + 1)
    lengths, _ = stretch.derivatives(u)
    first, second = _limited(stretch, u, rates)
    size = max(float(np.abs(first).max()), _TINY)
    A = _accelerations(first / size, second / size)
    rate = (np.abs(way) / rates.tension).max()
    stroke = np.maximum(np.abs(lengths).max(axis=1), _TINY)
    most = np.minimum((rates.stroke / stroke) ** 2, 1 / rate**2 if rate > 0 else np.inf) * size
    most[[0, -1]] = 0.0
    ends = np.column_stack([np.zeros(u.size), np.minimum(most, _FREE)])
    solution = scipy.optimize.linprog(
        -np.ones(u.size), csr_array(vstack([A, -A])), np.ones(2 * A.shape[0]), bounds=ends
    )
    speeds = np.sqrt(np.maximum(solution.x, 0.0) / size)
    times = np.concatenate([[0.0], np.cumsum(2 / _KNOTS / (speeds[1:] + speeds[:-1]))])
    law = TimeLaw(times, u, speeds)
    # Between knots a limit may be passed by a little.
    return law.slower(max(law.used(stretch, way, rates), 1.0))


def _limited(stretch: Stretch, u: Array, rates: Rates) -> tuple[Array, Array]:
    """Return first and second derivatives (K, m) of all whose accelerations have limits.

    Over these limits: of lengths, and of the tip along the directions of a polygon in the plane of
    its tangent and curvature.
    """
    (lengths, tip), (bent, turned) = stretch.derivatives(u), stretch.derivatives(u, 2)
    speed = np.linalg.norm(tip, axis=1)
    along = np.sum(turned * tip, axis=1) / np.maximum(speed, _TINY)
    across = np.sqrt(np.maximum(np.sum(turned**2, axis=1) - along**2, 0.0))
    cos, sin = np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)
    first = [lengths / rates.acceleration, speed[:, None] * cos / rates.tip_acceleration]
    whole = along[:, None] * cos + across[:, None] * sin
    return np.hstack(first), np.hstack([bent / rates.acceleration, whole / rates.tip_acceleration])


def _accelerations(first: Array, second: Array) -> csr_array:
    """Return what b at the knots (K + 1,) gives at both ends of each interval.

    By derivatives (K + 1, m) by the share there.
    """
    parts, shape = [], (_KNOTS, _KNOTS + 1)
    for own1, own2 in zip(first.T * _KNOTS / 2, second.T, strict=True):
        for before, after in (
            (own2[:-1] - own1[:-1], own1[:-1]),
            (-own1[1:], own1[1:] + own2[1:]),
        ):
            parts.append(diags_array([before, after], offsets=[0, 1], shape=shape))
    return csr_array(vstack(parts))
