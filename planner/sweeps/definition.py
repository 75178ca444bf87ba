"""What a sweep file asks: its points, in chunks, made only when they are worked on."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.files import versions
from planner.sweeps.axes import Axis
from planner.sweeps.variables import VARIABLES
from planner.sweeps.worker import Job, Point

# A chunk is what an interruption loses; it is the same however many workers there are.
_PARTS, _MANY, _SOME = 64, 1000, 16


@dataclass(frozen=True)
class Sweep:
    """What a sweep file asks.

    Attributes
    ----------
    job : Job
        What is the same at all points.
    axes : tuple of Axis
        Grids first, in the file's order, then what is drawn.
    draws : int
        How many draws there are at each point of the grids; 0 where nothing is drawn.
    tendons : tuple of str
        Names of the tendons.
    texts : dict of str
        The sweep file and, where it names one, the scene file.
    """

    job: Job
    axes: tuple[Axis, ...]
    draws: int
    tendons: tuple[str, ...]
    texts: dict[str, str]

    @property
    def dims(self) -> dict[str, int]:
        """The Dataset's dimensions that points lie along, with their sizes."""
        grids = {axis.name: len(axis.values) for axis in self.axes if not axis.drawn}
        return {**grids, "draw": self.draws} if self.draws else grids

    def dim(self, axis: Axis) -> str:
        """Return the dimension that an axis lies along."""
        return "draw" if axis.drawn else axis.name

    @property
    def size(self) -> int:
        """How many points there are."""
        return math.prod(self.dims.values())

    @property
    def chunk(self) -> int:
        """How many points make a chunk, the last one but for."""
        if self.job.compute == "plan":
            return 1
        return min(math.ceil(self.size / _PARTS), _MANY if self.job.together else _SOME)

    @property
    def chunks(self) -> int:
        """How many chunks there are."""
        return math.ceil(self.size / self.chunk)

    def points(self, chunk: int) -> list[Point]:
        """Return the points of a chunk, made only now: a value for each axis."""
        numbers = np.arange(chunk * self.chunk, min((chunk + 1) * self.chunk, self.size))
        found = np.unravel_index(numbers, tuple(self.dims.values()))
        places = dict(zip(self.dims, found, strict=True))
        columns = [axis.values.at(places[self.dim(axis)]) for axis in self.axes]
        return list(zip(*columns, strict=True))

    @cached_property
    def identity(self) -> str:
        """A hash of all that the numbers depend on: scene, values, versions."""
        axes = [(axis.key, axis.values) for axis in self.axes]
        kept = list(VARIABLES[self.job.compute])
        told = [self.job.compute, kept, self.job.scene, axes, self.draws, versions(), self.chunk]
        return hashlib.sha256(repr(told).encode()).hexdigest()
