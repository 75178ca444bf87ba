"""All measured shapes at given values of the unknowns: settled, compared and differentiated.

The equations of a session's arm are put together once for values; its shapes are solved by Newton's
method from where the derivatives of the shapes before say that they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from model import InputError, OctoplanError
from model.equilibrium.by_numbers import ByNumbers
from model.equilibrium.forward import Collocation, Known
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import newton
from model.paths import Array
from model.transcription.neighbours import (
    NumberSlopes,
    number_slopes,
)
from model.transcription.system import System
from model.winches import rest_lengths
from planner.calibrate.measured import Measured
from planner.calibrate.rows import MM, Sensors, jacobian, residuals
from planner.unknowns.meshes import Meshes
from planner.unknowns.parameters import Parameters
from planner.unknowns.pulled import FARTHEST, Pulled


class UnsettledShapeError(OctoplanError):
    """A shape does not settle at given values of the unknowns."""

    def __init__(self, name: str, why: OctoplanError) -> None:
        self.name, self.why = name, why
        super().__init__(f"{name} does not settle: {why}")

    def __reduce__(self) -> tuple[type, tuple[str, OctoplanError]]:
        return type(self), (self.name, self.why)


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
        return _shifted(shape, self.shifts)

    @cached_property
    def slopes(self) -> NumberSlopes:
        """Derivatives of the equations' numbers by the unknowns."""
        return number_slopes(self.system, self.parameters.stencils(self.values, self.name))

    @cached_property
    def rest_slopes(self) -> Array:
        """Derivatives of the tendons' lengths at rest by the unknowns (n_tendons, K)."""
        found = np.zeros((self.system.arm.n_tendons, len(self.values)))
        for k, stencil in enumerate(self.parameters.stencils(self.values, self.name)):
            for near in stencil:
                found[:, k] += near.weight * rest_lengths(near.arm)
        return found

    @cached_property
    def keys(self) -> list[tuple[str, ...]]:
        """Keys of the unknowns, none for those of other sessions."""
        belongs = self.parameters.belongs
        return [own.keys if belongs(own, self.name) else () for own in self.parameters.unknowns]


