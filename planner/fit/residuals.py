"""What settled shapes predict less what was measured of them, with derivatives by the unknowns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from model import OctoplanError
from model.equilibrium.by_numbers import ByNumbers
from model.equilibrium.linearised import Linearised
from model.paths import Array
from planner.fit import drives
from planner.fit.equilibria import Equations, Setting
from planner.fit.measured import Measured
from planner.fit.sensors import Marks, Sensors
from planner.fit.unknowns import Parameters


class UnsettledShapeError(OctoplanError):
    """A shape does not settle at given values of the unknowns."""

    def __init__(self, name: str, why: OctoplanError) -> None:
        self.name, self.why = name, why
        super().__init__(f"{name} does not settle: {why}")

    def __reduce__(self) -> tuple[type, tuple[str, OctoplanError]]:
        return type(self), (self.name, self.why)


class Residual(NamedTuple):
    """What is predicted less what was measured of one thing of a shape.

    `what` is a marker ("points[1]"), "tip", a frame or a tendon; `miss` in m, of frames in rad.
    """

    shape: str
    what: str
    miss: tuple[float, ...]

    @property
    def size(self) -> float:
        """The distance [m], or angle [rad]."""
        return float(np.linalg.norm(self.miss))

    @property
    def is_place(self) -> bool:
        """Whether it is a marker's or the tip's."""
        return self.what.startswith(("points", "tip"))


def mean_distance(residuals: Iterable[Residual]) -> float:
    """Return the mean distance of markers and tips from where they are predicted [m], or NaN."""
    sizes = [residual.size for residual in residuals if residual.is_place]
    return float(np.mean(sizes)) if sizes else float("nan")


class Experiment:
    """Measured shapes of one arm, with the unknowns of both, on meshes of a refinement."""

    def __init__(
        self,
        parameters: Parameters,
        shapes: Sequence[Measured],
        refinement: int,
        stages: int,
        machine_code: bool = False,
    ) -> None:
        self.parameters, self.shapes = parameters, tuple(shapes)
        self.refinement, self.stages, self.machine_code = refinement, stages, machine_code
        own = {unknown.session for unknown in parameters.unknowns}
        #: Which shapes are of each session that has an arm of its own; "" is all others'.
        self.members: dict[str, list[int]] = {}
        for i, shape in enumerate(self.shapes):
            self.members.setdefault(shape.session if shape.session in own else "", []).append(i)
        self.marks = {
            name: Marks([self.shapes[i] for i in which], parameters.table)
            for name, which in self.members.items()
        }
        mesh = refinement, stages, machine_code
        self.equations = {
            name: Equations(parameters, name, marks, *mesh, self._strokes(name))
            for name, marks in self.marks.items()
        }

    def _strokes(self, session: str) -> bool:
        return any(self.shapes[i].strokes is not None for i in self.members[session])

    def from_rest(self, values: Array) -> Evaluation:
        """Return all shapes at values (K,) as they are reached from rest.

        InputError where no such arm can be; shapes that have no equilibrium are `lost`.
        """
        settings = {name: own.at(values) for name, own in self.equations.items()}
        equilibria: list[Linearised | None] = [None] * len(self.shapes)
        lost: dict[int, OctoplanError] = {}
        for name, which in self.members.items():
            reached = drives.from_rest(settings[name], [self.shapes[i] for i in which])
            for i, here in zip(which, reached, strict=True):
                if isinstance(here, Linearised):
                    equilibria[i] = here
                else:
                    lost[i] = here
        return Evaluation(self, values, settings, tuple(equilibria), lost)

    def without(self, kept: Sequence[int]) -> Experiment:
        """Return some of the shapes, on the same meshes."""
        shapes = [self.shapes[i] for i in kept]
        mesh = self.refinement, self.stages, self.machine_code
        part = Experiment(self.parameters, shapes, *mesh)
        part.equations = {name: self.equations[name] for name in part.members}
        part.marks = {name: self.marks[name] for name in part.members}
        return part


@dataclass(frozen=True, eq=False)
class Evaluation:
    """All shapes at given values (K,) of the unknowns.

    Attributes
    ----------
    experiment : Experiment
    values : (K,)
    settings : dict of Setting
        The equations of each session.
    equilibria : tuple of Linearised
        Of each shape; None where it is left out or lost.
    lost : dict of OctoplanError
        Why shapes have none, by their number.
    """

    experiment: Experiment
    values: Array
    settings: dict[str, Setting]
    equilibria: tuple[Linearised | None, ...]
    lost: dict[int, OctoplanError]

    def near(
        self, values: Array, experiment: Experiment | None = None, halvings: int = 3
    ) -> Evaluation:
        """Return the shapes that this has at other values, on the same branches.

        On the meshes of this experiment or of another one of the same shapes. Those that do not
        lead to an equilibrium nearby are led there in two halves, and those in halves again; what
        that does not do for is `lost`.
        """
        experiment = experiment or self.experiment
        settings = {name: own.at(values) for name, own in experiment.equations.items()}
        equilibria: list[Linearised | None] = [None] * len(self.equilibria)
        lost: dict[int, OctoplanError] = {}
        for name, which in self._members.items():
            before = self._sensors[name].derivatives
            shapes = [experiment.shapes[i] for i in which]
            reached = drives.near(settings[name], shapes, before, values - self.values)
            for i, here in zip(which, reached, strict=True):
                equilibria[i] = here
                if here is None:
                    lost[i] = OctoplanError("it jumps")
        if lost and halvings and experiment is self.experiment:
            middle = (self.values + values) / 2
            half = self.only(list(lost)).near(middle, halvings=halvings - 1)
            if not half.lost:
                end = half.near(values, halvings=halvings - 1)
                rows = zip(equilibria, end.equilibria, strict=True)
                equilibria, lost = [other or here for here, other in rows], end.lost
        return Evaluation(experiment, values, settings, tuple(equilibria), lost)

    def only(self, kept: Sequence[int]) -> Evaluation:
        """Return the evaluation with all but some shapes left out."""
        equilibria = [here if i in kept else None for i, here in enumerate(self.equilibria)]
        return Evaluation(self.experiment, self.values, self.settings, tuple(equilibria), {})

    def part(self, kept: Sequence[int]) -> Evaluation:
        """Return the evaluation of an experiment of some of the shapes."""
        part, equilibria = self.experiment.without(kept), [self.equilibria[i] for i in kept]
        settings = {name: self.settings[name] for name in part.members}
        return Evaluation(part, self.values, settings, tuple(equilibria), {})

    @property
    def present(self) -> list[int]:
        """Numbers of the shapes that have an equilibrium."""
        return [i for i, here in enumerate(self.equilibria) if here is not None]

    @cached_property
    def _members(self) -> dict[str, list[int]]:
        """Which of these are of each session."""
        found = {
            name: [i for i in which if self.equilibria[i] is not None]
            for name, which in self.experiment.members.items()
        }
        return {name: which for name, which in found.items() if which}

    @cached_property
    def _sensors(self) -> dict[str, Sensors]:
        shapes = self.experiment.shapes
        return {
            name: Sensors(
                self.experiment.marks[name],
                self.settings[name],
                [shapes[i] for i in which],
                [here for i in which if (here := self.equilibria[i])],
            )
            for name, which in self._members.items()
        }

    def _each(self, what: str) -> dict[int, Any]:
        """Return something that sensors tell of each shape, by its number."""
        rows = dict[int, Any]()
        for name, sensors in self._sensors.items():
            rows.update(zip(self._members[name], getattr(sensors, what), strict=True))
        return dict(sorted(rows.items()))

    @property
    def by_shape(self) -> dict[int, Array]:
        """Predictions less measurements (size,), [m] and [rad], of each shape by number."""
        return self._each("residuals")

    @property
    def derivatives(self) -> dict[int, ByNumbers]:
        """Derivatives of each shape by the unknowns."""
        return self._each("derivatives")

    @property
    def jacobians(self) -> dict[int, Array]:
        """Derivatives of `by_shape` (size, K)."""
        return self._each("jacobians")

    @property
    def whitening(self) -> dict[int, Array]:
        """Matrices (size, size) by which `by_shape` are of unit variance, as is known."""
        return self._each("whitening")

    def residuals_of(self) -> tuple[Residual, ...]:
        """Return all residuals, shape by shape."""
        shapes = self.experiment.shapes
        return tuple(
            Residual(shapes[i].name, what, tuple(row))
            for i, miss in self.by_shape.items()
            for what, row in _parts(shapes[i], miss)
        )


def _parts(shape: Measured, miss: Array) -> list[tuple[str, list[float]]]:
    """Return the residuals (size,) of a shape by what was measured."""
    names = shape.place_names + [f"frames[{i}]" for i in range(len(shape.frames))]
    runs = [f"{kind}[{j}]" for kind in shape.runs for j in range(len(getattr(shape, kind)))]
    vectors = miss[: 3 * len(names)].reshape(-1, 3).tolist()
    rest = miss[3 * len(names) :].reshape(-1, 1).tolist()
    return [*zip(names, vectors, strict=True), *zip(runs, rest, strict=True)]
