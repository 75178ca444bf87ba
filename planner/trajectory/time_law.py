"""How fast a motion may go along its way where accelerations of strokes are limited.

The way is straight in the tensions from waypoint to waypoint, so that each is met at rest. On a
stretch with share u of time, lengths l(u) and b = (du/dt)^2 the limits are

    |T'| sqrt(b) <= rate      |l'| sqrt(b) <= stroke rate      |l' b' / 2 + l'' b| <= acceleration

linear in b and its slope. With b linear between even knots, which is a constant d2u/dt2, the least
time is a linear program: what is fastest at one place is fastest at all. Source: Verscheure,
Demeulenaere, Swevers, De Schutter, Diehl, "Time-optimal path tracking for robots: a convex
optimization approach", IEEE Transactions on Automatic Control 54 (2009).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from scipy.sparse import csr_array, diags_array, vstack

from model.paths import Array
from planner.trajectory.asked import Rates
from planner.trajectory.strokes import Stretch

# Knots of a stretch; between two knots, and at least, so many instants are looked at.
_KNOTS, _BETWEEN, _LEAST = 80, 4, 200
# What b is at most where nothing limits it, in units of acceleration over change.
_FREE = 1e6


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

    def stroke_rates(self, stretch: Stretch) -> tuple[float, float]:
        """Return the largest rate [m/s] and acceleration [m/s2] of a stroke, at many instants."""
        count = max(_BETWEEN * (self.times.size - 1), _LEAST)
        inside = (np.arange(count) + 0.5) / count * (self.times.size - 1)
        k, passed = inside.astype(int), inside % 1
        t = self.times[k] + passed * np.diff(self.times)[k]
        share, speed, rise = self.at(np.concatenate([t, self.times[1:-1]]))
        first, second = stretch.derivatives(share), stretch.derivatives(share, 2)
        bent = second * speed[:, None] ** 2
        most = np.abs(first * rise[:, None] + bent).max()
        ends = stretch.derivatives(np.array([0.0, 1.0])) * self.at(self.times[[0, -1]])[1][:, None]
        rate = max(float(np.abs(first * speed[:, None]).max()), float(np.abs(ends).max()))
        return rate, float(most)

    def used(self, stretch: Stretch, way: Array, rates: Rates) -> float:
        """Return in how many times the time all limits are kept.

        Of the way (n_tendons,) [N] from the first tensions to the last.
        """
        speed, acceleration = self.stroke_rates(stretch)
        tension = float((np.abs(way) / rates.tension).max() * self.speeds.max())
        return max(tension, speed / rates.stroke, float(np.sqrt(acceleration / rates.acceleration)))


def fastest(stretch: Stretch, way: Array, rates: Rates) -> TimeLaw:
    """Return the law of the least time from rest to rest along a way (n_tendons,) [N]."""
    u = np.linspace(0.0, 1.0, _KNOTS + 1)
    l1 = stretch.derivatives(u)
    size = np.maximum(np.abs(l1).max(axis=1), 1e-12)
    unit = rates.acceleration / size.max()
    A = _accelerations(l1 / size.max(), stretch.derivatives(u, 2) / size.max())
    rate = (np.abs(way) / rates.tension).max()
    most = np.minimum((rates.stroke / size) ** 2, 1 / rate**2 if rate > 0 else np.inf) / unit
    most[[0, -1]] = 0.0
    ends = np.column_stack([np.zeros(u.size), np.minimum(most, _FREE)])
    found = scipy.optimize.linprog(
        -np.ones(u.size), csr_array(vstack([A, -A])), np.ones(2 * A.shape[0]), bounds=ends
    )
    speeds = np.sqrt(np.maximum(found.x, 0.0) * unit)
    times = np.concatenate([[0.0], np.cumsum(2 / _KNOTS / (speeds[1:] + speeds[:-1]))])
    law = TimeLaw(times, u, speeds)
    # Between knots a limit may be passed by a little.
    return law.slower(max(law.used(stretch, way, rates), 1.0))


def _accelerations(l1: Array, l2: Array) -> csr_array:
    """Return what b at the knots (K + 1,) gives at both ends of each interval.

    By derivatives (K + 1, n_tendons) of the lengths by the share there.
    """
    parts, shape = [], (_KNOTS, _KNOTS + 1)
    for own1, own2 in zip(l1.T * _KNOTS / 2, l2.T, strict=True):
        for before, after in (
            (own2[:-1] - own1[:-1], own1[:-1]),
            (-own1[1:], own1[1:] + own2[1:]),
        ):
            parts.append(diags_array([before, after], offsets=[0, 1], shape=shape))
    return csr_array(vstack(parts))
