"""Equations of measured shapes at values of the unknowns, and the shapes that settle by them.

The numbers of the equations, the places that are looked at and the lengths at rest are closed forms
of the unknowns, put together in NumPy; difference quotients differentiate them, and nothing is
solved for these. Equilibria follow from the equations' own derivatives by their numbers, CasADi's,
by the implicit function theorem. Shapes are settled under the tensions of load cells, or by the
lengths of encoders.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from model import Arm, InputError, OctoplanError, Scene, settle
from model.by_lengths import equilibrium_beside, tightened
from model.equilibrium.linearised import Linearised, check_stretch
from model.equilibrium.newton import Collocation
from model.equilibrium.sensitivities import ByNumbers, NumberDerivatives
from model.paths import Array
from model.transcription.layout import POSE
from model.transcription.system import System, neighbour, system
from model.winches import Winches, rest_lengths
from planner.fit.measured import TIP, Measured
from planner.fit.unknowns import MM, Parameters

Index = NDArray[np.int64]
Reached = Linearised | OctoplanError
Mesh = tuple[int, int, bool]
# Tip error over arm length of the shapes by lengths whose tensions are then corrected.
_ROUGHLY = 1e-4


class Numbers(NamedTuple):
    """What equations and sensors take of the unknowns; of derivatives each with K columns more.

    Numbers of the equations (n_p,) and of the tendons' lengths (n,), arc lengths of the nodes
    (N + 1,) and of what is looked at (M,), offsets of points (M, 3) [m], scale and lengths at rest
    [m] of the tendons (n_tendons,).
    """

    p: Array
    lengths: Array
    nodes: Array
    s: Array
    offsets: Array
    scale: Array
    rest: Array


class Session:
    """Shapes whose arm is one at any values of the unknowns.

    Attributes
    ----------
    shapes : dict of Measured
        By their number among all shapes, in order.
    mesh : (refinement, stages, machine_code)
    sensors : list of Sensor
        All that is looked at, shape by shape.
    shape, point : (M,)
        The number of its shape, and of its point.
    """

    def __init__(
        self, parameters: Parameters, name: str, shapes: Mapping[int, Measured], mesh: Mesh
    ) -> None:
        self.parameters, self.name, self.shapes, self.mesh = parameters, name, shapes, mesh
        rows = [(i, sensor) for i, shape in shapes.items() for sensor in shape.sensors]
        self.sensors = [sensor for _, sensor in rows]
        self.shape = np.array([i for i, _ in rows], dtype=np.int64)
        self.point = np.array([sensor.point for sensor in self.sensors], dtype=np.int64)
        self._s = np.array([sensor.s for sensor in self.sensors])
        self._offsets = np.array([sensor.offset for sensor in self.sensors]).reshape(-1, 3)
        self._strokes = any(shape.strokes is not None for shape in shapes.values())
        self._first: tuple[System, tuple[float, ...]] | None = None

    def at(self, values: Array) -> Equations:
        """Return the equations at values (K,) of the unknowns; InputError where no arm can be.

        On the first mesh as it fits this arm; where places have passed each other, on a new one.
        """
        table, arm, scene = self._built(values)
        s = self._looked_at(arm, table)
        if s.size and not 0 <= s.min() <= s.max() <= arm.length * (1 + 1e-12):
            raise InputError("points", np.unique(s).tolist(), f"on the arm, 0 to {arm.length:g} m")
        at = tuple(np.unique(np.minimum(s, arm.length)).tolist())
        refinement, stages, machine_code = self.mesh
        if self._first is not None:
            try:
                stated = neighbour(self._first[0], arm, scene, self._first[1], at)
            except InputError:
                self._first = None
        if self._first is None:
            stated = system(arm, scene, stages, refinement, at, True, machine_code)
            self._first = stated, at
        return Equations(self, values, stated, self._numbers(stated, table))

    def derivatives(self, at: Equations) -> Numbers:
        """Return the derivatives of numbers by the unknowns (K,), on nodes that move along."""

        def numbers(values: Array) -> Numbers:
            table, arm, scene = self._built(values)
            same = (arm, scene) == (at.system.arm, at.system.scene)
            return self._numbers(at.system if same else neighbour(at.system, arm, scene), table)

        arguments = numbers, at.numbers, at.values, self.name
        return Numbers(*self.parameters.derivatives(*arguments))

    def _built(self, values: Array) -> tuple[dict[str, Any], Arm, Scene]:
        table = self.parameters.table_at(values, self.name)
        return table, *self.parameters.built_of(table)

    def _shift(self, table: dict[str, Any], key: str, size: tuple[int, ...] = ()) -> Array:
        """Return by how much a key of the points looked at is off what it is said to be [m]."""
        shift = np.zeros((self.point.size, *size))
        rows = zip(table["points"], self.parameters.table["points"], strict=True)
        for i, (now, said) in enumerate(rows):
            shift[self.point == i] = MM * (np.array(now[key]) - said[key])
        return shift

    def _looked_at(self, arm: Arm, table: dict[str, Any]) -> Array:
        s = np.where(self.point == TIP, arm.length, self._s)
        return np.asarray(s + self._shift(table, "s_mm"))

    def _numbers(self, stated: System, table: dict[str, Any]) -> Numbers:
        return Numbers(
            stated.p,
            stated.length_numbers,
            stated.mesh.s,
            self._looked_at(stated.arm, table),
            self._offsets + self._shift(table, "offset_mm", (3,)),
            np.array(table["tension_scale"], dtype=float),
            rest_lengths(stated.arm) if self._strokes else np.zeros(stated.arm.n_tendons),
        )


@dataclass(frozen=True, eq=False)
class Equations:
    """The equations of a session at values (K,) of the unknowns, and their numbers."""

    session: Session
    values: Array
    system: System
    numbers: Numbers

    @cached_property
    def derivatives(self) -> Numbers:
        """Derivatives of the numbers by the unknowns, each (..., K)."""
        return self.session.derivatives(self)

    @cached_property
    def nodes(self) -> Index:
        """The nodes that are looked at (M,)."""
        return np.asarray(np.abs(self.system.mesh.s - self.numbers.s[:, None]).argmin(axis=1))

    @property
    def places(self) -> Index:
        """Places of their poses among the states (M, 7)."""
        return np.asarray(self.system.of.nodes[self.nodes, :POSE])

    def from_rest(self, looser: float = 1.0) -> dict[int, Reached]:
        """Return all shapes as they are reached from rest, or why there is none.

        Newton's method may end with steps so many times larger than elsewhere.
        """
        reached, on = dict[int, Reached](), Collocation.on(self.system)
        for i, shape in self.session.shapes.items():
            try:
                here = on.from_rest(self.tensions(shape), looser)
                check_stretch(here)
                reached[i] = self.held(i, here)
            except OctoplanError as reason:
                reached[i] = reason
        return reached

    def held(self, i: int, reached: Reached) -> Reached:
        """Return the equilibrium of a shape, of one by lengths with tensions that hold these."""
        shape, n = self.session.shapes[i], self.system.arm.n_tendons
        if isinstance(reached, OctoplanError) or not shape.by_length:
            return reached
        winches = Winches(np.ones(n, dtype=bool), self._lengths(shape), np.zeros(n))
        held = tightened(reached, winches, equilibrium_beside, self.system.arm)
        return held or OctoplanError("no shape near its lengths is found")

    def tensions(self, shape: Measured) -> Array:
        """Return the tensions of a shape (n_tendons,), of one by lengths roughly."""
        if not shape.by_length:
            return np.asarray(self.numbers.scale * np.array(shape.tensions))
        arm, scene, lengths = self.system.arm, self.system.scene, self._lengths(shape)
        return arm.flat(settle(arm, None, scene, _ROUGHLY, lengths=lengths).tensions)

    def _lengths(self, shape: Measured) -> Array:
        """Return what winches leave of the tendons of a shape by lengths [m]."""
        if shape.lengths is not None:
            return np.array(shape.lengths)
        return np.asarray(self.numbers.rest - np.array(shape.strokes))

    def differentiated(self, equilibria: Mapping[int, Linearised]) -> dict[int, ByNumbers]:
        """Return the derivatives of equilibria by shape, and of their tensions."""
        numbers, by = self.derivatives, dict[int, ByNumbers]()
        jacobian = NumberDerivatives(numbers.p, numbers.lengths, numbers.nodes)
        for i, here in equilibria.items():
            shape = self.session.shapes[i]
            if shape.by_length:
                lengths = numbers.rest if shape.strokes is not None else 0.0
                held = ByNumbers(here, jacobian, np.zeros_like(numbers.scale))
                tensions = tensions_by_lengths(here) @ (lengths - held.lengths)
            else:
                tensions = np.array(shape.tensions)[:, None] * numbers.scale
            by[i] = ByNumbers(here, jacobian, tensions)
        return by


def tensions_by_lengths(equilibrium: Linearised) -> Array:
    """Return how tensions change with the lengths that winches leave (n_tendons, n_tendons)."""
    taut = np.ix_(*[equilibrium.tensions > 0] * 2)
    inverse = np.zeros_like(equilibrium.length_tension)
    inverse[taut] = np.linalg.pinv(equilibrium.length_tension[taut], 1e-9)
    return inverse
