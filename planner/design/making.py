"""What can be made: least wall around a tendon, least radius, least distance of anchorages."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model import Arm
from model.checks import not_negative
from model.paths import Array

_STATIONS = 9
# Room, over an arm's length, that is none.
_NONE = 1e-6


@dataclass(frozen=True)
class Making:
    """Limits of what can be made.

    Attributes
    ----------
    wall : float
        Least distance of a tendon from the surface [m].
    radius : float
        Least radius of the body [m].
    spacing : float
        Least distance between anchorages, and from the base to the first [m].
    """

    wall: float = 0.0
    radius: float = 0.0
    spacing: float = 0.0

    def __post_init__(self) -> None:
        for name in ("wall", "radius", "spacing"):
            object.__setattr__(self, name, not_negative(f"Making.{name}", getattr(self, name)))

    def binding(self, arm: Arm) -> tuple[str, ...]:
        """Return what an arm has no room left of, in words; only of limits that were given."""
        names = [(f"radius {1e3 * self.radius:g} mm", self.radius)] * _STATIONS
        names += [(f"wall {1e3 * self.wall:g} mm", self.wall)] * _STATIONS * len(arm.offset_paths)
        names += [(f"spacing {1e3 * self.spacing:g} mm", self.spacing)] * len(arm.sections)
        rows = zip(names, self.room(arm), strict=False)
        found = [name for (name, limit), room in rows if limit > 0 and room < _NONE]
        return tuple(dict.fromkeys(found))

    def room(self, arm: Arm) -> Array:
        """Return what is left of each limit over the arm's length (n,): 0 or above can be made."""
        share = np.linspace(0.0, 1.0, _STATIONS)
        rows = [arm.radius.evaluate(share * arm.length, arm.length)[0] - self.radius]
        for i, path in arm.offset_paths:
            end = arm.sections[i].at
            s = share * end
            y = np.abs(path.evaluate(s, end)[0])
            rows.append((arm.hull or arm.radius).evaluate(s, arm.length)[0] - y - self.wall)
        ends = np.array([*arm.anchorages, 0.0])
        rows += [-np.diff(ends) - self.spacing, np.array([arm.length - ends[0]])]
        return np.concatenate(rows) / arm.length
