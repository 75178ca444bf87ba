"""A session of measurements at given values: its arm's equations, and where its markers are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from model.paths import Array
from model.transcription.neighbours import NumberDerivatives, number_derivatives
from model.transcription.system import System
from model.winches import rest_lengths
from planner.calibrate.measured import Measured
from planner.calibrate.rows import MM, Sensors
from planner.unknowns.parameters import Parameters


@dataclass(frozen=True, eq=False)
class Session:
    """The arm of a session at given values.

    Attributes
    ----------
    system : System
        The equations, on a mesh that has the markers as nodes.
    shifts : (P, 4)
        By how much each point is off where it was said to be: arc length, offset [m].
    scale : (n_tendons,)
        Of the tensions.
    """

    values: Array
    name: str
    parameters: Parameters
    system: System
    shifts: Array
    scale: Array

    def tensions(self, shape: Measured) -> Array:
        """Return the tensions of a shape (n_tendons,) [N]."""
        return np.asarray(self.scale * np.array(shape.tensions))

    def sensors(self, shape: Measured) -> Sensors:
        """Return where the markers of a shape are."""
        return shifted(shape, self.shifts)

    @cached_property
    def jacobian(self) -> NumberDerivatives:
        """Derivatives of the equations' numbers by the unknowns."""
        return number_derivatives(self.system, self.parameters.stencils(self.values, self.name))

    @cached_property
    def rest_jacobian(self) -> Array:
        """Derivatives of the tendons' lengths at rest by the unknowns (n_tendons, K)."""
        found = np.zeros((self.system.arm.n_tendons, len(self.values)))
        for k, stencil in enumerate(self.parameters.stencils(self.values, self.name)):
            for near in stencil:
                found[:, k] += near.weight * rest_lengths(near.arm)
        return found

    @cached_property
    def scaled(self) -> Array:
        """Which unknowns multiply which tensions (n_tendons, K)."""
        rows = [[f"tension_scale[{j}]" in own for own in self.keys] for j in range(self.scale.size)]
        return np.array(rows, dtype=float)

    @cached_property
    def keys(self) -> list[tuple[str, ...]]:
        """Keys of the unknowns, none for those of other sessions."""
        belongs = self.parameters.belongs
        return [own.keys if belongs(own, self.name) else () for own in self.parameters.unknowns]


def point_table(shapes: Sequence[Measured]) -> list[dict[str, object]]:
    """Return s_mm and offset_mm of each point, of the first of the shapes that have most."""
    return [
        {"s_mm": p.s / MM, "offset_mm": [x / MM for x in p.offset]}
        for p in max((shape.points for shape in shapes), key=len, default=())
    ]


def point_rows(points: list[dict[str, Any]]) -> Array:
    """Return arc length and offset of points (P, 4) [m]."""
    return MM * np.array([[p["s_mm"], *p["offset_mm"]] for p in points]).reshape(-1, 4)


def shifted(shape: Measured, shifts: Array) -> Sensors:
    """Return where the markers of a shape are, off by so much (P, 4) [m] where they were said."""
    rows = np.array([[p.s, *p.offset] for p in shape.points]).reshape(-1, 4)
    rows = rows + shifts[: len(rows)]
    return Sensors(rows[:, 0], rows[:, 1:])
