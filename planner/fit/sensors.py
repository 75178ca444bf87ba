"""What sensors show of settled shapes, less what was measured, with derivatives by the unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model import Arm
from model.equilibrium.by_numbers import ByNumbers
from model.equilibrium.linearised import Linearised
from model.machine.buffered import Mapped
from model.paths import Array
from model.rotations import conjugate, from_matrix, matrices, multiply, rotate
from model.transcription.layout import POSE
from planner.fit import drives
from planner.fit.equilibria import MM, Setting
from planner.fit.measured import Measured


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

    @cached_property
    def residuals(self) -> list[Array]:
        """Predictions less measurements of each shape (size,), [m] and [rad]."""
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

    @cached_property
    def derivatives(self) -> list[ByNumbers]:
        """Derivatives of the equilibria by the unknowns."""
        return drives.differentiated(self.setting, self.shapes, self.heres)

    @cached_property
    def jacobians(self) -> list[Array]:
        """Derivatives of `residuals` by the unknowns, each (size, K)."""
        by = self.derivatives
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

    @cached_property
    def whitening(self) -> list[Array]:
        """Matrices (size, size) by which residuals of each shape are of unit variance.

        Noise of what drives a shape, its tensions or its lengths, is carried to the residuals to
        first order: the effective variance. Source: Orear, American Journal of Physics 50 (1982).
        """
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
