"""Measured shapes of one arm, and the equations that they settle by at values of the unknowns.

The numbers of the equations, the places that are looked at and the lengths at rest are closed forms
of the unknowns, put together in NumPy; difference quotients differentiate them, and nothing is
solved for these. Equilibria follow from the equations' own derivatives by their numbers, CasADi's,
by the implicit function theorem. Shapes are settled under the tensions of load cells, or by the
lengths of encoders. Shapes of a session that has unknowns of its own have an arm of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from octoplan.model import InputError, OctoplanError, settle
from octoplan.model.equilibrium.linearised import AnyEquilibrium, Equilibrium, check_stretch
from octoplan.model.equilibrium.load_steps import Collocation
from octoplan.model.equilibrium.sensitivities import ByNumbers
from octoplan.model.extensions.lengths.by_lengths import tightened
from octoplan.model.paths import Array
from octoplan.model.rod.layout import POSE
from octoplan.model.rod.system import DiscreteRod, system
from octoplan.model.winches import Winches, rest_lengths
from octoplan.planner.extensions.fit.measured import Measured
from octoplan.planner.extensions.fit.unknowns import Parameters, neighbour
from octoplan.planner.frontends.io.varied import Setting

Index = NDArray[np.int64]
Reached = Equilibrium | OctoplanError
# Tip error over arm length of shapes by `settle` that a mesh begins with.
_ROUGHLY = 1e-4
# How many times larger than elsewhere the last steps of Newton's method are.
LOOSER = 1e3


class CoarseMeshError(OctoplanError):
    """the mesh of the fit is too coarse for a shape that settles on a finer one"""


class SessionNumbers(NamedTuple):
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


class Experiment:
    """Measured shapes of one arm, with the unknowns of both, on meshes of a refinement.

    Attributes
    ----------
    parameters : Parameters
    shapes : tuple of Measured
    mesh : (refinement, stages, machine_code)
    session : list of str
        Of each shape, whose unknowns it has; "" where that has none of its own.
    rows : list of slice
        Which of the M sensors, those of all shapes one after the other, look at each shape.
    seen : (M, 4)
        Quaternions of the frames that were measured, 0 of what is no frame.
    """

    def __init__(
        self,
        parameters: Parameters,
        shapes: Sequence[Measured],
        refinement: int,
        stages: int,
        machine_code: bool = False,
    ) -> None:
        self.parameters, self.shapes = parameters, tuple(shapes)
        self.mesh = refinement, stages, machine_code
        apart = {unknown.session for unknown in parameters.unknowns}
        self.session = [shape.session if shape.session in apart else "" for shape in shapes]
        sensors = [sensor for shape in shapes for sensor in shape.sensors]
        ends = np.cumsum([0, *(len(shape.sensors) for shape in shapes)]).tolist()
        self.rows = [slice(*pair) for pair in pairwise(ends)]
        self._said = _rows(parameters.given)
        self._point = np.array([sensor.point for sensor in sensors], dtype=np.int64)
        self._s = np.array([sensor.s for sensor in sensors])
        self._offsets = np.array([sensor.offset for sensor in sensors]).reshape(-1, 3)
        self.seen = np.zeros((len(sensors), 4))
        for row, sensor in enumerate(sensors):
            if np.ndim(sensor.value) == 2:
                turned = Rotation.from_matrix(sensor.value)
                self.seen[row] = turned.as_quat(scalar_first=True)
        self._strokes = any(shape.strokes is not None for shape in shapes)
        self._first = dict[str, tuple[DiscreteRod, tuple[float, ...]]]()

    def at(self, values: Array) -> dict[str, SessionEquations]:
        """Return the equations of each session at values (K,); InputError where no arm can be."""
        return {name: self._equations(name, values) for name in dict.fromkeys(self.session)}

    def _equations(self, name: str, values: Array) -> SessionEquations:
        """Return the equations of a session, on the first mesh as it fits the arm of these values.

        Where places have passed each other, on a new one.
        """
        setting = self.parameters.setting(values, name)
        arm, looked_at = setting.arm, self._sensor_places(setting)[0]
        members = [row for row, of in zip(self.rows, self.session, strict=True) if of == name]
        s = np.concatenate([looked_at[row] for row in members])
        if s.size and not 0 <= s.min() <= s.max() <= arm.length * (1 + 1e-12):
            raise InputError("points", np.unique(s).tolist(), f"on the arm, 0 to {arm.length:g} m")
        at = tuple(np.unique(np.minimum(s, arm.length)).tolist())
        refinement, stages, machine_code = self.mesh
        stated = None
        if first := self._first.get(name):
            try:
                stated = neighbour(first[0], arm, setting.scene, first[1], at)
            except InputError:
                del self._first[name]
        if stated is None:
            stated = system(arm, setting.scene, stages, refinement, at, True, machine_code)
            self._first[name] = stated, at
        numbers = self.numbers(setting, stated)
        nodes = np.abs(stated.mesh.s - numbers.s[:, None]).argmin(axis=1)
        return SessionEquations(self, name, values, setting, stated, numbers, nodes)

    def numbers(self, setting: Setting, stated: DiscreteRod) -> SessionNumbers:
        """Return the numbers of equations, and of all sensors as a session's table places them."""
        scale = setting.tension_scale
        return SessionNumbers(
            stated.p,
            stated.length_numbers,
            stated.mesh.s,
            *self._sensor_places(setting),
            scale,
            rest_lengths(stated.arm) if self._strokes else np.zeros_like(scale),
        )

    def _sensor_places(self, setting: Setting) -> tuple[Array, Array]:
        """Return arc lengths (M,) and offsets (M, 3) of what is looked at, as a table has them."""
        moved = (_rows(setting) - self._said)[self._point]
        s = np.where(np.isinf(self._s), setting.arm.length, self._s)
        return s + moved[:, 0], self._offsets + moved[:, 1:]


