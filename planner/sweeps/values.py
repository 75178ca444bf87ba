"""Values along an axis, each made only when it is asked for: there may be millions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError
from model.paths import Array

Places = NDArray[np.int64]
# Draws that are looked through at a time.
_BLOCK = 100_000


@dataclass(frozen=True)
class Listed:
    """Numbers, texts or booleans, one by one."""

    values: tuple[Any, ...]

    def __len__(self) -> int:
        return len(self.values)

    def at(self, places: Places) -> list[Any]:
        """Return the values at places (m,)."""
        return [self.values[i] for i in places.tolist()]

    @property
    def extremes(self) -> tuple[Any, ...]:
        """The least and largest number; all values where they are no numbers."""
        if all(isinstance(v, int | float) and not isinstance(v, bool) for v in self.values):
            return tuple(dict.fromkeys((min(self.values), max(self.values))))
        return tuple(dict.fromkeys(self.values))


@dataclass(frozen=True)
class Even:
    """Numbers at even distances, `count` of them, from start to stop."""

    start: float
    stop: float
    count: int

    def __len__(self) -> int:
        return self.count

    def at(self, places: Places) -> list[float]:
        """Return the numbers at places (m,)."""
        last = max(self.count - 1, 1)
        found = self.start + places * ((self.stop - self.start) / last)
        # Rounding must not leave the range.
        return list(np.where(places == last, self.stop, found).tolist())

    @property
    def extremes(self) -> tuple[float, ...]:
        """The first and last number."""
        return tuple(self.at(np.unique([0, self.count - 1])))


@dataclass(frozen=True)
class Draws:
    """Numbers drawn at random.

    Attributes
    ----------
    kind : str
        The distribution.
    low, high, mean, sd : float or None
        Its parameters, as the kind needs them.
    count : int
        How many there are.
    stream : tuple of int
        Seeds of the random numbers.
    """

    kind: str
    low: float | None
    high: float | None
    mean: float | None
    sd: float | None
    count: int
    stream: tuple[int, ...]

    def __len__(self) -> int:
        return self.count

    def at(self, places: Places) -> list[float]:
        """Return the numbers at places (m,)."""
        first = int(places.min())
        shares = self._shares(first, int(places.max()) + 1)
        return self._of(shares[places - first])

    @property
    def extremes(self) -> tuple[float, ...]:
        """The least and largest of the numbers, which rise with their shares."""
        least, most = 1.0, 0.0
        for begin in range(0, self.count, _BLOCK):
            shares = self._shares(begin, min(begin + _BLOCK, self.count))
            least, most = min(least, float(shares.min())), max(most, float(shares.max()))
        return tuple(dict.fromkeys(self._of(np.array([least, most]))))

    def cut(self) -> tuple[float, float]:
        """Return the shares between which a normal distribution is cut off; InputError."""
        least = 0.0 if self.low is None else self._normal.cdf(self.low)
        most = 1.0 if self.high is None else self._normal.cdf(self.high)
        if not least < most:
            raise InputError("low, high", [self.low, self.high], "limits that the draws can meet")
        return least, most

    def _shares(self, begin: int, end: int) -> Array:
        """Return numbers from 0 to 1; the generator takes one step for each."""
        generator = np.random.PCG64(np.random.SeedSequence(self.stream)).advance(begin)
        return np.random.Generator(generator).random(end - begin)

    def _of(self, shares: Array) -> list[float]:
        low, high = self.low, self.high
        if self.kind == "normal":
            least, most = self.cut()
            inside = np.clip(least + (most - least) * shares, 1e-300, 1 - 1e-16)
            return [self._normal.inv_cdf(x) for x in inside.tolist()]
        assert low is not None and high is not None
        if self.kind == "uniform":
            return list((low + (high - low) * shares).tolist())
        return list((low * np.exp(math.log(high / low) * shares)).tolist())

    @property
    def _normal(self) -> NormalDist:
        assert self.mean is not None and self.sd is not None
        return NormalDist(self.mean, self.sd)
