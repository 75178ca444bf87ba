"""Equilibria of measured shapes at values of the unknowns, and their derivatives by these.

The numbers of the equations, the places that are looked at and the lengths at rest are closed forms
of the unknowns, put together in NumPy; difference quotients differentiate them, and nothing is
solved for these. Equilibria follow from the equations' own derivatives by their numbers, CasADi's,
by the implicit function theorem. Shapes are settled under the tensions of load cells, or by the
lengths of encoders.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from model import Arm, InputError, OctoplanError, Scene, settle
from model.by_lengths import equilibrium_beside, tightened
from model.equilibrium.equilibrium import Collocated, check_stretch
from model.equilibrium.forward import Collocation
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import CLOSE, newton
from model.equilibrium.sensitivities import ByNumbers
from model.paths import Array
from model.transcription.layout import POSE
from model.transcription.neighbours import NumberDerivatives, neighbour
from model.transcription.system import System, system
from model.winches import Winches, rest_lengths
from planner.fit.measured import Measured
from planner.fit.unknowns import MM, Parameters

Index = NDArray[np.int64]
Reached = Linearised | OctoplanError
# Tip error over arm length of the shapes by lengths whose tensions are then corrected.
_ROUGHLY = 1e-4
# How many times larger than elsewhere the last steps of Newton's method are.
_LOOSER = 1e3
# In place of a point's number.
TIP, FRAME = -1, -2


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


class Family:
    """The shapes of a session, whose arm is one at any values of the unknowns.

    Attributes
    ----------
    shapes : tuple of Measured
    shape, point : (M,)
        Of each marker, tip and frame that is looked at: the number of its shape, and of its point,
        TIP or FRAME.
    """

    def __init__(
        self,
        parameters: Parameters,
        session: str,
        shapes: Sequence[Measured],
        refinement: int,
        stages: int,
        machine_code: bool,
    ) -> None:
        self.parameters, self.session, self.shapes = parameters, session, tuple(shapes)
        self.mesh, self._said = (refinement, stages, machine_code), parameters.table["points"]
        self._strokes = any(shape.strokes is not None for shape in shapes)
        rows = [(k, *row) for k, shape in enumerate(shapes) for row in _looked_at(shape)]
        self.shape = np.array([row[0] for row in rows], dtype=np.int64)
        self.point = np.array([row[1] for row in rows], dtype=np.int64)
        self._s = np.array([row[2] for row in rows], dtype=float)
        self._offsets = np.array([row[3] for row in rows], dtype=float).reshape(-1, 3)
        self._first: tuple[System, tuple[float, ...]] | None = None

    def at(self, values: Array) -> Setting:
        """Return the equations at values (K,) of the unknowns; InputError where no arm can be.

        On the first mesh as it fits this arm; where places have passed each other, on a new one.
        """
        table, (arm, scene) = self._of(values)
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
        return Setting(self, values, stated, self._numbers(stated, table))

    def derivatives(self, setting: Setting) -> Numbers:
        """Return the derivatives of numbers by the unknowns (K,), on nodes that move along."""
        old = setting.system

        def numbers(values: Array) -> Numbers:
            table, (arm, scene) = self._of(values)
            stated = old
            if (arm, scene) != (old.arm, old.scene):
                stated = neighbour(old, arm, scene)
            return self._numbers(stated, table)

        arguments = numbers, setting.numbers, setting.values, self.session
        return Numbers(*self.parameters.derivatives(*arguments))

    def _of(self, values: Array) -> tuple[dict[str, Any], tuple[Arm, Scene]]:
        table = self.parameters.table_at(values, self.session)
        return table, self.parameters.built(values, self.session)

    def _shift(self, table: dict[str, Any], key: str, size: tuple[int, ...] = ()) -> Array:
        """Return by how much a key of the points looked at is off what it is said to be [m]."""
        shift = np.zeros((self.point.size, *size))
        for i, (now, said) in enumerate(zip(table["points"], self._said, strict=True)):
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


def _looked_at(shape: Measured) -> list[tuple[int, float, Any]]:
    """Return point, arc length [m] and offset [m] of the markers seen, of the tip and of frames."""
    points = [(i, point.s, point.offset) for i, point in shape.seen]
    tip = [(TIP, 0.0, np.zeros(3))] * (shape.tip is not None)
    return [*points, *tip, *((FRAME, frame.s, np.zeros(3)) for frame in shape.frames)]


@dataclass(frozen=True, eq=False)
class Setting:
    """The equations of a family at values (K,) of the unknowns, and their numbers."""

    family: Family
    values: Array
    system: System
    numbers: Numbers

    @cached_property
    def derivatives(self) -> Numbers:
        """Derivatives of the numbers by the unknowns, each (..., K)."""
        return self.family.derivatives(self)

    @property
    def nodes(self) -> Index:
        """The nodes that are looked at (M,)."""
        return np.asarray(np.abs(self.system.mesh.s - self.numbers.s[:, None]).argmin(axis=1))

    @property
    def places(self) -> Index:
        """Places of their poses among the states (M, 7)."""
        return np.asarray(self.system.of.nodes[self.nodes, :POSE])

    def from_rest(self) -> list[Reached]:
        """Return all shapes as they are reached from rest, or why there is none."""
        tensions = [self._tensions(shape) for shape in self.family.shapes]
        return [
            self._held(shape, self._settled(T)) if isinstance(T, np.ndarray) else T
            for shape, T in zip(self.family.shapes, tensions, strict=True)
        ]

    def near(
        self, which: Sequence[int], before: Sequence[Linearised], ahead: Array, more: Array
    ) -> list[Reached]:
        """Return some shapes near their equilibria at other values of the unknowns.

        Newton's method begins where their derivatives say that they are now: states farther by
        `ahead` (N, n_states), tensions of those by lengths higher by `more` (N, n_tendons); where
        the mesh is another, with the strains on that.
        """
        shapes, of = [self.family.shapes[i] for i in which], self.system.of
        rows = zip(shapes, before, more, strict=True)
        T = np.array(
            [
                np.maximum(equilibrium.tensions + change, 0.0)
                if shape.by_length
                else self._tensions(shape)
                for shape, equilibrium, change in rows
            ]
        )
        nearby: list[Linearised | None] = [None] * len(T)
        if of is before[0].system.of:
            guesses = np.array([equilibrium.states for equilibrium in before]) + ahead
            turns = np.abs(ahead[:, of.nodes[:, :4].ravel()]).max(axis=1)
            nearby = [
                equilibrium if turn < CLOSE else None
                for equilibrium, turn in zip(before, turns, strict=True)
            ]
        else:
            on = Collocation.on(self.system)
            pairs = zip(T, before, strict=True)
            guesses = np.array(
                [on.carried(tensions, equilibrium) for tensions, equilibrium in pairs]
            )
        jumps = OctoplanError("it jumps")
        solutions = [
            newton(self.system, tensions, 1.0, guess, near=near, looser=_LOOSER)
            for tensions, guess, near in zip(T, guesses, nearby, strict=True)
        ]
        return [
            self._held(shape, equilibrium or jumps)
            for shape, equilibrium in zip(shapes, solutions, strict=True)
        ]

    def differentiated(
        self, which: Sequence[int], equilibria: Sequence[Linearised]
    ) -> list[ByNumbers]:
        """Return the derivatives of equilibria of some shapes, and of their tensions."""
        numbers, derivatives = self.derivatives, list[ByNumbers]()
        jacobian = NumberDerivatives(numbers.p, numbers.lengths, numbers.nodes)
        still = np.zeros((self.system.of.n_tendons, len(self.values)))
        for i, here in zip(which, equilibria, strict=True):
            by = ByNumbers(here, jacobian, still)
            shape, tensions = self.family.shapes[i], still
            if shape.by_length:
                left = numbers.rest if shape.strokes is not None else 0.0
                tensions = self.tensions_by_lengths(here) @ (left - by.lengths)
            else:
                tensions = np.array(shape.tensions)[:, None] * numbers.scale
            derivatives.append(ByNumbers(here, jacobian, tensions))
        return derivatives

    @staticmethod
    def tensions_by_lengths(equilibrium: Linearised) -> Array:
        """Return how tensions change with the lengths that winches leave (n_tendons, n_tendons)."""
        taut = equilibrium.tensions > 0
        inverse = np.zeros((taut.size, taut.size))
        inverse[np.ix_(taut, taut)] = np.linalg.pinv(
            equilibrium.length_tension[np.ix_(taut, taut)], 1e-9
        )
        return inverse

    def _left(self, shape: Measured) -> Array:
        """Return what winches leave of the tendons of a shape settled by lengths [m]."""
        if shape.lengths is not None:
            return np.array(shape.lengths)
        return np.asarray(self.numbers.rest - np.array(shape.strokes))

    def _tensions(self, shape: Measured) -> Array | OctoplanError:
        """Return the tensions of a shape (n_tendons,), those by lengths roughly."""
        arm, scene = self.system.arm, self.system.scene
        if not shape.by_length:
            return np.asarray(self.numbers.scale * np.array(shape.tensions))
        try:
            return arm.flat(settle(arm, None, scene, _ROUGHLY, lengths=self._left(shape)).tensions)
        except OctoplanError as reason:
            return reason

    def _settled(self, tensions: Array) -> Reached:
        """Return the equilibrium under tensions (n_tendons,) from rest, or why there is none."""
        try:
            end = Collocation.on(self.system).from_rest(tensions)
            check_stretch(Collocated(end, 0))
        except OctoplanError as reason:
            return reason
        return end

    def _held(self, shape: Measured, equilibrium: Reached) -> Reached:
        """Return the equilibrium of a shape by lengths with tensions under which they hold."""
        if isinstance(equilibrium, OctoplanError) or not shape.by_length:
            return equilibrium
        n = self.system.arm.n_tendons
        winches = Winches(np.ones(n, dtype=bool), self._left(shape), np.zeros(n))
        held = tightened(equilibrium, winches, equilibrium_beside, self.system.arm)
        return held or OctoplanError("no shape near its lengths is found")
