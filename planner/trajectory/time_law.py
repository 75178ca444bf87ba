"""When the arm is where on its way: the least time that rates and accelerations allow.

The way is straight in the tensions from waypoint to waypoint. Where accelerations of strokes or of
the tip are limited each is met at rest. On a stretch with share u of time, lengths l(u), the tip's
place x(u) and b = (du/dt)^2 the limits are

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
from itertools import pairwise

import numpy as np
import scipy
from numpy.polynomial import chebyshev
from scipy.sparse import csr_array, diags_array, eye_array, vstack

from model.errors import ConvergenceError
from model.paths import Array
from planner.trajectory.question import Question, Rates

# Knots of a stretch, and instants at which it is looked at.
_KNOTS, _INSTANTS = 80, 320
# What b is at most where nothing limits it, in units of acceleration over change.
_FREE = 1e6
# Directions of the half polygon: outside of the disc by 2 % at most.
_DIRECTIONS = np.linspace(0.0, np.pi, 9)
# Degrees that are tried, and what their last coefficients may be, over the largest change.
_DEGREES, _ROUNDING = (8, 16, 32, 64, 128), 1e-8
_REMEDY = "somewhere between two waypoints it snaps: put waypoints where it does not"
_TINY = 1e-12
# What a stretch takes on which nothing limits the pace [s].
_INSTANT = 1e-9
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
                break
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

    @classmethod
    def steady(cls, duration: float) -> TimeLaw:
        """Return the law of a steady pace, without regard to accelerations."""
        ends = np.array([0.0, 1.0])
        return cls(duration * ends, ends, np.full(2, 1 / duration))

    def slower(self, factor: float) -> TimeLaw:
        """Return the law that takes so many times as long, no less."""
        factor = max(factor, 1.0)
        return TimeLaw(factor * self.times, self.shares, self.speeds / factor)

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Return shares, speeds [1/s] and accelerations [1/s2] (K,) at times (K,) [s]."""
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, self.times.size - 2)
        passed, rise = t - self.times[k], np.diff(self.speeds) / np.diff(self.times)
        speed = self.speeds[k] + rise[k] * passed
        return self.shares[k] + (self.speeds[k] + speed) / 2 * passed, speed, rise[k]

    def largest(self, stretch: Stretch) -> tuple[float, float, float]:
        """Return the largest stroke rate [m/s], and accelerations of strokes and tip [m/s2].

        At many instants.
        """
        inside = (np.arange(_INSTANTS) + 0.5) / _INSTANTS * (self.times.size - 1)
        t = np.interp(inside, np.arange(self.times.size), self.times)
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
    first, second = _limited(stretch, u, rates)
    size = max(float(np.abs(first).max()), _TINY)
    # What b at the knots gives at both ends of each interval.
    start, end = (eye_array(_KNOTS, _KNOTS + 1, k=k) for k in (0, 1))
    slope = (end - start) * (_KNOTS / 2)
    pairs = list(zip((first / size).T, (second / size).T, strict=True))
    A = [diags_array(one[:-1]) @ slope + diags_array(two[:-1]) @ start for one, two in pairs]
    A += [diags_array(one[1:]) @ slope + diags_array(two[1:]) @ end for one, two in pairs]
    limited = csr_array(vstack([*A, *(-each for each in A)]))
    stroke = np.abs(stretch.derivatives(u)[0]).max(axis=1) / rates.stroke
    fast = np.maximum(stroke, (np.abs(way) / rates.tension).max())
    most = np.minimum(size / np.maximum(fast, _TINY) ** 2, _FREE)
    most[[0, -1]] = 0.0
    bounds = np.column_stack([np.zeros(u.size), most])
    ones = np.ones(limited.shape[0])
    solution = scipy.optimize.linprog(-np.ones(u.size), limited, ones, bounds=bounds)
    speeds = np.sqrt(np.maximum(solution.x, 0.0) / size)
    times = np.concatenate([[0.0], np.cumsum(2 / _KNOTS / (speeds[1:] + speeds[:-1]))])
    law = TimeLaw(times, u, speeds)
    # Between knots a limit may be passed by a little.
    return law.slower(law.used(stretch, way, rates))


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


