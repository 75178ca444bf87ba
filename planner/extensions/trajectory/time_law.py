"""When the arm is where on its way: the least time that rates and accelerations allow.

The way is straight in the tensions from waypoint to waypoint. Where accelerations of strokes or of
the tip are limited each is met at rest. On a stretch with share u of time, lengths l(u), the tip's
place x(u) and b = (du/dt)^2 the limits are

    |T'| sqrt(b) <= rate      |l'| sqrt(b) <= stroke rate      |l' b' / 2 + l'' b| <= acceleration
                                                               |x' b' / 2 + x'' b| <= acceleration

linear in b and its slope, the last a cone. With b linear between even knots, which is a constant
d2u/dt2, the least time is a conic program: what is fastest at one place is fastest at all. Source:
Verscheure, Demeulenaere, Swevers, De Schutter, Diehl, "Time-optimal path tracking for robots: a
convex optimization approach", IEEE Transactions on Automatic Control 54 (2009).
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
from octoplan.planner.extensions.contact.grasp import Cone, conic_program
from octoplan.planner.extensions.trajectory.question import Question, Rates, Waypoint

# Knots of a stretch, and instants at which it is looked at.
_KNOTS = 80
INSTANTS = 4 * _KNOTS
# Degrees that are tried, and what their last coefficients may be, over the largest change; what a
# stretch takes on which nothing limits the pace [s].
_DEGREES, _ROUNDING = (8, 16, 32, 64, 128), 1e-8
# Tensions (n_tendons,) -> lengths of the tendons, place of the tip: (n_tendons + 3,) [m].
Places = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Stretch:
    """The lengths of the tendons and the tip's place along the straight way to a waypoint.

    They are the polynomial through Chebyshev points, of a degree that is doubled until its last
    coefficients are rounding: they are smooth functions of the tensions, but for friction of
    tendons. Source: Trefethen, "Approximation Theory and Approximation Practice" (2013), chapter 8.

    Attributes
    ----------
    change : (n_tendons,)
        Of the tensions, from its start to its end [N].
    coefficients : (degree + 1, n_tendons + 3)
        Of Chebyshev polynomials in 2 share - 1 [m].
    """

    change: Array
    coefficients: Array

    @classmethod
    def of(
        cls, places: Places, start: Array, end: Array, within: float = 0.0, at_last: float = 0.0
    ) -> Stretch:
        """Return the stretch between tensions (n_tendons,), as close as that or to rounding [m].

        Or of the largest degree as close as `at_last` [m]: where a curvature changes its sign
        friction of tendons leaves a jump of the second derivative. Raises ConvergenceError where
        the stretch itself jumps, or the arm does not settle.
        """
        for degree in _DEGREES:
            x = chebyshev.chebpts1(degree + 1)
            values = np.array([places(start + (1 + u) / 2 * (end - start)) for u in x])
            if not np.isfinite(values).all():
                break
            fitted = chebyshev.chebfit(x, values, degree)
            change, size = np.abs(fitted[1:]).max(), np.abs(fitted).max()
            allowed = at_last if degree == _DEGREES[-1] else 0.0
            # Where an arm all but stays places change by what they are settled to.
            allowed = max(allowed, within, _ROUNDING * change + FINEST_ACCURACY * size)
            if np.abs(fitted[-2:]).max() <= allowed:
                return cls(end - start, fitted)
        remedy = "somewhere between two waypoints it snaps: put waypoints where it does not"
        raise ConvergenceError(_ROUNDING, np.inf, remedy)

    def derivatives(self, share: Array) -> list[Array]:
        """Return first and second derivatives by the share (K, n_tendons + 3) [m], at shares."""
        each = (chebyshev.chebder(self.coefficients, order, scl=2.0) for order in (1, 2))
        return [np.asarray(chebyshev.chebval(2 * share - 1, one).T) for one in each]

    def largest(self, law: PPoly) -> Array:
        """Return the largest stroke rate [m/s], accelerations of strokes and tip [m/s2] (3,).

        At many instants.
        """
        knots = np.arange(law.x.size)
        inside = (np.arange(INSTANTS) + 0.5) / INSTANTS * knots[-1]
        t = np.interp(np.concatenate([knots, inside]), knots, law.x)
        first, second = self.derivatives(law(t))
        speed, rise = law(t, 1)[:, None], law(t, 2)[:, None]
        accelerations = first * rise + second * speed**2
        tip = np.linalg.norm(accelerations[:, -3:], axis=1)
        most = [np.abs(each[:, :-3]).max() for each in (first * speed, accelerations)]
        return np.array([*most, tip.max()])

    def kept(self, law: PPoly, rates: Rates) -> PPoly:
        """Return a law of pace, slower where that is what limits ask for."""
        tension = (np.abs(self.change) / rates.tension).max() * fastest_pace(law).max()
        rate, *accelerations = self.largest(law) / rates.of_places
        return _stretched(law, max(1.0, tension, rate, np.sqrt(max(accelerations))))


def _paced(shares: Array, speeds: Array) -> PPoly:
    """Return shares (K + 1,) over time as parabolas, of speeds [1/s] that change steadily."""
    steps = 2 * np.diff(shares) / (speeds[1:] + speeds[:-1])
    rise = np.diff(speeds) / (2 * steps)
    times = np.concatenate([[0.0], np.cumsum(steps)])
    return PPoly(np.array([rise, speeds[:-1], shares[:-1]]), times)


def _stretched(law: PPoly, factor: float) -> PPoly:
    """Return the law that takes so many times as long."""
    return PPoly(law.c / factor ** np.array([[2], [1], [0]]), law.x * factor)


def fastest_pace(law: PPoly) -> Array:
    """Return the largest speed in each part (K,) of a law [1/s]: at one of its ends."""
    return np.asarray(np.maximum(law.c[1], law.c[1] + 2 * law.c[0] * np.diff(law.x)))


def fastest(stretch: Stretch, rates: Rates) -> PPoly:
    """Return the share of a stretch over time, from rest to rest in the least time.

    Raises ConvergenceError where none is found.
    """
    u = np.linspace(0.0, 1.0, _KNOTS + 1)
    derivatives = np.stack(stretch.derivatives(u))
    limits = np.repeat([rates.acceleration, rates.tip_acceleration], [stretch.change.size, 3])
    size = max(float(np.abs(derivatives / limits).max()), _ROUNDING)
    # By b at the knots between the ends: itself, and its slope in each interval.
    b = np.eye(_KNOTS + 1)[:, 1:-1]
    slope = np.diff(b, axis=0) * (_KNOTS / 2)
    first, second = derivatives[..., None] / (size * limits)[:, None]
    begin, end = slice(_KNOTS), slice(1, None)
    accelerations = np.vstack(
        [first[at] * slope[:, None] + second[at] * b[at][:, None] for at in (begin, end)]
    )
    lengths, tip = accelerations[:, :-3].reshape(-1, b.shape[1]), accelerations[:, -3:]
    tension = (np.abs(stretch.change) / rates.tension).max()
    fast = np.maximum(np.abs(derivatives[0, 1:-1, :-3]).max(axis=1) / rates.stroke, tension)
    # Where nothing limits b it is what takes an instant.
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
    # Between knots a limit may be passed by a little.
    return stretch.kept(_paced(u, np.pad(speeds, 1)), rates)


@dataclass(frozen=True, eq=False)
class Timed:
    """Waypoints, straight ways between them, and the pace on each. Numbers only.

    Attributes
    ----------
    tensions : (N + 1, n_tendons)
        At the waypoints [N], the first of which is where the motion begins.
    met : tuple of int
        At which of these each target is met.
    starts : (N + 1,)
        When each is reached [s], from 0.
    progress : PPoly
        How many waypoints are passed over time, with the share of the way to the next: 0 to N.
    largest : (3,)
        The largest stroke rate [m/s], accelerations of strokes and of the tip [m/s2]; 0 where none
        of these is limited.
    """

    tensions: Array
    met: tuple[int, ...]
    starts: Array
    progress: PPoly
    largest: Array

    @classmethod
    def of(cls, question: Question, waypoints: Sequence[Waypoint]) -> Timed:
        """Return the way through waypoints at the pace that limits allow.

        Where times are given, the stretches up to a target share its time in proportion to the
        least that they take, or as waypoints have it where nothing limits that.
        """
        tensions = np.vstack([question.start, *(waypoint.tensions for waypoint in waypoints)])
        met = tuple(k for k, waypoint in enumerate(waypoints, start=1) if waypoint.targets)
        rates, steps, stretches = question.rates, question.steps, list[Stretch]()
        least = (np.abs(np.diff(tensions, axis=0)) / rates.tension).max(axis=1)
        fractions = np.array([waypoint.fraction for waypoint in waypoints])
        speeds = 1 / np.maximum(least, _ROUNDING * fractions)
        laws = [_paced(np.array([0.0, 1.0]), np.full(2, speed)) for speed in speeds]
        if np.isfinite(rates.of_places).any():
            lines = question.lines()

            def places(T: Array) -> Array:
                line = lines(T)
                tip = np.full(3, np.nan) if line is None else line.poses[-1, 4:]
                return np.concatenate([lines.lengths(T), tip])

            met_to = question.accuracy * question.arm.length
            stretches = [Stretch.of(places, *ends, at_last=met_to) for ends in pairwise(tensions)]
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
        return cls(tensions, met, starts, progress, largest.max(axis=0))

    def at(self, t: Array) -> Array:
        """Return the tensions (M, n_tendons) at times (M,) [s]."""
        passed, all_of_them = self.progress(t), np.arange(len(self.tensions))
        return np.array([np.interp(passed, all_of_them, T) for T in self.tensions.T]).T
