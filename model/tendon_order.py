"""Numbers of tendons: in tendon order, which begins at the tip, or in a row per section."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any

import numpy as np

from model.checks import LARGEST, finite_array, numbers
from model.errors import InputError
from model.paths import Array


@dataclass(frozen=True)
class TendonOrder:
    """The order of the tendons of an arm.

    Attributes
    ----------
    counts : tuple of int
        How many tendons each section has, tip first.
    """

    counts: tuple[int, ...]

    @cached_property
    def _first(self) -> tuple[int, ...]:
        """The index of each section's first tendon, and how many there are in all."""
        return (0, *accumulate(self.counts))

    def name(self, index: int) -> str:
        """Return the paper's name of a tendon, T_ij: section i and place j in it, both from 1."""
        section = int(np.searchsorted(self._first, index, side="right"))
        place = index - self._first[section - 1] + 1
        return f"T_{section}{place}" if place <= 9 else f"T_{section},{place}"

    def of(self, section: int) -> tuple[int, ...]:
        """Return the indices of the tendons of a section, numbered from 1 at the tip."""
        if section not in range(1, len(self.counts) + 1):
            raise InputError("section", section, f"a whole number from 1 to {len(self.counts)}")
        return tuple(range(*self._first[section - 1 : section + 1]))

    def flat(self, values: Any, name: str) -> Array:
        """Return one number per tendon in tendon order, see Arm.flat."""
        if not hasattr(values, "__iter__") or isinstance(values, str | bytes):
            raise InputError(name, values, self._shapes)
        try:
            array = np.array(values)
        except ValueError:  # rows of several sizes
            array = np.array(None)
        fits = array.dtype.kind in "iuf" and array.shape in self._fitting
        if fits and array.min() >= 0 and array.max() <= LARGEST:
            return np.asarray(array, dtype=float).ravel()
        rows = [np.atleast_1d(numbers(name, row, self._shapes)) for row in values]
        if any(row.ndim != 1 for row in rows):
            raise InputError(name, f"{len(rows)} rows of shape {rows[0].shape}", self._shapes)
        flat = np.concatenate(rows) if rows else np.zeros(0)
        by_section = [row.shape for row in rows] == [(count,) for count in self.counts]
        flat_vector = all(np.ndim(v) == 0 for v in values) and flat.size == self._first[-1]
        if not (by_section or flat_vector):
            raise InputError(name, _sizes(values, rows), self._shapes)
        for j, value in enumerate(flat):
            if not 0 <= value <= LARGEST:
                raise InputError(
                    f"{name}[{j}] ({self.name(j)})",
                    float(value),
                    f"a finite number, 0 or above, up to {LARGEST:g}",
                )
        return flat

    def by_section(self, flat: Sequence[float] | Array) -> Array:
        """Return one row per section if all have as many tendons, else the flat vector."""
        array = finite_array("flat", flat, (self._first[-1],))
        return array.reshape(len(self.counts), -1) if len({*self.counts}) == 1 else array

    @cached_property
    def _fitting(self) -> tuple[tuple[int, ...], ...]:
        """The shapes of arrays that have a number for each tendon."""
        rows = (len(self.counts), self.counts[0])
        return ((self._first[-1],), rows) if len({*self.counts}) == 1 else ((self._first[-1],),)

    @property
    def _shapes(self) -> str:
        rows = "+".join(str(count) for count in self.counts)
        return f"{self._first[-1]} numbers, flat or a row per section, tip first ({rows})"


def _sizes(values: Any, rows: Sequence[Array]) -> str:
    """Return how many numbers were given, in words."""
    if all(np.ndim(value) == 0 for value in values):
        return f"{len(rows)} numbers"
    return f"{len(rows)} rows of {', '.join(str(row.size) for row in rows[:4])} numbers"
