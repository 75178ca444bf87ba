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
from model.equilibrium.by_numbers import ByNumbers, by_numbers
from model.equilibrium.forward import STAGES
from model.equilibrium.linearised import Linearised, refreshed
from model.paths import Array
from model.transcription.system import System
from planner.calibrate.continued import carried, continued, from_rest
from planner.calibrate.measured import Measured
from planner.calibrate.rows import Rows
from planner.calibrate.session import Session, point_rows, shifted
from planner.unknowns.meshes import Meshes
from planner.unknowns.parameters import Parameters
from planner.unknowns.pulled import Pulled


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
    stages : int
        Of an element of the meshes.
    looser : float
        Of Newton's method; see newton_many.
    """

    def __init__(
        self,
        parameters: Parameters,
        shapes: Sequence[Measured],
        refinement: int,
        machine_code: bool = False,
        stages: int = STAGES,
        looser: float = 1.0,
    ) -> None:
        self.parameters, self.shapes = parameters, tuple(shapes)
        self.refinement, self.machine_code, self.stages = refinement, machine_code, stages
        self.looser = looser
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
        meshes = self.meshes.setdefault(
            name, Meshes(self.refinement, self.machine_code, self.stages)
        )
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
        heres: list[Linearised | None] = [None for _ in self.shapes]
        for name, of in sessions.items():
            own = self._members(name)
            T = [of.tensions(self.shapes[i]) for i in own]
            if before is None:
                known = from_rest(of.system, np.array(T))
            else:
                known = before.moved(own, values, of, T)
            for i, here in zip(own, self._settled(of, own, T, known), strict=True):
                heres[i] = here
        return Evaluation(self, values, sessions, tuple(here for here in heres if here))

    def from_rest(self, found: Evaluation) -> Evaluation:
        """Return all shapes at the values of an evaluation of this, as reached from rest."""
        heres = list(found.heres)
        for name, of in found.sessions.items():
            own = self._members(name)
            T, here = [of.tensions(self.shapes[i]) for i in own], [found.heres[i] for i in own]
            sure = Pulled(of.system, self.looser).confirmed(T, here)
            known = [one if is_it else None for one, is_it in zip(here, sure, strict=True)]
            for i, settled in zip(own, self._settled(of, own, T, known), strict=True):
                heres[i] = settled
        return replace(found, heres=tuple(heres))

    def _sessions(self, values: Array) -> dict[str, Session]:
        names = dict.fromkeys(self.session_of(shape) for shape in self.shapes)
        return {name: self.session(values, name) for name in names}

    def _members(self, name: str) -> list[int]:
        """Return which shapes are of a session."""
        return [i for i, shape in enumerate(self.shapes) if self.session_of(shape) == name]

    def _settled(
        self,
        of: Session,
        own: Sequence[int],
        tensions: Sequence[Array],
        known: Sequence[Linearised | None],
    ) -> list[Linearised]:
        """Return the equilibria of shapes of a session: those known, others as from rest."""
        rest = Pulled(of.system, self.looser)
        rest.known += [(T, here) for T, here in zip(tensions, known, strict=True) if here]
        lost = [k for k, here in enumerate(known) if here is None]
        found, fallen = list(known), rest.all([tensions[k] for k in lost])
        for k, here in zip(lost, fallen, strict=True):
            if isinstance(here, OctoplanError):
                raise UnsettledShapeError(self.shapes[own[k]].name, here) from None
            found[k] = here
        return [here for here in found if here]


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
        found = dict[int, ByNumbers]()
        for name, own in self._members.items():
            of, shapes = self.sessions[name], [self.experiment.shapes[i] for i in own]
            tensions = [np.array(shape.tensions)[:, None] * of.scaled for shape in shapes]
            heres = [self.heres[i] for i in own]
            heres = heres if self.experiment.looser > 1 else refreshed(heres)
            found.update(zip(own, by_numbers(heres, of.jacobian, tensions), strict=True))
        return [found[i] for i in range(len(self.heres))]

    @cached_property
    def jacobian(self) -> Array:
        """Derivatives of `residuals` by the unknowns (n, K)."""
        found, shapes = dict[int, Array](), self.experiment.shapes
        for name, own in self._members.items():
            of, by = self.sessions[name], [self.derivatives[i] for i in own]
            strokes = any(shapes[i].strokes is not None for i in own)
            rest = of.rest_jacobian if strokes else np.zeros((0, 0))
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

    def moved(
        self, own: Sequence[int], values: Array, of: Session, tensions: Sequence[Array]
    ) -> list[Linearised | None]:
        """Return the equilibria of shapes at other values near these; None where none is."""
        T, looser = np.array(tensions), self.experiment.looser
        heres, change = [self.heres[i] for i in own], values - self.values
        if of.system.of is not heres[0].system.of:
            return carried(heres, of.system, T, looser)

        def halfway(which: list[int]) -> tuple[System, Array]:
            half = self.experiment.session(self.values + change / 2, of.name)
            shapes = [self.experiment.shapes[own[k]] for k in which]
            return half.system, np.array([half.tensions(shape) for shape in shapes])

        by = [self.derivatives[i] for i in own]
        return continued(by, change, of.system, T, halfway, looser)
