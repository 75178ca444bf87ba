"""A way through waypoints, and when the arm is where on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.paths import Array
from planner.trajectory.asked import Rates
from planner.trajectory.question import Question
from planner.trajectory.strokes import Lengths, Stretch
from planner.trajectory.time_law import TimeLaw, fastest

# What a stretch takes on which nothing moves [s].
_INSTANT = 1e-9


@dataclass(frozen=True, eq=False)
class Timed:
    """Waypoints, straight ways between them, and the pace on each. Numbers only.

    Attributes
    ----------
    tensions : (N + 1, n_tendons)
        At the waypoints [N], the first of which is where the motion begins.
    laws : tuple of N TimeLaw
    """

    tensions: Array
    laws: tuple[TimeLaw, ...]

    @classmethod
    def of(
        cls, question: Question, tensions: Array, durations: Array, met: tuple[int, ...]
    ) -> Timed:
        """Return the way at the pace that limits allow, in durations (N,) [s] or more.

        Durations are what rates of tensions take, or what times leave where these are given: then
        the stretches up to a target share its time in proportion to the least that they take.
        """
        rates, lengths = question.rates, question.lines().lengths
        ends = zip(tensions[:-1], tensions[1:], durations, strict=True)
        laws = [_law(rates, lengths, *own) for own in ends]
        if question.times is not None:
            taken = np.array([law.times[-1] for law in laws])
            group = np.searchsorted(met, np.arange(1, taken.size + 1))
            spare = question.least / np.bincount(group, taken)
            laws = [law.slower(max(spare[k], 1.0)) for law, k in zip(laws, group, strict=True)]
        return cls(tensions, tuple(laws))

    @cached_property
    def starts(self) -> Array:
        """When each waypoint is reached (N + 1,) [s], from 0."""
        return np.concatenate([[0.0], np.cumsum([law.times[-1] for law in self.laws])])

    @cached_property
    def knots(self) -> Array:
        """The times of waypoints and, where the pace changes on the way, between them (K,) [s]."""
        parts = [start + law.times[1:] for start, law in zip(self.starts, self.laws, strict=False)]
        return np.concatenate([[0.0], *parts])

    def at(self, t: Array) -> Array:
        """Return the tensions (M, n_tendons) at times (M,) [s]."""
        last = len(self.laws) - 1
        which = np.clip(np.searchsorted(self.starts, t, side="right") - 1, 0, last)
        found = np.zeros((t.size, self.tensions.shape[1]))
        for k in np.unique(which):
            own = which == k
            share = self.laws[k].at(t[own] - self.starts[k])[0].clip(0.0, 1.0)[:, None]
            found[own] = self.tensions[k] + share * (self.tensions[k + 1] - self.tensions[k])
        return found


def _law(rates: Rates, lengths: Lengths, start: Array, end: Array, least: float) -> TimeLaw:
    """Return the pace from tensions to others (n_tendons,) that limits of strokes allow."""
    law = TimeLaw.steady(max(least, _INSTANT))
    if not (np.isfinite(rates.stroke) or np.isfinite(rates.acceleration)):
        return law
    stretch = Stretch.of(lengths, start, end)
    if np.isfinite(rates.acceleration):
        return fastest(stretch, end - start, rates)
    return law.slower(max(law.used(stretch, end - start, rates), 1.0))