class Experiment:
    """Measured shapes of one arm, with the unknowns of both.

    Attributes
    ----------
    parameters : Parameters
    shapes : tuple of Measured
    refinement : int
        Of the meshes.
    machine_code : bool
        Whether the kernels are compiled.
    """

    def __init__(
        self,
        parameters: Parameters,
        shapes: Sequence[Measured],
        refinement: int,
        machine_code: bool = False,
    ) -> None:
        self.parameters, self.shapes = parameters, tuple(shapes)
        self.refinement, self.machine_code = refinement, machine_code
        self.meshes: dict[str, Meshes] = {}

    def session(self, values: Array, name: str) -> Session:
        """Return a session at values (K,); InputError where no such arm can be."""
        arm, scene = self.parameters.built(values, name)
        table = self.parameters.table_at(values, name)
        shifts = _rows(table["points"]) - _rows(self.parameters.table["points"])
        own = [shape for shape in self.shapes if shape.session == name]
        seen = [s for shape in own for s in _shifted(shape, shifts).s.tolist()]
        seen += [frame.s for shape in own for frame in shape.frames]
        places = np.unique(seen)
        if places.size and not 0 <= places[0] <= places[-1] <= arm.length * (1 + 1e-12):
            raise InputError("points", places.tolist(), f"on the arm, 0 to {arm.length:g} m")
        at = tuple(np.minimum(places, arm.length).tolist())
        meshes = self.meshes.setdefault(name, Meshes(self.refinement, self.machine_code))
        stated = meshes.system(arm, scene, at)
        return Session(
            values, name, self.parameters, stated, shifts, np.array(table["tension_scale"])
        )

    def at(self, values: Array, before: Evaluation | None = None) -> Evaluation:
        """Return all shapes at values (K,), on the branches of an evaluation nearby.

        Without one, or where that leads nowhere, as they are reached from rest. Raises InputError
        where no such arm can be, UnsettledShapeError.
        """
        names = dict.fromkeys(shape.session for shape in self.shapes)
        sessions = {name: self.session(values, name) for name in names}
        rests = {name: Pulled(of.system) for name, of in sessions.items()}
        heres = {}
        pulls = [float(np.linalg.norm(shape.tensions)) for shape in self.shapes]
        for i in np.argsort(pulls, kind="stable").tolist():
            shape, of = self.shapes[i], sessions[self.shapes[i].session]
            found = before and self._near(of, i, values, before)
            try:
                heres[i] = found or rests[of.name].at(of.tensions(shape))
            except OctoplanError as reason:
                raise UnsettledShapeError(shape.name, reason) from None
        return Evaluation(self, values, sessions, tuple(heres[i] for i in range(len(heres))))

    def _near(self, of: Session, i: int, values: Array, before: Evaluation) -> Linearised | None:
        """Return the equilibrium of a shape near that of an evaluation, None if there is none."""
        guess, kept = before.predicted(i, values, of)
        T = of.tensions(self.shapes[i])
        found = newton(of.system, T, 1.0, guess, FARTHEST, kept=kept)
        return None if found is None else replace(found, system=of.system)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """All shapes at given values of the unknowns.

    Attributes
    ----------
    experiment : Experiment
    values : (K,)
    sessions : dict of Session
    heres : tuple of Linearised
        The equilibrium of each shape.
    """

    experiment: Experiment
    values: Array
    sessions: dict[str, Session]
    heres: tuple[Linearised, ...]

    @cached_property
    def by_shape(self) -> list[Array]:
        """Predictions less measurements of each shape (size,), [m] and [rad]."""
        return [
            residuals(here, shape, self.sessions[shape.session].sensors(shape))
            for here, shape in self._pairs
        ]

    @cached_property
    def residuals(self) -> Array:
        """The same of all shapes, over their standard deviations (n,)."""
        stds = [shape.stds for shape in self.experiment.shapes]
        return np.concatenate(self.by_shape) / np.concatenate(stds)

    @cached_property
    def derivatives(self) -> list[ByNumbers]:
        """Derivatives of each shape by the unknowns."""
        found = []
        for here, shape in self._pairs:
            of = self.sessions[shape.session]
            scaled = [
                [f"tension_scale[{j}]" in own for own in of.keys] for j in range(len(of.scale))
            ]
            tensions = np.array(shape.tensions)[:, None] * np.array(scaled, dtype=float)
            found.append(ByNumbers(Linearised(here.system, here.x), of.slopes, tensions))
        return found

    @cached_property
    def jacobian(self) -> Array:
        """Derivatives of `residuals` by the unknowns (n, K)."""
        rows = []
        for by, shape in zip(self.derivatives, self.experiment.shapes, strict=True):
            of = self.sessions[shape.session]
            rest = of.rest_slopes if shape.strokes else np.zeros((0, 0))
            own = jacobian(by, shape, of.sensors(shape), of.keys, rest)
            rows.append(own / shape.stds[:, None])
        return np.vstack(rows)

    def predicted(self, i: int, values: Array, of: Session) -> tuple[Array, Linearised | None]:
        """Return the states that shape i has at other values, to first order.

        And the equations linearised nearby, where the mesh is as it was.
        """
        here = self.heres[i]
        if of.system.of is not here.system.of:
            T = of.tensions(self.experiment.shapes[i])
            return Collocation.on(of.system).carried(T, Known(here.system, here.states)), None
        by = self.derivatives[i]
        return here.states + by.states @ (values - self.values), by.here

    @property
    def _pairs(self) -> list[tuple[Linearised, Measured]]:
        return list(zip(self.heres, self.experiment.shapes, strict=True))


def point_table(shapes: Sequence[Measured]) -> list[dict[str, object]]:
    """Return s_mm and offset_mm of each point, of the first of the shapes that have most."""
    return [
        {"s_mm": p.s / MM, "offset_mm": [x / MM for x in p.offset]}
        for p in max((shape.points for shape in shapes), key=len, default=())
    ]


def _rows(points: list[dict[str, Any]]) -> Array:
    """Return arc length and offset of points (P, 4) [m]."""
    return MM * np.array([[p["s_mm"], *p["offset_mm"]] for p in points]).reshape(-1, 4)


def _shifted(shape: Measured, shifts: Array) -> Sensors:
    rows = np.array([[p.s, *p.offset] for p in shape.points]).reshape(-1, 4)
    rows = rows + shifts[: len(rows)]
    return Sensors(rows[:, 0], rows[:, 1:])
