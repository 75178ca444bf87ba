"""Obstacle that moves along a path over time."""

from __future__ import annotations

from typing import Any

import numpy as np

from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.paths import Array
from octoplan.model.support.errors import InputError
from octoplan.model.support.value import Vector, value


@value
class Moving:
    """An obstacle that moves without rotation; for motions only, because plans have no time.

    Attributes
    ----------
    obstacle : Obstacle
        The obstacle at zero displacement.
    times : (K,)
        Increasing times [s]; the obstacle rests before the first and after the last.
    path : (K, 3)
        Displacements at these times [m], linear in between.
    """

    obstacle: Obstacle
    times: tuple[float, ...]
    path: tuple[Vector, ...]

    def __post_init__(self) -> None:
        if len(self.times) < 2 or np.diff(self.times).min() <= 0:
            raise InputError("Moving.times", self.times, "two times or more that increase [s]")
        if len(self.path) != len(self.times):
            allowed = f"{len(self.times)} places, one for each time"
            raise InputError("Moving.path", self.path, allowed)

    def displacement(self, t: Any) -> Array:
        """Return displacements (..., 3) [m] at times (...) [s]."""
        path = np.array(self.path)
        return np.stack([np.interp(t, self.times, each) for each in path.T], axis=-1)

    def at(self, t: float) -> Obstacle:
        """Return the obstacle at its position at a time [s]."""
        return self.obstacle.translated(tuple(self.displacement(t).tolist()))
