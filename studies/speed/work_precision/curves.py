"""Curves of work-precision diagrams, as settings are measured."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from model import OctoplanError
from model.mesh_refinement import REFINEMENTS
from model.paths import Array
from planner.plots.work import Curve
from studies.speed.timing import calls_for, seconds, timed, while_budget

FAILURES = (OctoplanError, RuntimeError, ArithmeticError, np.linalg.LinAlgError)


@dataclass(frozen=True)
class Size:
    """How much is measured.

    Attributes
    ----------
    cases : int
        Random sets of tensions, or targets.
    repeats : int
        Measurements of each time, at most: fewer where they take longer than `budget`.
    finest : int
        The finest mesh.
    settings : int
        Of accuracies, tolerances and starts, how many at most.
    budget : float
        Processor time [s] after which a setting is measured no more, once each case was.
    """

    cases: int
    repeats: int
    finest: int
    settings: int
    budget: float = 1.0


# Errors below are those of what they are held against.
_FINE = 1e-10


@dataclass
class Measured:
    """A curve by time, as settings are added to it."""

    name: str
    kind: str = "own"
    errors: list[Array] = field(default_factory=list)
    times: list[Array] = field(default_factory=list)
    lost: list[float] = field(default_factory=list)

    def add(
        self,
        work: Callable[[int], Any],
        error: Callable[[int, Any], float],
        size: Size,
    ) -> None:
        """Do a work of all cases, and time it; a failure is kept as such.

        `work` and `error` take the number of the case.
        """
        try:
            found = [timed(partial(work, i), time.process_time) for i in range(size.cases)]
        except FAILURES:
            self.lost.append(failing_time(work, size.cases))
            return
        errors = [error(i, value) for i, (_, value) in enumerate(found)]
        # The first call builds; where the others are long enough they are the measurement.
        times = [taken for taken, _ in found[1:]]
        if sum(times) < size.budget:
            many, times = calls_for(lambda: work(0)), []
            for k in while_budget(size.cases, size.repeats, size.budget):
                times.append(seconds(lambda i=k % size.cases: work(i), many, time.process_time))
        self.errors.append(np.percentile(errors, [25, 50, 75]))
        self.times.append(1e3 * np.percentile(times, [25, 50, 75]))

    @classmethod
    def over_meshes(
        cls,
        name: str,
        work_on: Callable[[int], Callable[[int], Any]],
        error: Callable[[int, Any], float],
        size: Size,
    ) -> Measured:
        """Return the curve of the works (refinement -> work) on finer and finer meshes."""
        curve = cls(name)
        for refinement in (r for r in REFINEMENTS if r <= size.finest):
            curve.add(work_on(refinement), error, size)
            if curve.errors and curve.errors[-1][1] < _FINE:
                break
        return curve

    def by_time(self) -> Curve:
        """Return errors over milliseconds."""
        rows = np.array(self.times).reshape(-1, 3), np.array(self.errors).reshape(-1, 3)
        return Curve(self.name, *rows, 1e3 * np.array(self.lost), self.kind)


def failing_time(work: Callable[[int], Any], cases: int) -> float:
    """Return how long a work takes, on the mean of its cases, though some of them fail [s]."""

    def attempt(i: int) -> None:
        try:
            work(i)
        except FAILURES:
            return

    times = [seconds(lambda i=i: attempt(i), 1, time.process_time) for i in range(cases)]
    return float(np.mean(times))
