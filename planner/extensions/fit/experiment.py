"""Measured shapes of one arm, and their equilibrium equations at values of the unknowns.

The parameters of the equations, the sensor positions and the tendon lengths at rest are closed-form
functions of the unknowns in NumPy, without solving equations; difference quotients differentiate
them. The derivatives of equilibria follow from the equations' parameter derivatives (CasADi), by
the implicit function theorem. Shapes are settled under measured tensions (load cells) or measured
lengths (encoders). A session with unknowns of its own has an arm of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from octoplan.model import InputError, OctoplanError, settle
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.linearised import AnyEquilibrium, Equilibrium, check_stretch
from octoplan.model.extensions.lengths.by_lengths import solve_lengths
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod, system
from octoplan.model.rotations import POSE
from octoplan.model.tendons import rest_lengths
from octoplan.planner.extensions.fit.drives import Drive, SessionParameters
from octoplan.planner.extensions.fit.measured import Measured
from octoplan.planner.extensions.fit.unknowns import Parameters, neighbour
from octoplan.planner.frontends.io.varied import Setting

Index = NDArray[np.int64]
Reached = Equilibrium | OctoplanError
# Accuracy, tip error over arm length, of the `settle` calls that initialise a mesh.
_ROUGHLY = 1e-4
# Factor of the step tolerance of Newton's method.
LOOSER = 1e3


class CoarseMeshError(OctoplanError):
    """the mesh of the fit is too coarse for a shape that settles on a finer one"""


class Experiment:
    """Measured shapes of one arm, with unknowns, on meshes of one refinement.

    Attributes
    ----------
    parameters : Parameters
    shapes : tuple of Measured
    mesh : (refinement, stages, machine_code)
    session : list of str
        Session of each shape if the session has unknowns of its own, otherwise "".
    rows : list of slice
        Sensors of each shape, among the M sensors of all shapes.
    measured_rotations : (M, 4)
        Quaternions of the measured frames, 0 for sensors that measure a position.
    """

    def __init__(
        self,
        parameters: Parameters,
        shapes: Sequence[Measured],
        refinement: int,
        stages: int,
        machine_code: bool = False,
    ) -> None:
        self.parameters = parameters
        self.shapes = tuple(shapes)
        self.mesh = refinement, stages, machine_code
        own = {unknown.session for unknown in parameters.unknowns}
        self.session = [shape.session if shape.session in own else "" for shape in shapes]
        sensors = [sensor for shape in shapes for sensor in shape.sensors]
        ends = np.cumsum([0, *(len(shape.sensors) for shape in shapes)]).tolist()
        self.rows = [slice(*pair) for pair in pairwise(ends)]
        self._given_points = _points(parameters.given)
        self._point = np.array([sensor.point for sensor in sensors], dtype=np.int64)
        self._s = np.array([sensor.s for sensor in sensors])
        self._offsets = np.array([sensor.offset for sensor in sensors]).reshape(-1, 3)
        self.measured_rotations = np.zeros((len(sensors), 4))
        for row, sensor in enumerate(sensors):
            if np.ndim(sensor.value) == 2:
                rotation = Rotation.from_matrix(sensor.value)
                self.measured_rotations[row] = rotation.as_quat(scalar_first=True)
        self._strokes = any(shape.strokes is not None for shape in shapes)
        self._first = dict[str, tuple[DiscreteRod, tuple[float, ...]]]()

    def at(self, values: Array) -> dict[str, SessionEquations]:
        """Return the equations of each session at values (K,), or raise InputError."""
        return {name: self._equations(name, values) for name in dict.fromkeys(self.session)}

    def _equations(self, name: str, values: Array) -> SessionEquations:
        """Return the equations of a session, on its first mesh deformed to the arm of these values.

        If places along the arm have passed each other, a new mesh is made.
        """
        setting = self.parameters.setting(values, name)
        arm = setting.arm
        sensor_s = self._sensor_places(setting)[0]
        members = [row for row, of in zip(self.rows, self.session, strict=True) if of == name]
        s = np.concatenate([sensor_s[row] for row in members])
        if s.size and not 0 <= s.min() <= s.max() <= arm.length * (1 + 1e-12):
            raise InputError("points", np.unique(s).tolist(), f"on the arm, 0 to {arm.length:g} m")
        at = tuple(np.unique(np.minimum(s, arm.length)).tolist())
        refinement, stages, machine_code = self.mesh
        equations = None
        if first := self._first.get(name):
            try:
                equations = neighbour(first[0], arm, setting.scene, first[1], at)
            except InputError:
                del self._first[name]
        if equations is None:
            equations = system(arm, setting.scene, stages, refinement, at, True, machine_code)
            self._first[name] = equations, at
        parameters = self.session_parameters(setting, equations)
        return SessionEquations(
            experiment=self,
            name=name,
            values=values,
            setting=setting,
            system=equations,
            parameters=parameters,
            nodes=np.abs(equations.mesh.s - parameters.s[:, None]).argmin(axis=1),
        )

    def session_parameters(self, setting: Setting, equations: DiscreteRod) -> SessionParameters:
        """Return the parameters of the equations and of all sensors for a setting."""
        s, offsets = self._sensor_places(setting)
        scale = setting.tension_scale
        winches = setting.winches
        return SessionParameters(
            p=equations.p,
            lengths=equations.length_p,
            nodes=equations.mesh.s,
            s=s,
            offsets=offsets,
            scale=scale,
            rest=rest_lengths(equations.arm) if self._strokes else np.zeros_like(scale),
            zero=np.array(winches.zero),
            tendon_EA=np.array(winches.tendon_EA or 0.0),
            outside=np.array(winches.outside),
        )

    def _sensor_places(self, setting: Setting) -> tuple[Array, Array]:
        """Return arc lengths (M,) and offsets (M, 3) of the sensors for a setting [m]."""
        moved = (_points(setting) - self._given_points)[self._point]
        s = np.where(np.isinf(self._s), setting.arm.length, self._s)
        return s + moved[:, 0], self._offsets + moved[:, 1:]


def _points(setting: Setting) -> Array:
    """Return arc length and offset of each point [m], and a row of zeros for others (n + 1, 4)."""
    points = [[point["s"], *point["offset"]] for point in setting.points]
    return np.array([*points, np.zeros(4)])


@dataclass(frozen=True, eq=False)
class SessionEquations:
    """Equilibrium equations of a session's shapes at values (K,) of the unknowns.

    Attributes
    ----------
    experiment : Experiment
    name : str
        Name of the session.
    values : (K,)
    setting : Setting
        Arm, scene and sensors of the values.
    system : DiscreteRod
        Equations on a mesh that has the sensors as nodes.
    parameters : SessionParameters
    nodes : (M,)
        Node of each sensor.
    """

    experiment: Experiment
    name: str
    values: Array
    setting: Setting
    system: DiscreteRod
    parameters: SessionParameters
    nodes: Index

    @cached_property
    def derivatives(self) -> SessionParameters:
        """Derivatives of the parameters with respect to the unknowns, on nodes that move."""
        unknowns = self.experiment.parameters
        here = self.setting

        def at(values: Array) -> SessionParameters:
            there = unknowns.setting(values, self.name, here)
            equations = self.system
            if there.arm is not here.arm or there.scene is not here.scene:
                equations = neighbour(equations, there.arm, there.scene)
            return self.experiment.session_parameters(there, equations)

        return SessionParameters(*unknowns.derivatives(at, self.parameters, self.values, self.name))

    @property
    def pose_indices(self) -> Index:
        """Indices of the sensors' poses among the states (M, 7)."""
        return np.asarray(self.system.layout.nodes[self.nodes, :POSE])

    def from_rest(self, i: int) -> Reached:
        """Settle a shape from rest; return the equilibrium or the error.

        If this mesh has no equilibrium, `settle` decides on its own meshes: a coarse mesh may be
        crushed or jump under tensions that the arm bears.
        """
        shape = self.experiment.shapes[i]
        mesh = CollocationMap(self.system)
        if not shape.by_length:
            with suppress(OctoplanError):
                result = mesh.solve(self.drive(shape).tensions, tolerance_factor=LOOSER)
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
        return self.enforce_lengths(shape, result)

    def _settled(self, shape: Measured) -> AnyEquilibrium:
        """Settle a shape with `settle`, which refines the mesh as needed."""
        arm = self.system.arm
        scene = self.system.scene
        code = self.experiment.mesh[2]
        drive = self.drive(shape)
        if not shape.by_length:
            return settle(arm, drive.tensions, scene, _ROUGHLY, compile=code).equilibrium
        winches = drive.winches
        return settle(
            arm,
            np.where(winches.held, np.nan, winches.tensions),
            scene,
            _ROUGHLY,
            compile=code,
            lengths=np.where(winches.held, winches.lengths, np.nan),
            tendon_EA=None if np.isinf(winches.tendon_EA) else winches.tendon_EA,
            tendon_outside=winches.outside,
        ).equilibrium

    def enforce_lengths(self, shape: Measured, reached: Reached) -> Reached:
        """Adapt the tensions of an equilibrium to the lengths, if winches hold tendons."""
        if isinstance(reached, OctoplanError) or not shape.by_length:
            return reached
        winches = self.drive(shape).winches
        result = solve_lengths(
            reached, winches, CollocationMap(self.system).solve_from, self.system.arm
        )
        return result or OctoplanError("no shape near its lengths is found")

    def drive(self, shape: Measured) -> Drive:
        """Return the tendons of a shape."""
        return Drive(shape, self.parameters)
