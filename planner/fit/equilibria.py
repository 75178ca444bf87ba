"""Shapes of one arm at given values of the unknowns: its equations, equilibria and derivatives.

The equations of a session are stated once for values; they, the places of sensors and the lengths
at rest are numbers that depend on the unknowns, and are differentiated together. Equilibria follow
from the equations' derivatives by these numbers, by the implicit function theorem.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from model import Arm, InputError, OctoplanError, Scene, settle
from model.cross_section.reported import kinematics
from model.equilibrium.by_numbers import ByNumbers, by_numbers
from model.equilibrium.dense import poses_and_strains
from model.equilibrium.forward import Collocation, Known
from model.equilibrium.linearised import Linearised, linearised
from model.equilibrium.newton import newton_many
from model.loads import is_loaded
from model.machine.buffered import Mapped
from model.mesh import Mesh
from model.paths import Array
from model.rotations import multiply, rotate
from model.transcription.layout import POSE
from model.transcription.neighbours import (
    NumberDerivatives,
    keep_sign,
    landmarks,
    moved_mesh,
)
from model.transcription.system import System, system
from model.unloaded.stretch import check_stretch
from model.winches import rest_lengths
from planner.fit.measured import Measured
from planner.fit.unknowns import Parameters

MM = 1e-3
# Of difference quotients, over the bounds' range and over the value. Numbers of the equations are
# low powers of the unknowns, and not settled for: the quotients are good to nine digits.
_STEP, _SMALL = 1e-5, 1e-4
# Central, then to either side, of second order: (steps off, weight times step).
_STENCILS = (
    ((1, 0.5), (-1, -0.5)),
    ((0, -1.5), (1, 2.0), (2, -0.5)),
    ((0, 1.5), (-1, -2.0), (-2, 0.5)),
)
# Corrections of tensions until lengths hold, and the change over the tensions that is none.
_CORRECTIONS, _HELD = 20, 1e-9
# Of shapes whose tensions lengths are corrected from, tip error over arm length.
_ROUGHLY = 1e-4


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

    `stations` returns the arc lengths (S,) [m] that sensors, or targets, look at; they are nodes.
    """

    def __init__(
        self,
        parameters: Parameters,
        session: str,
        stations: Stations,
        refinement: int,
        stages: int,
        machine_code: bool = False,
    ) -> None:
        self.parameters, self.session, self.stations = parameters, session, stations
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
            stated = system(arm, scene, self.stages, self.refinement, at, True, self.machine_code)
            self._first = stated.mesh, marks, stated.base
        return Setting(self, values, stated, self._numbers(stated, table))

    def derivatives(self, here: Setting) -> Numbers:
        """Return the derivatives of numbers by the unknowns (K,)."""
        columns = [self._by_unknown(here, k) for k in range(here.values.size)]
        return Numbers(*(np.stack(parts, axis=-1) for parts in zip(*columns, strict=True)))

    def _by_unknown(self, here: Setting, k: int) -> Numbers:
        unknown, value = self.parameters.unknowns[k], float(here.values[k])
        if not unknown.belongs(self.session):
            return Numbers(*(np.zeros_like(part) for part in here.numbers))
        h = max(
            min(_STEP * unknown.range, _SMALL * abs(value) or np.inf), 1e-3 * _STEP * unknown.range
        )
        problem: InputError | None = None
        for stencil in _STENCILS:
            try:
                rows = [self._beside(here, k, off * h) for off, _ in stencil]
            except InputError as reason:
                problem = problem or reason
                continue
            weights = [weight / h for _, weight in stencil]
            parts = zip(*rows, strict=True)
            return Numbers(*(np.einsum("i,i...->...", weights, np.array(part)) for part in parts))
        assert problem is not None
        raise problem

    def _beside(self, here: Setting, k: int, step: float) -> Numbers:
        """Return the numbers where an unknown is a step off, on the nodes that move along."""
        values, old = here.values.copy(), here.system
        values[k] += step
        arm, scene = self.parameters.built(values, self.session)
        marks = (landmarks(own.arm, own.scene) for own in (old, _Pair(arm, scene)))
        stated = self._stated(arm, scene, moved_mesh(old.mesh, *marks), old.base)
        return self._numbers(stated, self.parameters.table_at(values, self.session))

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
            rest_lengths(stated.arm),
        )


class _Pair(NamedTuple):
    arm: Arm
    scene: Scene


