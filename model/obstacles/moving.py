"""A body that moves along a path over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from model.checks import finite_array, vector
from model.errors import InputError
from model.obstacles.base import Obstacle
from model.paths import Array


@dataclass(frozen=True)
class Moving:
    """An obstacle that moves without turning; for motions, as plans have no time.

    Attributes
    ----------
    obstacle : Obstacle
        Where the path counts from.
    times : (K,)
        Increasing [s]; before the first and after the last it rests.
    path : (K, 3)
        How far it has moved at these times [m]; steadily in between.
    """

    obstacle: Obstacle
    times: tuple[float, ...]
    path: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        if not isinstance(self.obstacle, Obstacle):
            raise InputError("Moving.obstacle", self.obstacle, "an obstacle such as a Sphere")
        times = finite_array("Moving.times", self.times, (None,))
        if times.size < 2 or np.diff(times).min() <= 0:
            raise InputError("Moving.times", self.times, "two times or more that increase [s]")
        object.__setattr__(self, "times", tuple(times.tolist()))
        if not isinstance(self.path, Sequence | np.ndarray) or len(self.path) != times.size:
            raise InputError("Moving.path", self.path, f"{times.size} places, one for each time")
        places = tuple(vector(f"Moving.path[{i}]", own) for i, own in enumerate(self.path))
        object.__setattr__(self, "path", places)

    def moved(self, t: Any) -> Array:
        """Return how far it has moved (..., 3) [m] at times (...) [s]."""
        path = np.array(self.path)
        return np.stack([np.interp(t, self.times, own) for own in path.T], axis=-1)

    def at(self, t: float) -> Obstacle:
        """Return the obstacle where it is at a time [s]."""
        return self.obstacle.moved(tuple(self.moved(t).tolist()))
