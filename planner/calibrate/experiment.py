"""All measured shapes at given values of the unknowns: settled, compared and differentiated.

The equations of a session's arm are put together once for values; its shapes are solved by Newton's
method from where the derivatives of the shapes before say that they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from model import InputError, OctoplanError
from model.equilibrium.by_numbers import ByNumbers
from model.equilibrium.forward import Collocation, Known
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import newton
from model.paths import Array
from planner.calibrate.measured import Measured
from planner.calibrate.rows import Rows
from planner.calibrate.session import Session, point_rows, shifted
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

    def session_of(self, shape: Measured) -> str:
        """Return the key of the session that a shape is evaluated in."""
        return self.parameters.shared(shape.session)

    def session(self, values: Array, name: str) -> Session:
        """Return a session at values (K,); InputError where no such arm can be."""
        arm, scene = self.parameters.built(values, name)
        table = self.parameters.table_at(values, name)
        shifts = point_rows(table["points"]) - point_rows(self.parameters.table["points"])
        own = [shape for shape in self.shapes if self.session_of(shape) == name]
        seen = [s for shape in own for s in shifted(shape, shifts).s.tolist()]
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
        sessions = self._sessions(values)
        none: list[Linearised | None] = [None for _ in self.shapes]
        near = none
        if before is not None:
            near = [self._near(sessions, i, values, before) for i in range(len(self.shapes))]
        return self._from_rest(values, sessions, near, none)

    def from_rest(self, found: Evaluation) -> Evaluation:
        """Return all shapes at the values of an evaluation, as they are reached from rest."""
        sessions = self._sessions(found.values)
        none: list[Linearised | None] = [None for _ in self.shapes]
        same = [
            sessions[self.session_of(shape)].system.of is here.system.of
            for shape, here in zip(self.shapes, found.heres, strict=True)
        ]
        near = [here if own else None for here, own in zip(found.heres, same, strict=True)]
        return self._from_rest(found.values, sessions, none, near)

    def _sessions(self, values: Array) -> dict[str, Session]:
        names = dict.fromkeys(self.session_of(shape) for shape in self.shapes)
        return {name: self.session(values, name) for name in names}

    def _from_rest(
        self,
        values: Array,
        sessions: dict[str, Session],
        known: list[Linearised | None],
        near: list[Linearised | None],
    ) -> Evaluation:
        """Return shapes that are known, and others as reached from rest, perhaps `near` one."""
        rests, heres = {name: Pulled(of.system) for name, of in sessions.items()}, list(known)
        for shape, here in zip(self.shapes, known, strict=True):
            if here:
                name = self.session_of(shape)
                rests[name].known.append((sessions[name].tensions(shape), here))
        pulls = [float(np.linalg.norm(shape.tensions)) for shape in self.shapes]
        for i in np.argsort(pulls, kind="stable").tolist():
            name = self.session_of(self.shapes[i])
            T = sessions[name].tensions(self.shapes[i])
            try:
                heres[i] = heres[i] or rests[name].at(T, near[i])
            except OctoplanError as reason:
                raise UnsettledShapeError(self.shapes[i].name, reason) from None
        return Evaluation(self, values, sessions, tuple(here for here in heres if here))

    def _near(
        self, sessions: dict[str, Session], i: int, values: Array, before: Evaluation
    ) -> Linearised | None:
        """Return the equilibrium of a shape near that of an evaluation, None if there is none."""
        of = sessions[self.session_of(self.shapes[i])]
        guess, kept = before.predicted(i, values, of)
        T = of.tensions(self.shapes[i])
        found = newton(of.system, T, 1.0, guess, FARTHEST, kept=kept)
        if found is None and kept is not None:
            found = newton(of.system, T, 1.0, guess)
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
        found = dict[int, Array]()
        for name, own in self._members.items():
            found.update(zip(own, self._rows[name].residuals(), strict=True))
        return [found[i] for i in range(len(self.heres))]

    @cached_property
    def residuals(self) -> Array:
        """The same of all shapes, over their standard deviations (n,)."""
        stds = [shape.stds for shape in self.experiment.shapes]
        return np.concatenate(self.by_shape) / np.concatenate(stds)

    @cached_property
    def derivatives(self) -> list[ByNumbers]:
        """Derivatives of each shape by the unknowns."""
        found = []
        for here, shape in zip(self.heres, self.experiment.shapes, strict=True):
            of = self.sessions[self.experiment.session_of(shape)]
            tensions = np.array(shape.tensions)[:, None] * of.scaled
            found.append(ByNumbers(here.refreshed, of.slopes, tensions))
        return found

    @cached_property
    def jacobian(self) -> Array:
        """Derivatives of `residuals` by the unknowns (n, K)."""
        found, shapes = dict[int, Array](), self.experiment.shapes
        for name, own in self._members.items():
            of, by = self.sessions[name], [self.derivatives[i] for i in own]
            strokes = any(shapes[i].strokes is not None for i in own)
            rest = of.rest_slopes if strokes else np.zeros((0, 0))
            found.update(zip(own, self._rows[name].jacobians(by, of.keys, rest), strict=True))
        return np.vstack([found[i] / shape.stds[:, None] for i, shape in enumerate(shapes)])

    @cached_property
    def _members(self) -> dict[str, list[int]]:
        """Which shapes are of each session."""
        found: dict[str, list[int]] = {name: [] for name in self.sessions}
        for i, shape in enumerate(self.experiment.shapes):
            found[self.experiment.session_of(shape)].append(i)
        return {name: own for name, own in found.items() if own}

    @cached_property
    def _rows(self) -> dict[str, Rows]:
        found = {}
        for name, own in self._members.items():
            shapes, of = [self.experiment.shapes[i] for i in own], self.sessions[name]
            sensors = [of.sensors(shape) for shape in shapes]
            found[name] = Rows([self.heres[i] for i in own], shapes, sensors)
        return found

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