@dataclass(frozen=True, eq=False)
class Setting:
    """The equations of a session at values (K,) of the unknowns, and their numbers."""

    equations: Equations
    values: Array
    system: System
    numbers: Numbers

    @cached_property
    def derivatives(self) -> Numbers:
        """Derivatives of the numbers by the unknowns, each (..., K)."""
        return self.equations.derivatives(self)

    @cached_property
    def places(self) -> NDArray[np.int64]:
        """Places of the stations' poses among the states (S, 7)."""
        nodes = np.abs(self.system.mesh.s - self.numbers.s[:, None]).argmin(axis=1)
        return np.asarray(self.system.of.nodes[nodes, :POSE])

    def poses(self, heres: Sequence[Linearised]) -> Array:
        """Return the poses of shapes at the stations (N, S, 7)."""
        return np.array([here.states[self.places] for here in heres])

    def pose_derivatives(self, rows: Sequence[ByNumbers]) -> Array:
        """Return the derivatives of poses at the stations by the unknowns (N, S, 7, K).

        The nodes of the mesh move with the unknowns, stations as they do themselves.
        """
        derivatives = np.array([by.states[self.places] for by in rows])
        nodes = np.searchsorted(self.system.of.nodes[:, 0], self.places[:, 0])
        slip = self.derivatives.s - self.derivatives.nodes[nodes]
        if not slip.any():
            return derivatives
        s, law, rates = self.system.mesh.s[nodes], self.system.of.form.law, []
        for by in rows:
            poses, v = poses_and_strains(self.system, by.here.x, s)
            rates.append(_along()(poses, *kinematics(law, v))[0])
        return np.asarray(derivatives + np.array(rates)[..., None] * slip[:, None, :])

    def tensions(self, shapes: Sequence[Measured]) -> Array:
        """Return the tensions of shapes (N, n_tendons) [N]; nan of those settled by lengths."""
        nothing = np.full(self.system.arm.n_tendons, np.nan)
        rows = [nothing if own.by_length else np.array(own.tensions) for own in shapes]
        return np.asarray(self.numbers.scale * np.array(rows).reshape(-1, nothing.size))

    def lengths(self, shape: Measured) -> Array:
        """Return what winches leave of the tendons of a shape settled by lengths [m]."""
        if shape.lengths is not None:
            return np.array(shape.lengths)
        return np.asarray(self.numbers.rest - np.array(shape.strokes))

    def from_rest(self, shapes: Sequence[Measured]) -> list[Linearised | OctoplanError]:
        """Return the equilibria of shapes as they are reached from rest, or why there is none."""
        forward, T = Collocation.on(self.system), self.tensions(shapes)
        found: dict[int, Linearised | OctoplanError] = {}
        for i, shape in enumerate(shapes):
            try:
                if shape.by_length:
                    arm, scene, lengths = self.system.arm, self.system.scene, self.lengths(shape)
                    T[i] = np.ravel(settle(arm, None, scene, _ROUGHLY, lengths=lengths).tensions)
                if not is_loaded(self.system.scene):
                    found[i] = forward.found(T[i])
            except OctoplanError as reason:
                found[i] = reason
        left = [i for i in range(len(shapes)) if i not in found]
        if left:
            found.update(zip(left, forward.from_rest_many(T[left]), strict=True))
        for i, here in found.items():
            if isinstance(here, Linearised):
                try:
                    check_stretch(forward, forward.stretch(here.states))
                except OctoplanError as reason:
                    found[i] = reason
        held = {i: here for i, here in found.items() if isinstance(here, Linearised)}
        exact = self._held([shapes[i] for i in held], list(held.values()))
        for i, end in zip(held, exact, strict=True):
            found[i] = end or OctoplanError("no shape near its lengths is found")
        return [found[i] for i in range(len(shapes))]

    def near(
        self, shapes: Sequence[Measured], before: Sequence[ByNumbers], change: Array
    ) -> list[Linearised | None]:
        """Return the equilibria of shapes near those before a change (K,) of the unknowns.

        By Newton's method from where derivatives predict them; None where that does not lead to
        one nearby. Where the mesh is a new one they begin with the strains of the old one.
        """
        if not shapes:
            return []
        T = self.tensions(shapes)
        ahead = [own.here.tensions + own.tensions @ change for own in before]
        T = np.where(np.isnan(T), np.maximum(np.array(ahead), 0.0), T)
        if self.system.of is before[0].here.system.of:
            guesses = [own.here.states + own.states @ change for own in before]
        else:
            on = Collocation.on(self.system)
            guesses = [
                on.carried(tensions, Known(own.here.system, own.here.states))
                for tensions, own in zip(T, before, strict=True)
            ]
        solutions = newton_many(self.system, T, 1.0, np.array(guesses)).solutions
        return self._held(shapes, solutions)

    def _held(
        self, shapes: Sequence[Measured], heres: Sequence[Linearised | None]
    ) -> list[Linearised | None]:
        """Return equilibria with those settled by lengths corrected until these hold.

        A tendon is taut, its length as the winch leaves it, or slack, its tension 0: the Newton
        correction of all tensions is a linear complementarity problem, whose matrix, how lengths
        shrink with tensions, is symmetric and positive semidefinite for tendons without friction:
        least squares under bounds.
        """
        kept = list(heres)
        left = [
            k for k, (m, here) in enumerate(zip(shapes, kept, strict=True)) if m.by_length and here
        ]
        for _ in range(_CORRECTIONS):
            T, states, going = [], [], []
            for k in left:
                here = kept[k]
                assert here is not None
                root, b = _square_root(-here.length_tension), here.lengths - self.lengths(shapes[k])
                goal = root @ here.tensions + np.linalg.lstsq(root.T, b, rcond=1e-9)[0]
                new = lsq_linear(root, goal, (0.0, np.inf)).x
                if np.abs(new - here.tensions).max() > _HELD * max(1e-3, new.max()):
                    going.append(k)
                    T.append(new)
                    states.append(here.states + here.by_tensions @ (new - here.tensions))
            left = going
            if not left:
                return kept
            given = self.system, np.array(T), 1.0, np.array(states)
            solutions = newton_many(*given).solutions
            for k, here in zip(left, solutions, strict=True):
                kept[k] = here
            left = [k for k in left if kept[k] is not None]
        for k in left:
            kept[k] = None
        return kept

    def differentiated(
        self, shapes: Sequence[Measured], heres: Sequence[Linearised]
    ) -> list[ByNumbers]:
        """Return the derivatives of equilibria of shapes by the unknowns."""
        if not shapes:
            return []
        numbers, n = self.derivatives, self.system.arm.n_tendons
        jacobian = NumberDerivatives(numbers.p, numbers.lengths, numbers.nodes)
        fresh = linearised(self.system, np.array([here.x for here in heres]))
        measured = [np.zeros(n) if own.by_length else np.array(own.tensions) for own in shapes]
        tensions = [own[:, None] * numbers.scale for own in measured]
        rows = by_numbers(fresh, jacobian, tensions)
        return [self._by_length(shape, by) for shape, by in zip(shapes, rows, strict=True)]

    def _by_length(self, shape: Measured, by: ByNumbers) -> ByNumbers:
        """Return derivatives with the tensions that lengths hold changing along."""
        if not shape.by_length:
            return by
        left = self.derivatives.rest if shape.strokes is not None else 0.0
        return ByNumbers(
            by.here, by.jacobian, taut_compliance(by.here) @ (left - by.lengths), by.moved
        )


def taut_compliance(here: Linearised) -> Array:
    """Return how tensions change with the lengths that winches leave (n_tendons, n_tendons)."""
    taut = here.tensions > 0
    inverse = np.zeros((taut.size, taut.size))
    inverse[np.ix_(taut, taut)] = np.linalg.pinv(here.length_tension[np.ix_(taut, taut)], 1e-9)
    return inverse


@lru_cache(maxsize=1)
def _along() -> Mapped:
    """Return (pose, kappa, nu) -> how the pose changes along the arm (7,) [1/m]."""
    g, kappa, nu = ca.SX.sym("g", POSE), ca.SX.sym("kappa", 3), ca.SX.sym("nu", 3)
    turned = multiply(g[:4], ca.vertcat(0, kappa)) / 2
    return Mapped(ca.Function("along", [g, kappa, nu], [ca.vertcat(turned, rotate(g[:4], nu))]))


def _square_root(A: Array) -> Array:
    """Return the symmetric root of the symmetric part of a matrix, negative eigenvalues cut."""
    eigenvalues, V = np.linalg.eigh((A + A.T) / 2)
    return np.asarray((V * np.sqrt(np.maximum(eigenvalues, 0.0))) @ V.T)
