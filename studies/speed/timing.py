"""Measurement of times and ratios of times, and the tables of the speed studies."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")
Work = Callable[[], Any]
Clock = Callable[[], float]
# Least duration of a measurement [s]. Shorter calls are repeated, because reading the clock costs
# time, and some machines advance the processor time in steps of milliseconds.
_LEAST = 10e-3
# Largest number of calls in a measurement.
_MOST = 1000


@dataclass(frozen=True)
class Spread:
    """A median and its quartiles."""

    low: float
    median: float
    high: float

    @classmethod
    def of(cls, values: Any) -> Spread:
        """Return the median and quartiles of values."""
        return cls(*np.percentile(values, [25, 50, 75]).tolist())

    def __str__(self) -> str:
        return f"{self.median:.3g} ({self.low:.3g} to {self.high:.3g})"


def seconds(work: Work, calls: int = 1, clock: Clock = time.process_time) -> float:
    """Return the time of one call [s], as the mean over `calls`."""
    begin = clock()
    for _ in range(calls):
        work()
    return (clock() - begin) / calls


def timed(work: Callable[[], T], clock: Clock = time.process_time) -> tuple[float, T]:
    """Return the time of a call [s] and its result."""
    begin = clock()
    result = work()
    return clock() - begin, result


def while_budget(least: int, most: int, budget: float) -> Iterator[int]:
    """Yield 0, 1, ...: at least `least` numbers, then up to `most` within a processor time [s]."""
    begin = time.process_time()
    for k in range(max(least, most)):
        if k >= least and time.process_time() - begin > budget:
            return
        yield k


def calls_for(work: Work) -> int:
    """Return the number of calls for one measurement. The first call builds and does not count."""
    work()
    calls = 1
    while calls < _MOST and calls * seconds(work, calls) < _LEAST:
        calls *= 2
    return calls


def repeated(work: Work, repeats: int) -> Spread:
    """Return the time of a call [s], as median and quartiles over `repeats`."""
    calls = calls_for(work)
    return Spread.of([seconds(work, calls) for _ in range(repeats)])


def ratios(ours: Work, theirs: Work, repeats: int) -> list[float]:
    """Return the time of `theirs` divided by the time of `ours`, both measured in turn."""
    few = calls_for(theirs)
    many = calls_for(ours)
    return [seconds(theirs, few) / seconds(ours, many) for _ in range(repeats)]


def machine(*packages: str) -> str:
    """Return one line with the processor and the versions of packages."""
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


@dataclass(frozen=True)
class Row:
    """One line of the table: a task, the program it is compared with, the goal and the result."""

    work: str
    against: str
    wanted: str
    measured: str


def power(counts: Sequence[int], times: Sequence[float]) -> str:
    """Return the exponent of a power law fitted to times [s], and the times."""
    exponent = np.polyfit(np.log(counts), np.log(times), 1)[0]
    return f"n^{exponent:.2f} ({', '.join(f'{1e3 * t:.3g}' for t in times)} ms)"


def counted(counts: Sequence[int]) -> str:
    """Return the counts as text."""
    return ", ".join(map(str, counts))


Parts = Mapping[str, Callable[[np.random.Generator], Sequence[Row]]]


def print_rows(parts: Parts, names: Iterable[str], seed: int) -> None:
    """Measure parts of a table in turn and print each immediately.

    Raise SystemExit if the table has no part with a given name.
    """
    names = list(names)
    for name in names:
        if name not in parts:
            raise SystemExit(f"--rows = {name}: must be one of {', '.join(parts)}")
    print(machine())
    print(f"{'task':<42}{'compared with':<28}{'goal':>9}  measured: median (quartiles)")
    for name in names:
        for row in parts[name](np.random.default_rng(seed)):
            print(f"{row.work:<42}{row.against:<28}{row.wanted:>9}  {row.measured}", flush=True)
