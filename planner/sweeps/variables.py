"""What a sweep keeps of each point: arrays of numbers, their dimensions and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.sweeps.tables import Compute

Rows = dict[str, NDArray[Any]]
"""What was computed at some points: each variable by its name, a row for each point."""

LABELS = {
    "xyz": ["x", "y", "z"],
    "column": ["t", "n", "b"],
    "displacement": ["x", "y", "z", "rotation_x", "rotation_y", "rotation_z"],
    "wrench": ["F_x", "F_y", "F_z", "M_x", "M_y", "M_z"],
}


@dataclass(frozen=True)
class Variable:
    """A quantity of a point.

    Attributes
    ----------
    dims : tuple of str
        Its own dimensions, beside those that the points lie along.
    units, about : str
    blank : float, bool or str
        What it is where it was not computed.
    """

    dims: tuple[str, ...]
    units: str
    about: str
    blank: Any = np.nan

    def sizes(self, tendons: int) -> tuple[int, ...]:
        """Return the sizes of its own dimensions."""
        return tuple(tendons if dim == "tendon" else len(LABELS[dim]) for dim in self.dims)


_SHAPE = {
    "tip": Variable(("xyz",), "m", "position of the tip in the base frame"),
    "tip_frame": Variable(("xyz", "column"), "1", "frame of the tip: columns t, n, b"),
    "tensions": Variable(("tendon",), "N", "tensions in tendon order"),
    "error": Variable((), "1", "estimated tip error over arm length"),
    "outcome": Variable((), "", "what happened", ""),
}
_SETTLED = {
    "settled": Variable((), "1", "whether the arm was settled as accurately as asked", False)
}
VARIABLES: Mapping[Compute, Mapping[str, Variable]] = {
    "settle": {**_SHAPE, **_SETTLED},
    "plan": {
        **_SHAPE,
        "effort": Variable((), "N", "norm of the tensions that was made least"),
        "reached": Variable((), "1", "whether the targets are met, by the certificate", False),
    },
    "stiffness": {
        **_SHAPE,
        **_SETTLED,
        "compliance": Variable(
            ("displacement", "wrench"),
            "m/N, m/(N m), rad/N, rad/(N m)",
            "displacement [m] and rotation [rad] per force [N] and moment [N m], base frame",
        ),
        "stable": Variable((), "1", "whether the shape is stable under held tensions", False),
    },
}
RESERVED = {"draw", "tendon", "zarr.json", *LABELS, *(n for own in VARIABLES.values() for n in own)}
"""Names in a Dataset that no axis can have."""


def success(compute: Compute) -> str:
    """Return the variable that tells whether a point is as wanted."""
    return "reached" if compute == "plan" else "settled"


def blank(compute: Compute, tendons: int, points: int, width: int = 0) -> Rows:
    """Return rows in which nothing is computed yet, their texts `width` characters wide."""
    return {
        name: np.full((points, *variable.sizes(tendons)), variable.blank, dtype_of(variable, width))
        for name, variable in VARIABLES[compute].items()
    }


def dtype_of(variable: Variable, width: int) -> np.dtype[Any]:
    """Return the type of a variable's array, whose texts are `width` characters wide."""
    return np.dtype(f"U{max(width, 1)}" if variable.blank == "" else type(variable.blank))
