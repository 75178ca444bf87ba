"""Time law of a motion: the minimal time that limits of rates and accelerations allow.

The path is straight in the tensions from waypoint to waypoint. If accelerations of strokes or of
the tip are limited, the motion stops at each waypoint. On a stretch with parameter u in [0, 1],
tendon lengths l(u), tip position x(u) and b = (du/dt)^2, the limits are

    |T'| sqrt(b) <= rate      |l'| sqrt(b) <= stroke rate      |l' b' / 2 + l'' b| <= acceleration
                                                               |x' b' / 2 + x'' b| <= acceleration

The limits are linear in b and b', except for the last one, a second-order cone. With b piecewise
linear on uniform knots, d2u/dt2 is piecewise constant, and minimal time is a conic program: the
largest b at one knot is the largest at all knots. Source: Verscheure, Demeulenaere, Swevers, De
Schutter, Diehl, "Time-optimal path tracking for robots: a convex optimization approach", IEEE
Transactions on Automatic Control 54 (2009).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import clarabel
import numpy as np
from numpy.polynomial import chebyshev
from scipy.interpolate import PPoly

from octoplan.model.forward import FINEST_ACCURACY
from octoplan.model.paths import Array
from octoplan.model.support.errors import ConvergenceError
from octoplan.planner.extensions.conic import Cone, conic_program
from octoplan.planner.extensions.trajectory.question import Question, Rates, Waypoint

# Number of intervals between the knots of a stretch.
_KNOTS = 80
# Number of instants per stretch at which rates and accelerations are evaluated.
INSTANTS = 4 * _KNOTS
# Polynomial degrees of a stretch, in the order of trial.
_DEGREES = (8, 16, 32, 64, 128)
# Tolerance of the last polynomial coefficients, over the largest change; also the duration of a
# stretch without limits [s].
_ROUNDING = 1e-8
# Tensions (n_tendons,) -> tendon lengths and tip position: (n_tendons + 3,) [m].
Places = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Stretch:
    """Tendon lengths and tip position along the straight path to a waypoint.

    Both are polynomial interpolants at Chebyshev points, whose degree is doubled until the last
    coefficients are rounding errors; without tendon friction, both are smooth functions of the
    tensions. Source: Trefethen, "Approximation Theory and Approximation Practice" (2013),
    chapter 8.

    Attributes
    ----------
    change : (n_tendons,)
        Final minus initial tensions [N].
    coefficients : (degree + 1, n_tendons + 3)
        Coefficients of Chebyshev polynomials in 2 u - 1 [m].
    """

    change: Array
    coefficients: Array

    @classmethod
    def of(
        cls, places: Places, start: Array, end: Array, within: float = 0.0, at_last: float = 0.0
    ) -> Stretch:
        """Interpolate between tensions (n_tendons,), to the tolerance `within` or to rounding [m].

        The tolerance of the largest degree is `at_last` [m], because tendon friction makes the
        second derivative jump if a curvature changes sign. Raises ConvergenceError if the arm
        jumps or does not settle on the path.
        """
        for degree in _DEGREES:
            x = chebyshev.chebpts1(degree + 1)
            values = np.array([places(start + (1 + u) / 2 * (end - start)) for u in x])
            if not np.isfinite(values).all():
                break
            fitted = chebyshev.chebfit(x, values, degree)
            change = np.abs(fitted[1:]).max()
            size = np.abs(fitted).max()
            allowed = at_last if degree == _DEGREES[-1] else 0.0
            # If the arm hardly moves, positions change by the accuracy of settle.
            allowed = max(allowed, within, _ROUNDING * change + FINEST_ACCURACY * size)
            if np.abs(fitted[-2:]).max() <= allowed:
                return cls(end - start, fitted)
        remedy = "somewhere between two waypoints it snaps: put waypoints where it does not"
        raise ConvergenceError(_ROUNDING, np.inf, remedy)

    def derivatives(self, share: Array) -> list[Array]:
        """Return first and second derivatives with respect to u (K, n_tendons + 3) [m]."""
        each = (chebyshev.chebder(self.coefficients, order, scl=2.0) for order in (1, 2))
        return [np.asarray(chebyshev.chebval(2 * share - 1, one).T) for one in each]

    def largest(self, law: PPoly) -> Array:
        """Return the largest stroke rate [m/s] and accelerations of strokes and tip [m/s2] (3,).

        The time law u(t) is evaluated at INSTANTS instants and at the knots.
        """
        knots = np.arange(law.x.size)
        inside = (np.arange(INSTANTS) + 0.5) / INSTANTS * knots[-1]
        t = np.interp(np.concatenate([knots, inside]), knots, law.x)
        first, second = self.derivatives(law(t))
        speed = law(t, 1)[:, None]
        rise = law(t, 2)[:, None]
        accelerations = first * rise + second * speed**2
        tip = np.linalg.norm(accelerations[:, -3:], axis=1)
        largest = [np.abs(each[:, :-3]).max() for each in (first * speed, accelerations)]
        return np.array([*largest, tip.max()])

    def kept(self, law: PPoly, rates: Rates) -> PPoly:
        """Return the time law, slowed down to satisfy the limits."""
        tension = (np.abs(self.change) / rates.tension).max() * fastest_pace(law).max()
        rate, *accelerations = self.largest(law) / rates.of_places
        return _stretched(law, max(1.0, tension, rate, np.sqrt(max(accelerations))))


def _paced(shares: Array, speeds: Array) -> PPoly:
    """Return the time law through u (K + 1,) with piecewise linear speeds [1/s]."""
    steps = 2 * np.diff(shares) / (speeds[1:] + speeds[:-1])
    rise = np.diff(speeds) / (2 * steps)
    times = np.concatenate([[0.0], np.cumsum(steps)])
    return PPoly(np.array([rise, speeds[:-1], shares[:-1]]), times)


def _stretched(law: PPoly, factor: float) -> PPoly:
    """Return the time law slowed down by a factor."""
    return PPoly(law.c / factor ** np.array([[2], [1], [0]]), law.x * factor)


def fastest_pace(law: PPoly) -> Array:
    """Return the largest speed in each interval (K,) of a time law [1/s], at one of the ends."""
    return np.asarray(np.maximum(law.c[1], law.c[1] + 2 * law.c[0] * np.diff(law.x)))


def fastest(stretch: Stretch, rates: Rates) -> PPoly:
    """Return the time law of minimal time on a stretch, from rest to rest.

    Raises ConvergenceError if the conic program has no solution.
    """
    u = np.linspace(0.0, 1.0, _KNOTS + 1)
    derivatives = np.stack(stretch.derivatives(u))
    limits = np.repeat([rates.acceleration, rates.tip_acceleration], [stretch.change.size, 3])
    size = max(float(np.abs(derivatives / limits).max()), _ROUNDING)
    # Matrices from b at the interior knots to b at all knots, and to b' in each interval.
    b = np.eye(_KNOTS + 1)[:, 1:-1]
    slope = np.diff(b, axis=0) * (_KNOTS / 2)
    first, second = derivatives[..., None] / (size * limits)[:, None]
    begin = slice(_KNOTS)
    end = slice(1, None)
    accelerations = np.vstack(
        [first[at] * slope[:, None] + second[at] * b[at][:, None] for at in (begin, end)]
    )
    lengths = accelerations[:, :-3].reshape(-1, b.shape[1])
    tip = accelerations[:, -3:]
    tension = (np.abs(stretch.change) / rates.tension).max()
    fast = np.maximum(np.abs(derivatives[0, 1:-1, :-3]).max(axis=1) / rates.stroke, tension)
    # The lower bound limits b if nothing else does: the stretch then takes an instant.
    bounded = np.diag(np.maximum(fast**2 / size, _ROUNDING))
    positive = np.vstack([np.eye(fast.size), -bounded, -lengths, lengths])
    offsets = np.repeat([0.0, 1.0], [fast.size, fast.size + 2 * len(lengths)])
    cones: list[Cone] = [(clarabel.NonnegativeConeT, positive, offsets)]
    for each in np.pad(tip, ((0, 0), (1, 0), (0, 0))):
        cones.append((clarabel.SecondOrderConeT, each, np.eye(4)[0]))
    solution = conic_program(0 * bounded, -np.ones(fast.size), cones)
    if solution is None:
        raise ConvergenceError(_ROUNDING, np.inf, "limits of accelerations that are less uneven")
    speeds = np.sqrt(np.maximum(solution[0], 0.0) / size)
    # Limits are enforced at knots: slow down if violated in between.
    return stretch.kept(_paced(u, np.pad(speeds, 1)), rates)


@dataclass(frozen=True, eq=False)
class Timed:
    """Waypoints, straight paths in between, and the progress over time.

    Attributes
    ----------
    controls : (N + 1, n_tendons)
        Tensions at the waypoints [N], followed by joint values of the base if any; the first row is
        the start of the motion.
    met : tuple of int
        Index of the waypoint that meets each target.
    starts : (N + 1,)
        Times of the waypoints [s], from 0.
    progress : PPoly
        Number of waypoints passed plus u of the current stretch, over time: 0 to N.
    largest : (3,)
        Largest stroke rate [m/s] and accelerations of strokes and tip [m/s2]; 0 if none is
        limited.
    """

    controls: Array
    met: tuple[int, ...]
    starts: Array
    progress: PPoly
    largest: Array

    @classmethod
    def of(cls, question: Question, waypoints: Sequence[Waypoint]) -> Timed:
        """Return the fastest motion through waypoints within the limits.

        If times are prescribed, the stretches up to a target share its duration in proportion to
        their minimal durations, or to the waypoints' fractions if no limit determines these.
        """
        start = question.start_controls
        controls = np.vstack([start, *(waypoint.controls for waypoint in waypoints)])
        met = tuple(k for k, waypoint in enumerate(waypoints, start=1) if waypoint.targets)
        rates = question.rates
        steps = question.steps
        stretches = list[Stretch]()
        least = (np.abs(np.diff(controls, axis=0)) / question.control_rates).max(axis=1)
        fractions = np.array([waypoint.fraction for waypoint in waypoints])
        speeds = 1 / np.maximum(least, _ROUNDING * fractions)
        laws = [_paced(np.array([0.0, 1.0]), np.full(2, speed)) for speed in speeds]
        if np.isfinite(rates.of_places).any():
            lines = question.lines()

            def places(T: Array) -> Array:
                line = lines(T)
                tip = np.full(3, np.nan) if line is None else line.poses[-1, 4:]
                return np.concatenate([lines.lengths(T), tip])

            accuracy = question.accuracy * question.arm.length
            stretches = [Stretch.of(places, *ends, at_last=accuracy) for ends in pairwise(controls)]
            laws = [
                fastest(stretch, rates) if rates.at_rest else stretch.kept(law, rates)
                for law, stretch in zip(laws, stretches, strict=True)
            ]
        if steps is not None:
            group = np.searchsorted(met, np.arange(1, len(laws) + 1))
            spare = (steps / np.bincount(group, [law.x[-1] for law in laws]))[group]
            laws = [_stretched(law, max(1.0, more)) for law, more in zip(laws, spare, strict=True)]
        largest = np.vstack([np.zeros(3), *map(Stretch.largest, stretches, laws)])
        starts = np.concatenate([[0.0], np.cumsum([law.x[-1] for law in laws])])
        times = [start + law.x[:-1] for start, law in zip(starts, laws, strict=False)]
        parts = [law.c + np.array([[0], [0], [k]]) for k, law in enumerate(laws)]
        progress = PPoly(np.hstack(parts), np.concatenate([*times, starts[-1:]]))
        return cls(controls, met, starts, progress, largest.max(axis=0))

    def at(self, t: Array) -> Array:
        """Return the controls (M, n_tendons), with joint values if any, at times (M,) [s]."""
        progress = self.progress(t)
        indices = np.arange(len(self.controls))
        return np.array([np.interp(progress, indices, each) for each in self.controls.T]).T
