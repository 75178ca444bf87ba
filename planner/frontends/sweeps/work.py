"""Work: points in chunks that workers compute; the interface of runs and of chunk files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from numpy.typing import NDArray

Point = tuple[Any, ...]
Rows = dict[str, NDArray[Any]]
"""Results at some points: for each variable, by name, an array with one row per point."""


class PointJob(Protocol):
    """The computation at each point, sent to workers."""

    def rows(self, points: Sequence[Point]) -> Rows:
        """Return the results at points, with the texts `outcome`; failures are results, too."""
        ...


class Work(Protocol):
    """Points that are computed in chunks; each finished chunk is a file."""

    @property
    def job(self) -> PointJob:
        """The computation at each point."""
        ...

    @property
    def size(self) -> int:
        """Number of points."""
        ...

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        ...

    @property
    def identity(self) -> str:
        """Hash of everything that determines the results."""
        ...

    def points(self, chunk: int) -> list[Point]:
        """Return the points of a chunk."""
        ...
