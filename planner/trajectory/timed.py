"""A way through waypoints, and when the arm is where on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from model.clearance.lines import Lines
from model.paths import Array
from planner.trajectory.question import Question
from planner.trajectory.time_law import Stretch, TimeLaw, fastest

# What a stretch takes on which nothing limits the pace [s].
_INSTANT = 1e-9


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
        rates, steps = question.rates, np.abs(np.diff(tensions, axis=0))
        change = steps.max(axis=1) / max(float(steps.max()), _INSTANT)
        least = np.maximum((steps / rates.tension).max(axis=1), _INSTANT * np.maximum(change, 1e-3))
        laws = [TimeLaw.steady(each) for each in least]
        looked = stretches(question, tensions) if rates.of_strokes or rates.at_rest else []
        if looked:
            ends = zip(laws, looked, np.diff(tensions, axis=0), strict=True)
            laws = [
                fastest(stretch, way, rates)
                if rates.at_rest
                else law.slower(max(law.used(stretch, way, rates), 1.0))
                for law, stretch, way in ends
            ]
        if question.steps is not None:
            taken = np.array([law.times[-1] for law in laws])
            group = np.searchsorted(met, np.arange(1, taken.size + 1))
            spare = question.steps / np.bincount(group, taken)
            laws = [law.slower(max(spare[k], 1.0)) for law, k in zip(laws, group, strict=True)]
        return cls(tensions, tuple(laws), tuple(looked))

    @cached_property
    def largest(self) -> Array:
        """The largest stroke rate [m/s], accelerations of strokes and of the tip [m/s2] (3,).

        0 where none of these is limited.
        """
        pairs = zip(self.laws, self.stretches, strict=False)
        each = np.array([law.largest(stretch) for law, stretch in pairs]).reshape(-1, 3)
        return np.asarray(each.max(axis=0, initial=0.0))

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
        tensions = np.zeros((t.size, self.tensions.shape[1]))
        for k in np.unique(which):
            values = which == k
            share = self.laws[k].at(t[values] - self.starts[k])[0].clip(0.0, 1.0)[:, None]
            tensions[values] = self.tensions[k] + share * (self.tensions[k + 1] - self.tensions[k])
        return tensions


def stretches(question: Question, tensions: Array) -> list[Stretch]:
    """Return the stretches between tensions (N + 1, n_tendons); raises ConvergenceError."""
    lines = question.lines()

    def places(T: Array) -> Array:
        return np.concatenate([lines.lengths(T), _tip(lines, T)])

    return [Stretch.of(places, *ends) for ends in pairwise(tensions)]


def _tip(lines: Lines, T: Array) -> Array:
    """Return the tip's place (3,) [m], NaN where the arm does not settle."""
    line = lines(T)
    return np.full(3, np.nan) if line is None else line.poses[-1, 4:]
