"""Shapes of one arm at values of the unknowns: its equations, equilibria and their derivatives.

The equations, the places that are looked at and the lengths at rest are numbers that depend on the
unknowns, and are differentiated together. Equilibria follow from the equations' derivatives by
these numbers, by the implicit function theorem.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from model import Arm, InputError, OctoplanError, Scene
from model.cross_section.reported import kinematics
from model.equilibrium.by_numbers import ByNumbers, by_numbers
from model.equilibrium.dense import poses_and_strains
from model.equilibrium.equilibrium import Collocated
from model.equilibrium.forward import Collocation
from model.equilibrium.linearised import Linearised, linearised
from model.equilibrium.newton import newton_many
from model.loads import is_loaded
from model.machine.buffered import Mapped
from model.mesh import Mesh
from model.paths import Array
from model.rotations import multiply, rotate
from model.transcription.layout import POSE
from model.transcription.neighbours import NumberDerivatives, keep_sign, landmarks, moved_mesh
from model.transcription.system import System, system
from model.unloaded.stretch import check_stretch
from model.winches import rest_lengths
from planner.fit.unknowns import Parameters

MM = 1e-3
# The arc lengths (S,) [m] of an arm and the table of its values that sensors or targets look at.
Stations = Callable[[Arm, dict[str, Any]], Array]


class Numbers(NamedTuple):
    """What equations and sensors take of the unknowns; of derivatives each with K columns more.

    Numbers of the equations (n_p,) and of the tendons' lengths (n,), arc lengths of the nodes
    (N + 1,) and of the stations (S,), by how much the points' offsets are off what they were said
    to be (P, 3) [m], scale and lengths at rest [m] of the tendons (n_tendons,).
    """

    p: Array
    lengths: Array
    nodes: Array
    s: Array
    offsets: Array
    scale: Array
    rest: Array


class Equations:
    """The equations of a session's arm, on meshes whose nodes move along with the unknowns.

    `stations` are nodes; lengths at rest are worked out where there are `strokes`.
    """

    def __init__(
        self,
        parameters: Parameters,
        session: str,
        stations: Stations,
        refinement: int,
        stages: int,
        machine_code: bool = False,
        strokes: bool = False,
    ) -> None:
        self.parameters, self.session, self.stations = parameters, session, stations
        self.strokes = strokes
        self.refinement, self.stages, self.machine_code = refinement, stages, machine_code
        self._first: tuple[Mesh, Array, Array] | None = None

    def at(self, values: Array) -> Setting:
        """Return the equations at values (K,) of the unknowns; InputError where no arm can be.

        On the first mesh as it fits this arm; where places have passed each other, on a new one.
        """
        table = self.parameters.table_at(values, self.session)
        arm, scene = self.parameters.built(values, self.session)
        places = np.unique(self.stations(arm, table))
        if places.size and not 0 <= places[0] <= places[-1] <= arm.length * (1 + 1e-12):
            raise InputError("points", places.tolist(), f"on the arm, 0 to {arm.length:g} m")
        at = tuple(np.minimum(places, arm.length).tolist())
        marks = landmarks(arm, scene, at)
        if self._first is not None:
            mesh, old, base = self._first
            try:
                stated = self._stated(arm, scene, moved_mesh(mesh, old, marks), base)
            except InputError:
                self._first = None
        if self._first is None:
            form = self.stages, self.refinement, at, True, self.machine_code
            stated = system(arm, scene, *form)
            self._first = stated.mesh, marks, stated.base
        return Setting(self, values, stated, self._numbers(stated, table))

    def derivatives(self, here: Setting) -> Numbers:
        """Return the derivatives of numbers by the unknowns (K,), on nodes that move along."""
        old = here.system
        marks = landmarks(old.arm, old.scene)

        def numbers(values: Array) -> Numbers:
            arm, scene = self.parameters.built(values, self.session)
            mesh = moved_mesh(old.mesh, marks, landmarks(arm, scene))
            table = self.parameters.table_at(values, self.session)
            return self._numbers(self._stated(arm, scene, mesh, old.base), table)

        return Numbers(*self.parameters.derivatives(numbers, here.values, self.session))

    def _stated(self, arm: Arm, scene: Scene, mesh: Mesh, base: Array) -> System:
        stated = System(arm, scene, mesh, self.stages, machine_code=self.machine_code)
        keep_sign(stated.base, base)
        return stated

    def _numbers(self, stated: System, table: dict[str, Any]) -> Numbers:
        offsets = [
            MM * np.array([point["offset_mm"] for point in own["points"]]).reshape(-1, 3)
            for own in (table, self.parameters.table)
        ]
        return Numbers(
            stated.p,
            stated.length_numbers,
            stated.mesh.s,
            self.stations(stated.arm, table),
            offsets[0] - offsets[1],
            np.array(table["tension_scale"], dtype=float),
            rest_lengths(stated.arm) if self.strokes else np.zeros(stated.arm.n_tendons),
        )


@dataclass(frozen=True, eq=False)
class Setting:
    """The equations at values (K,) of the unknowns, and their numbers."""

    equations: Equations
    values: Array
    system: System
    numbers: Numbers

    @cached_property
    def derivatives(self) -> Numbers:
        """Derivatives of the numbers by the unknowns, each (..., K)."""
        return self.equations.derivatives(self)

    def from_rest(self, tensions: Array) -> list[Linearised | OctoplanError]:
        """Return the equilibria under tensions (N, n_tendons) as they are reached from rest.

        Or why there is none.
        """
        forward, equilibria = Collocation.on(self.system), list[Linearised | OctoplanError]()
        if is_loaded(self.system.scene):
            equilibria += forward.from_rest_many(tensions)
        else:
            for T in tensions:
                try:
                    equilibria.append(forward.found(T))
                except OctoplanError as reason:
                    equilibria.append(reason)
        for i, here in enumerate(equilibria):
            if isinstance(here, Linearised):
                try:
                    check_stretch(Collocated(here, 0))
                except OctoplanError as reason:
                    equilibria[i] = reason
        return equilibria

    def near(
        self, tensions: Array, before: Sequence[ByNumbers], change: Array
    ) -> list[Linearised | None]:
        """Return the equilibria under tensions (N, n_tendons) near others.

        Those were found before a change (K,) of the unknowns, and Newton's method begins where
        their derivatives say that they are now; None where that does not lead to one nearby. Where
        the mesh is a new one it begins with the strains on the old one.
        """
        if not before:
            return []
        if self.system.of is before[0].here.system.of:
            guesses = [
                by.here.states
                + by.states @ change
                + by.here.by_tensions @ (T - by.here.tensions - by.tensions @ change)
                for T, by in zip(tensions, before, strict=True)
            ]
        else:
            on, heres = Collocation.on(self.system), [by.here for by in before]
            guesses = [on.carried(T, own) for T, own in zip(tensions, heres, strict=True)]
        return newton_many(self.system, tensions, 1.0, np.array(guesses)).solutions

    def differentiated(
        self, heres: Sequence[Linearised], tensions: Sequence[Array]
    ) -> list[ByNumbers]:
        """Return the derivatives of equilibria, whose tensions have theirs (n_tendons, K)."""
        numbers = self.derivatives
        jacobian = NumberDerivatives(numbers.p, numbers.lengths, numbers.nodes)
        fresh = linearised(self.system, np.array([here.x for here in heres])) if heres else []
        return by_numbers(fresh, jacobian, tensions)

    @cached_property
    def places(self) -> NDArray[np.int64]:
        """Places of the stations' poses among the states (S, 7)."""
        return np.asarray(self.system.of.nodes[self._nodes, :POSE])

    @cached_property
    def _nodes(self) -> NDArray[np.int64]:
        return np.asarray(np.abs(self.system.mesh.s - self.numbers.s[:, None]).argmin(axis=1))

    def poses(self, heres: Sequence[Linearised]) -> Array:
        """Return the poses of shapes at the stations (N, S, 7)."""
        return np.array([here.states[self.places] for here in heres])

    def pose_derivatives(self, rows: Sequence[ByNumbers]) -> Array:
        """Return the derivatives of poses at the stations by the unknowns (N, S, 7, K).

        The nodes of the mesh move with the unknowns, stations as they do themselves.
        """
        derivatives = np.array([by.states[self.places] for by in rows])
        slip = self.derivatives.s - self.derivatives.nodes[self._nodes]
        if not slip.any():
            return derivatives
        s, law, rates = self.system.mesh.s[self._nodes], self.system.of.form.law, []
        for by in rows:
            poses, v = poses_and_strains(self.system, by.here.x, s)
            rates.append(_along()(poses, *kinematics(law, v))[0])
        return np.asarray(derivatives + np.array(rates)[..., None] * slip[:, None, :])


@lru_cache(maxsize=1)
def _along() -> Mapped:
    """Return (pose, kappa, nu) -> how the pose changes along the arm (7,) [1/m]."""
    g, kappa, nu = ca.SX.sym("g", POSE), ca.SX.sym("kappa", 3), ca.SX.sym("nu", 3)
    turned = multiply(g[:4], ca.vertcat(0, kappa)) / 2
    return Mapped(ca.Function("along", [g, kappa, nu], [ca.vertcat(turned, rotate(g[:4], nu))]))
