"""What a sweep computes: its points, cut into chunks that are boxes of the grid of all points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from planner.io.exact import identity
from planner.sweeps.axes import Axis
from planner.sweeps.tables import Compute
from planner.sweeps.variables import VARIABLES

Point = tuple[Any, ...]
Box = tuple[slice, ...]
# A chunk is what an interruption loses: a plan, or up to so many other points, or so many of those
# that are settled together, all in milliseconds; fewer where so many chunks would not be had, which
# workers share.
_PLANS, _POINTS, _TOGETHER = (1, 1), (16, 64), (1000, 16)
# Many chunks are as many files.
_MOST_CHUNKS = 10_000


@dataclass(frozen=True, eq=False)
class Sweep:
    """What a sweep computes.

    Attributes
    ----------
    compute
        What is computed at each point.
    scene : dict
        The scene with its defaults, as its file would hold it.
    name : str
        Of the file that the scene is from: others that it names are looked for from its folder.
    axes : tuple of Axis
        Grids first, in the file's order, then what is drawn.
    draws : int
        How many draws there are at each point of the grids; 0 where nothing is drawn.
    tendons : tuple of str
        Names of the tendons.
    together : bool
        Whether only tensions vary of shapes in closed form, which are settled many at a time.
    texts : dict of str
        The sweep file and, where it names one, the scene file.
    """

    compute: Compute
    scene: dict[str, Any]
    name: str
    axes: tuple[Axis, ...]
    draws: int
    tendons: tuple[str, ...]
    together: bool
    texts: dict[str, str]

    @property
    def keys(self) -> tuple[str, ...]:
        """Key paths of what varies; a point is a value for each."""
        return tuple(axis.key for axis in self.axes)

    @property
    def dims(self) -> dict[str, int]:
        """The Dataset's dimensions that points lie along, with their sizes."""
        grids = {axis.name: axis.values.size for axis in self.axes if not axis.drawn}
        return {**grids, "draw": self.draws} if self.draws else grids

    @property
    def size(self) -> int:
        """How many points there are."""
        return math.prod(self.dims.values())

    @cached_property
    def chunk(self) -> tuple[int, ...]:
        """How many values of each dimension make a chunk; the last one may have fewer."""
        others = _PLANS if self.compute == "plan" else _POINTS
        points, chunks = _TOGETHER if self.together else others
        most = min(math.ceil(self.size / chunks), points)
        return box_sizes(tuple(self.dims.values()), max(most, math.ceil(self.size / _MOST_CHUNKS)))

    @property
    def chunks(self) -> int:
        """How many chunks there are."""
        return math.prod(self.counts)

    @property
    def counts(self) -> tuple[int, ...]:
        """How many chunks lie along each dimension."""
        return tuple(-(-n // m) for n, m in zip(self.dims.values(), self.chunk, strict=True))

    def box(self, chunk: int) -> Box:
        """Return which values of each dimension make a chunk."""
        places = np.unravel_index(chunk, self.counts)
        begins = [int(i) * m for i, m in zip(places, self.chunk, strict=True)]
        ends = zip(begins, self.chunk, self.dims.values(), strict=True)
        return tuple(slice(begin, min(begin + m, n)) for begin, m, n in ends)

    def points(self, chunk: int) -> list[Point]:
        """Return the points of a chunk, the last dimension fastest: a value for each axis."""
        boxes = dict(zip(self.dims, self.box(chunk), strict=True))
        places = np.meshgrid(*(np.arange(b.start, b.stop) for b in boxes.values()), indexing="ij")
        along = {dim: place.ravel() for dim, place in zip(boxes, places, strict=True)}
        columns = (
            axis.values[along["draw" if axis.drawn else axis.name]].tolist() for axis in self.axes
        )
        return list(zip(*columns, strict=True))

    @cached_property
    def identity(self) -> str:
        """A hash of all that the numbers depend on: scene, values, versions."""
        axes = [(axis.key, axis.name, axis.values) for axis in self.axes]
        kept = list(VARIABLES[self.compute])
        return identity(self.compute, kept, self.scene, axes, self.draws, self.chunk)


def box_sizes(sizes: Sequence[int], most: int) -> tuple[int, ...]:
    """Return the sizes of a box inside a grid that holds up to `most` neighbouring points."""
    box = []
    for size in reversed(sizes):
        box.append(min(size, most))
        most = max(most // box[-1], 1)
    return tuple(reversed(box))