def _rows(setting: Setting) -> Array:
    """Return arc length and offset of each point (n + 1, 4) [m], and last 0 of what is none."""
    points = [[point["s"], *point["offset"]] for point in setting.points]
    return np.array([*points, np.zeros(4)])


@dataclass(frozen=True, eq=False)
class SessionEquations:
    """The equations of a session's shapes at values (K,) of the unknowns, and their numbers.

    `nodes` (M,) are those that sensors look at.
    """

    experiment: Experiment
    name: str
    values: Array
    setting: Setting
    system: DiscreteRod
    numbers: SessionNumbers
    nodes: Index

    @cached_property
    def derivatives(self) -> SessionNumbers:
        """Derivatives of the numbers by the unknowns, each (..., K), on nodes that move along."""
        parameters, here = self.experiment.parameters, self.setting

        def numbers(values: Array) -> SessionNumbers:
            there, stated = parameters.setting(values, self.name, here), self.system
            if there.arm is not here.arm or there.scene is not here.scene:
                stated = neighbour(stated, there.arm, there.scene)
            return self.experiment.numbers(there, stated)

        return SessionNumbers(
            *parameters.derivatives(numbers, self.numbers, self.values, self.name)
        )

    @property
    def places(self) -> Index:
        """Places of their poses among the states (M, 7)."""
        return np.asarray(self.system.layout.nodes[self.nodes, :POSE])

    def from_rest(self, i: int) -> Reached:
        """Return a shape as the arm reaches it from rest, or the reason why there is none.

        If this mesh has no equilibrium, `settle` decides on meshes of its own: a coarse mesh is
        crushed, or jumps, under tensions that the arm bears.
        """
        shape, mesh = self.experiment.shapes[i], Collocation(self.system)
        if not shape.by_length:
            with suppress(OctoplanError):
                result = mesh.solve(self.tensions(shape), looser=LOOSER)
                check_stretch(result)
                return result
        try:
            settled = self._settled(shape)
        except OctoplanError as reason:
            return reason
        try:
            result = mesh.solve(self.system.arm.flat(settled.tensions), settled)
        except OctoplanError:
            return CoarseMeshError(CoarseMeshError.__doc__)
        return self.held(shape, result)

    def _settled(self, shape: Measured) -> AnyEquilibrium:
        """Return the equilibrium of a shape by `settle`, on a mesh that is fine enough."""
        arm, scene, code = self.system.arm, self.system.scene, self.experiment.mesh[2]
        T = None if shape.by_length else self.tensions(shape)
        lengths = self._lengths(shape) if shape.by_length else None
        return settle(arm, T, scene, _ROUGHLY, compile=code, lengths=lengths).equilibrium

    def held(self, shape: Measured, reached: Reached) -> Reached:
        """Return the equilibrium of a shape, of one by lengths with tensions that hold these."""
        if isinstance(reached, OctoplanError) or not shape.by_length:
            return reached
        n = self.system.arm.n_tendons
        winches = Winches(np.ones(n, dtype=bool), self._lengths(shape), np.zeros(n))
        result = tightened(reached, winches, Collocation(self.system).led_to, self.system.arm)
        return result or OctoplanError("no shape near its lengths is found")

    def tensions(self, shape: Measured) -> Array:
        """Return the tensions of a shape whose tensions were measured (n_tendons,)."""
        return np.asarray(self.numbers.scale * np.array(shape.tensions))

    def _lengths(self, shape: Measured) -> Array:
        """Return what winches leave of the tendons of a shape by lengths [m]."""
        if shape.lengths is not None:
            return np.array(shape.lengths)
        return np.asarray(self.numbers.rest - np.array(shape.strokes))

    def differentiated(self, shape: Measured, equilibrium: Equilibrium) -> ByNumbers:
        """Return the derivatives of the equilibrium of a shape by the unknowns."""
        by = self.derivatives
        numbers = by.p, by.lengths
        if not shape.by_length:
            return ByNumbers(equilibrium, *numbers, np.array(shape.tensions)[:, None] * by.scale)
        lengths = by.rest if shape.strokes is not None else 0.0
        held = ByNumbers(equilibrium, *numbers, np.zeros_like(by.scale))
        tensions = tensions_by_lengths(equilibrium) @ (lengths - held.lengths)
        return ByNumbers(equilibrium, *numbers, tensions)


def tensions_by_lengths(equilibrium: Equilibrium) -> Array:
    """Return how tensions change with the lengths that winches leave (n_tendons, n_tendons)."""
    taut = equilibrium.tensions > 0
    among_taut = np.where(np.outer(taut, taut), equilibrium.length_tension, 0.0)
    return np.linalg.pinv(among_taut, 1e-9)
