"""What settled shapes predict less what was measured of them, with derivatives by the unknowns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from model import Arm, OctoplanError
from model.equilibrium.by_numbers import ByNumbers
from model.equilibrium.linearised import Linearised
from model.machine.buffered import Mapped
from model.paths import Array
from model.rotations import conjugate, from_matrix, matrices, multiply, rotate
from model.transcription.layout import POSE
from planner.fit import drives
from planner.fit.equilibria import MM, Equations, Setting
from planner.fit.measured import Measured
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
            before = [self.derivatives[i] for i in which]
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

    @cached_property
    def by_shape(self) -> dict[int, Array]:
        """Predictions less measurements (size,), [m] and [rad], of each shape by number."""
        rows = (
            zip(self._members[n], own.residuals(), strict=True) for n, own in self._sensors.items()
        )
        return dict(sorted(pair for pairs in rows for pair in pairs))

    @cached_property
    def derivatives(self) -> dict[int, ByNumbers]:
        """Derivatives of each shape by the unknowns."""
        rows = dict[int, ByNumbers]()
        for name, sensors in self._sensors.items():
            by = drives.differentiated(self.settings[name], sensors.shapes, sensors.heres)
            rows.update(zip(self._members[name], by, strict=True))
        return rows

    @cached_property
    def jacobians(self) -> dict[int, Array]:
        """Derivatives of `by_shape` (size, K)."""
        rows = dict[int, Array]()
        for name, sensors in self._sensors.items():
            which = self._members[name]
            rows.update(
                zip(which, sensors.jacobians([self.derivatives[i] for i in which]), strict=True)
            )
        return dict(sorted(rows.items()))

    @cached_property
    def whitening(self) -> dict[int, Array]:
        """Matrices (size, size) by which residuals of shapes are of unit variance, as is known.

        Noise of what drives a shape, its tensions or its lengths, is carried to the residuals to
        first order: the effective variance. Source: Orear, American Journal of Physics 50 (1982).
        """
        rows = dict[int, Array]()
        for name, sensors in self._sensors.items():
            rows.update(zip(self._members[name], sensors.whitening(), strict=True))
        return rows

    def residuals_of(self) -> tuple[Residual, ...]:
        """Return all residuals, shape by shape."""
        shapes = self.experiment.shapes
        return tuple(
            Residual(shapes[i].name, what, tuple(row))
            for i, miss in self.by_shape.items()
            for what, row in _parts(shapes[i], miss)
        )


class Marks:
    """The arc lengths that shapes are seen at, each once: points by number, the tip, frames."""

    def __init__(self, shapes: Sequence[Measured], table: dict[str, Any]) -> None:
        rows = [mark for shape in shapes for mark in _marks(shape)]
        self.marks, self._said = list(dict.fromkeys(rows)), _s_of(table)

    def __call__(self, arm: Arm, table: dict[str, Any]) -> Array:
        """Return their arc lengths (S,) [m] on an arm."""
        shift = _s_of(table) - self._said
        rows = [
            arm.length if i == _TIP else s + (shift[i] if i >= 0 else 0.0) for i, s in self.marks
        ]
        return np.array(rows, dtype=float)


# In place of a point's number.
_TIP, _FRAME = -1, -2


def _marks(shape: Measured) -> list[tuple[int, float]]:
    """Return point number and arc length [m] of the markers seen, of the tip and of frames."""
    points = [(i, point.s) for i, point in shape.seen]
    tip = [(_TIP, np.inf)] * (shape.tip is not None)
    return [*points, *tip, *((_FRAME, frame.s) for frame in shape.frames)]


def _s_of(table: dict[str, Any]) -> Array:
    return MM * np.array([point["s_mm"] for point in table["points"]], dtype=float)


class Sensors:
    """The sensors of shapes of one session; what all shapes show is worked out at once."""

    def __init__(
        self,
        marks: Marks,
        setting: Setting,
        shapes: Sequence[Measured],
        heres: Sequence[Linearised],
    ) -> None:
        self.setting, self.shapes, self.heres = setting, list(shapes), list(heres)
        rows = [(k, *mark) for k, shape in enumerate(self.shapes) for mark in _marks(shape)]
        numbers = {mark: station for station, mark in enumerate(marks.marks)}
        # Of each marker, tip and frame: its shape, its station, its point.
        self._shape = np.array([k for k, *_ in rows], dtype=np.int64)
        self._station = np.array([numbers[i, s] for _, i, s in rows], dtype=np.int64)
        self._point = np.array([i for _, i, _ in rows], dtype=np.int64)
        self._offsets = np.array(
            [
                np.add(self.shapes[k].points[i].offset, setting.numbers.offsets[i])
                if i >= 0
                else np.zeros(3)
                for k, i, _ in rows
            ]
        ).reshape(-1, 3)
        self._poses = setting.poses(self.heres)[self._shape, self._station]
        turned = [frame.matrix for shape in self.shapes for frame in shape.frames]
        self._measured = np.array([from_matrix(np.array(R)) for R in turned]).reshape(-1, 4)

    @cached_property
    def _predicted(self) -> tuple[Array, Array]:
        """Places or rotation vectors (M, 3), and their derivatives by poses (M, 3, 7)."""
        value, jacobian = np.zeros((len(self._poses), 3)), np.zeros((len(self._poses), 3, POSE))
        turns = self._point == _FRAME
        marks = ~turns
        value[marks], by_pose = _place()(self._poses[marks], self._offsets[marks])
        jacobian[marks] = by_pose.reshape(-1, POSE, 3).transpose(0, 2, 1)
        value[turns], by_turn = _turn()(self._poses[turns, :4], self._measured)
        jacobian[turns, :, :4] = by_turn.reshape(-1, 4, 3).transpose(0, 2, 1)
        return value, jacobian

    def residuals(self) -> list[Array]:
        """Return what is predicted less what was measured of each shape (size,), [m] and [rad]."""
        value = self._predicted[0]
        rows = []
        for k, (shape, here) in enumerate(zip(self.shapes, self.heres, strict=True)):
            own = value[self._shape == k]
            own[: len(shape.places)] -= shape.places
            rows.append(np.concatenate([own.ravel(), *self._runs(shape, here)]))
        return rows

    def _runs(self, shape: Measured, here: Linearised) -> list[Array]:
        rest = self.setting.numbers.rest
        return [
            (here.lengths if kind == "lengths" else rest - here.lengths) - getattr(shape, kind)
            for kind in shape.runs
        ]

    def jacobians(self, by: Sequence[ByNumbers]) -> list[Array]:
        """Return the derivatives (size, K) of residuals by the unknowns."""
        numbers, jacobian = self.setting.derivatives, self._predicted[1]
        rows = jacobian @ self.setting.pose_derivatives(by)[self._shape, self._station]
        seen = self._point >= 0
        rows[seen] += matrices(self._poses[seen, :4]) @ numbers.offsets[self._point[seen]]
        none = np.zeros((0, rows.shape[-1]))
        told = [own.lengths if m.runs else none for m, own in zip(self.shapes, by, strict=True)]
        return self._stacked(rows, told, numbers.rest)

    def _stacked(self, rows: Array, lengths: Sequence[Array], rest: Array | float) -> list[Array]:
        stacks = []
        for k, (shape, own) in enumerate(zip(self.shapes, lengths, strict=True)):
            parts = [rows[self._shape == k].reshape(-1, rows.shape[-1])]
            parts += [own if kind == "lengths" else rest - own for kind in shape.runs]
            stacks.append(np.vstack(parts))
        return stacks

    def whitening(self) -> list[Array]:
        """Return what makes residuals of each shape of unit variance (size, size)."""
        noisy = [m.tension_std > 0 or m.by_length for m in self.shapes]
        stacks = [np.zeros((0, 0))] * len(noisy)
        if any(noisy):
            by_tensions = np.array([here.by_tensions for here in self.heres])
            places = self.setting.places[self._station]
            rows = self._predicted[1] @ by_tensions[self._shape[:, None], places]
            lengths = [here.length_tension for here in self.heres]
            stacks = self._stacked(rows, lengths, 0.0)
        found = []
        for shape, here, has, J in zip(self.shapes, self.heres, noisy, stacks, strict=True):
            if not has:
                found.append(np.diag(1 / shape.stds))
                continue
            inputs = shape.tension_std * np.diag(self.setting.numbers.scale)
            if shape.by_length:
                inputs = (shape.length_std or shape.std) * drives.tensions_by_lengths(here)
            carried = J @ inputs
            variance = np.diag(np.square(shape.stds)) + carried @ carried.T
            found.append(np.linalg.inv(np.linalg.cholesky(variance)))
        return found


@lru_cache(maxsize=1)
def _place() -> Mapped:
    """Return (pose, offset) -> place of a marker (3,), its derivatives by the pose (3, 7)."""
    g, o = ca.SX.sym("g", POSE), ca.SX.sym("o", 3)
    place = g[4:] + rotate(g[:4], o)
    return Mapped(ca.Function("place", [g, o], [place, _dense(ca.jacobian(place, g))]))


@lru_cache(maxsize=1)
def _turn() -> Mapped:
    """Return (q, q measured) -> rotation vector (3,) between, base frame, derivatives by q (3, 4).

    The logarithm of the quaternion from the measured frame to the predicted one, of the sign that
    turns by no more than half a turn.
    """
    q, measured = ca.SX.sym("q", 4), ca.SX.sym("m", 4)
    between = multiply(q, conjugate(measured))
    between = between * ca.if_else(between[0] < 0, -1, 1)
    size = ca.sqrt(ca.sumsqr(between[1:]) + 1e-30)
    w = 2 * ca.atan2(size, between[0]) / size * between[1:]
    return Mapped(ca.Function("turn", [q, measured], [w, _dense(ca.jacobian(w, q))]))


def _dense(matrix: ca.SX) -> ca.SX:
    return ca.densify(ca.vec(matrix))


def _parts(shape: Measured, miss: Array) -> list[tuple[str, list[float]]]:
    """Return the residuals (size,) of a shape by what was measured."""
    names = shape.place_names + [f"frames[{i}]" for i in range(len(shape.frames))]
    runs = [f"{kind}[{j}]" for kind in shape.runs for j in range(len(getattr(shape, kind)))]
    vectors = miss[: 3 * len(names)].reshape(-1, 3).tolist()
    rest = miss[3 * len(names) :].reshape(-1, 1).tolist()
    return [*zip(names, vectors, strict=True), *zip(runs, rest, strict=True)]
