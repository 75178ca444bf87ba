"""How studies measure time, two works in turn, and the curves of work-precision diagrams."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from model import OctoplanError
from model.mesh_refinement import REFINEMENTS
from model.paths import Array
from planner.plots.work import Curve

T = TypeVar("T")
Work = Callable[[], Any]
Clock = Callable[[], float]
# A measurement shorter than this is repeated within, as a clock's reading is not free.
_LEAST = 2e-3


@dataclass(frozen=True)
class Spread:
    """A median and its quartiles."""

    low: float
    median: float
    high: float

    @classmethod
    def of(cls, values: Any) -> Spread:
        """Return the spread of some numbers."""
        return cls(*np.percentile(values, [25, 50, 75]).tolist())

    def __str__(self) -> str:
        return f"{self.median:.3g} ({self.low:.3g} to {self.high:.3g})"


def seconds(work: Work, calls: int = 1, clock: Clock = time.perf_counter) -> float:
    """Return the time of one call [s], the mean over `calls`."""
    begin = clock()
    for _ in range(calls):
        work()
    return (clock() - begin) / calls


def timed(work: Callable[[], T], clock: Clock = time.perf_counter) -> tuple[float, T]:
    """Return the time of a call [s], and what it returned."""
    begin = clock()
    found = work()
    return clock() - begin, found


def while_budget(least: int, most: int, budget: float) -> Iterator[int]:
    """Yield 0, 1, ...: `least` times in any case, up to `most` within the processor time [s]."""
    begin = time.process_time()
    for k in range(max(least, most)):
        if k >= least and time.process_time() - begin > budget:
            return
        yield k


def calls_for(work: Work) -> int:
    """Return how many calls take long enough to be timed; the first call builds and is not."""
    work()
    return max(1, min(1000, int(np.ceil(_LEAST / max(seconds(work), 1e-7)))))


def repeated(work: Work, repeats: int) -> Spread:
    """Return the time of a call [s]."""
    calls = calls_for(work)
    return Spread.of([seconds(work, calls) for _ in range(repeats)])


def ratios(ours: Work, theirs: Work, repeats: int) -> list[float]:
    """Return how many times as long theirs takes as ours, measured in turn."""
    few, many = calls_for(theirs), calls_for(ours)
    return [seconds(theirs, few) / seconds(ours, many) for _ in range(repeats)]


def machine(*packages: str) -> str:
    """Return the machine and versions that times were measured with, in one line."""
    parts = [_processor(), f"{os.cpu_count()} cores", f"Python {platform.python_version()}"]
    for package in ("casadi", "numpy", "scipy", *packages):
        try:
            parts.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            parts.append(f"{package} absent")
    return ", ".join(parts)


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


Tip = Callable[[Array], Any]
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
