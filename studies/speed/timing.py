"""How the studies of speed measure time, two works in turn, and print what they measured."""

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


def seconds(work: Work, calls: int = 1, clock: Clock = time.process_time) -> float:
    """Return the time of one call [s], the mean over `calls`."""
    begin = clock()
    for _ in range(calls):
        work()
    return (clock() - begin) / calls


def timed(work: Callable[[], T], clock: Clock = time.process_time) -> tuple[float, T]:
    """Return the time of a call [s], and what it returned."""
    begin = clock()
    result = work()
    return clock() - begin, result


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


@dataclass(frozen=True)
class Row:
    """One line of the table: what is measured against what, and what is wanted of it."""

    work: str
    against: str
    wanted: str
    measured: str


def power(counts: Sequence[int], times: Sequence[float]) -> str:
    """Return the exponent of a fit in logarithms, with the times that it is through."""
    exponent = np.polyfit(np.log(counts), np.log(times), 1)[0]
    return f"n^{exponent:.2f} ({', '.join(f'{1e3 * t:.3g}' for t in times)} ms)"


def counted(counts: Sequence[int]) -> str:
    """Return the counts in words."""
    return ", ".join(map(str, counts))


Parts = Mapping[str, Callable[[np.random.Generator], Sequence[Row]]]


def print_rows(parts: Parts, names: Iterable[str], seed: int) -> None:
    """Measure parts of a table one after the other, and print each as soon as it is there.

    Exits where a table has no such part.
    """
    names = list(names)
    for name in names:
        if name not in parts:
            raise SystemExit(f"--rows: {name!r}, allowed: {', '.join(parts)}")
    print(machine())
    print(f"{'work':<42}{'against':<28}{'wanted':>9}  measured: median (quartiles)")
    for name in names:
        for row in parts[name](np.random.default_rng(seed)):
            print(f"{row.work:<42}{row.against:<28}{row.wanted:>9}  {row.measured}", flush=True)