@dataclass(frozen=True, eq=False)
class Timed:
    """Waypoints, straight ways between them, and the pace on each. Numbers only.

    Attributes
    ----------
    tensions : (N + 1, n_tendons)
        At the waypoints [N], the first of which is where the motion begins.
    laws : tuple of N TimeLaw
    stretches : tuple of N Stretch
        Where strokes or accelerations are limited; else none.
    """

    tensions: Array
    laws: tuple[TimeLaw, ...]
    stretches: tuple[Stretch, ...] = ()

    @classmethod
    def of(cls, question: Question, tensions: Array, met: tuple[int, ...]) -> Timed:
        """Return the way at the pace that limits allow, whose targets are met at some waypoints.

        Where times are given, the stretches up to a target share its time in proportion to the
        least that they take, or to how tensions change where nothing limits that.
        """
        rates, ways, stretches = question.rates, np.diff(tensions, axis=0), list[Stretch]()
        change = np.abs(ways).max(axis=1)
        free = _INSTANT * np.maximum(change / max(float(change.max()), _INSTANT), 1e-3)
        least = np.maximum((np.abs(ways) / rates.tension).max(axis=1), free)
        laws = [TimeLaw.steady(duration) for duration in least]
        if rates.of_strokes or rates.at_rest:
            places = question.places()
            stretches = [Stretch.of(places, *ends) for ends in pairwise(tensions)]
            laws = [
                fastest(stretch, way, rates)
                if rates.at_rest
                else law.slower(law.used(stretch, way, rates))
                for law, stretch, way in zip(laws, stretches, ways, strict=True)
            ]
        if question.steps is not None:
            taken = np.array([law.times[-1] for law in laws])
            group = np.searchsorted(met, np.arange(1, taken.size + 1))
            spare = question.steps / np.bincount(group, taken)
            laws = [law.slower(spare[k]) for law, k in zip(laws, group, strict=True)]
        return cls(tensions, tuple(laws), tuple(stretches))

    @property
    def steady(self) -> Timed:
        """The same way with a second for each stretch."""
        return Timed(self.tensions, (TimeLaw.steady(1.0),) * len(self.laws))

    @property
    def largest(self) -> Array:
        """The largest stroke rate [m/s], accelerations of strokes and of the tip [m/s2] (3,).

        0 where none of these is limited.
        """
        pairs = zip(self.laws, self.stretches, strict=False)
        each = np.array([law.largest(stretch) for law, stretch in pairs]).reshape(-1, 3)
        return np.asarray(each.max(axis=0, initial=0.0))

    @property
    def starts(self) -> Array:
        """When each waypoint is reached (N + 1,) [s], from 0."""
        return np.concatenate([[0.0], np.cumsum([law.times[-1] for law in self.laws])])

    @property
    def knots(self) -> Array:
        """The times of waypoints and, where the pace changes on the way, between them (K,) [s]."""
        parts = [start + law.times[1:] for start, law in zip(self.starts, self.laws, strict=False)]
        return np.concatenate([[0.0], *parts])

    def at(self, t: Array) -> Array:
        """Return the tensions (M, n_tendons) at times (M,) [s]."""
        which = np.clip(np.searchsorted(self.starts, t, side="right") - 1, 0, len(self.laws) - 1)
        share = np.zeros((t.size, 1))
        for k in np.unique(which):
            values = which == k
            share[values, 0] = self.laws[k].at(t[values] - self.starts[k])[0].clip(0.0, 1.0)
        return np.asarray(self.tensions[which] + share * np.diff(self.tensions, axis=0)[which])

    def reaches(self, k: int, share: float) -> float:
        """Return when a share of a stretch is passed [s]."""
        law = self.laws[k]
        return float(self.starts[k] + np.interp(share, law.shares, law.times))
