"""What a sweep keeps of each point: arrays of numbers, their dimensions and units."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from model.paths import Array
from planner.sweeps.tables import Compute

SIZES = {"xyz": 3, "column": 3, "displacement": 6, "wrench": 6}


@dataclass(frozen=True)
class Variable:
    """A quantity of a point: its own dimensions, unit, meaning, and whether it is yes or no."""

    dims: tuple[str, ...]
    units: str
    about: str
    flag: bool = False


_SHAPE = {
    "tip": Variable(("xyz",), "m", "position of the tip in the base frame"),
    "tip_frame": Variable(("xyz", "column"), "1", "frame of the tip: columns t, n, b"),
    "tensions": Variable(("tendon",), "N", "tensions in tendon order"),
    "error": Variable((), "1", "estimated tip error over arm length"),
}
_SETTLED = {
    "settled": Variable((), "1", "whether the arm was settled as accurately as asked", True)
}
VARIABLES: dict[Compute, dict[str, Variable]] = {
    "settle": {**_SHAPE, **_SETTLED},
    "plan": {
        **_SHAPE,
        "effort": Variable((), "N", "norm of the tensions that was made least"),
        "reached": Variable((), "1", "whether the targets are met, by the certificate", True),
    },
    "stiffness": {
        **_SHAPE,
        **_SETTLED,
        "compliance": Variable(
            ("displacement", "wrench"),
            "m/N, m/(N m), rad/N, rad/(N m)",
            "displacement [m] and rotation [rad] per force [N] and moment [N m], base frame",
        ),
        "stable": Variable((), "1", "whether the shape is stable under held tensions", True),
    },
}
RESERVED = {
    "outcome",
    "draw",
    "tendon",
    "zarr.json",
    *SIZES,
    *(n for own in VARIABLES.values() for n in own),
}
"""Names in a Dataset that no axis can have."""


@dataclass(frozen=True, eq=False)
class Rows:
    """What was found at some points, in order.

    Attributes
    ----------
    values : dict of (m, ...)
        Each variable; nan where it was not found, 1 and 0 for yes and no.
    outcomes : list of str
        What happened at each point, in words.
    """

    values: dict[str, Array]
    outcomes: list[str] = field(default_factory=list)

    def put(self, begin: int, other: Rows) -> None:
        """Put the rows of other points from row `begin` on."""
        end = begin + len(other.outcomes)
        for name, own in self.values.items():
            own[begin:end] = other.values[name]
        self.outcomes[begin:end] = other.outcomes

    def part(self, begin: int, end: int) -> Rows:
        """Return some of the rows."""
        values = {name: own[begin:end] for name, own in self.values.items()}
        return Rows(values, self.outcomes[begin:end])


def blank(compute: Compute, tendons: int, points: int) -> Rows:
    """Return rows in which nothing was found yet."""
    sizes = {**SIZES, "tendon": tendons}
    values = {
        name: np.full(
            (points, *(sizes[dim] for dim in variable.dims)), 0.0 if variable.flag else np.nan
        )
        for name, variable in VARIABLES[compute].items()
    }
    return Rows(values, [""] * points)
