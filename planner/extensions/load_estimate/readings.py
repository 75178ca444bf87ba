"""Measured positions of one shape, with their noise, and the residuals of predicted poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array, Mask
from octoplan.model.rotations import from_matrix
from octoplan.model.support.checks import (
    LARGEST,
    SMALLEST,
    finite_array,
    is_several,
    numbers,
    orthonormal,
)
from octoplan.model.support.errors import InputError
from octoplan.model.support.machine.functions import BatchFunction, cached
from octoplan.planner.extensions.fit.measured import Measured
from octoplan.planner.extensions.fit.residuals import sensor_readings

# Arc length [m], offset and place (3,) [m] of a marker.
Point = tuple[float, Array, Array]
_POINT = "(s, (o_t, o_n, o_b), (x, y, z)), all in m; NaN for a coordinate that was not seen"
# Rounding of the columns of a measured frame.
_FRAME_ROUNDING = 1e-3


@dataclass(frozen=True, eq=False)
class Readings:
    """M sensors of one shape: markers, and frames.

    Attributes
    ----------
    s : (M,)
        Arc lengths [m].
    offsets : (M, 3)
        Offsets of markers in the local frame [m].
    values : (M, 3)
        Measured positions [m], 0 for frames.
    rotations : (M, 4)
        Quaternions of measured frames, 0 for markers.
    stds : (M, 3)
        Standard deviations [m] or [rad].
    seen : (M, 3)
        Whether the coordinate was measured.
    """

    s: Array
    offsets: Array
    values: Array
    rotations: Array
    stds: Array
    seen: Mask

    @property
    def size(self) -> int:
        """Number of measured coordinates."""
        return int(self.seen.sum())

    @property
    def std(self) -> Array:
        """Standard deviations of the measured coordinates (size,) [m] or [rad]."""
        return self.stds[self.seen]

    def sizes(self, length: float) -> Array:
        """Return the length of the arm for positions and 1 rad for angles (size,)."""
        is_angle = self.rotations.any(axis=1)
        return np.where(is_angle, 1.0, length).repeat(3).reshape(-1, 3)[self.seen]

    def predictions(self, poses: Array) -> tuple[Array, Array]:
        """Return predicted coordinates (M, 3) of poses (M, 7), and their derivatives (M, 3, 7).

        The coordinates of a frame are the rotation from the measured frame, see sensor_readings.
        """
        predicted, J = cached(BatchFunction, sensor_readings())(poses, self.offsets, self.rotations)
        return predicted, J.reshape(-1, 3, 10)[:, :, :7]

    def misses(self, predicted: Array) -> Array:
        """Return predictions (M, 3) minus measurements (size,) [m] or [rad]."""
        return np.asarray((predicted - self.values)[self.seen])


def checked_readings(
    arm: Arm, tip: Any, pose: Any, points: Any, std: Any, angle_std: Any
) -> Readings:
    """Return the readings of `tip`, `pose` or `points`; see estimate_load. Raises InputError."""
    given = [
        name
        for name, each in (("tip", tip), ("pose", pose), ("points", points))
        if each is not None
    ]
    if len(given) != 1:
        raise InputError("measurement", " and ".join(given) or "none", "tip, pose or points")
    if points is not None:
        rows = _points(points)
    else:
        place = tip
        if pose is not None:
            place, frame = _pair(pose)
        position = finite_array(given[0], place, (3,))
        rows = [(arm.length, np.zeros(3), position)]
    s = np.array([row[0] for row in rows])
    offsets = np.array([row[1] for row in rows])
    values = np.array([row[2] for row in rows])
    stds = _stds("std", std, values.shape)
    rotations = np.zeros((len(rows), 4))
    if pose is not None:
        rotation = np.array(orthonormal("pose frame", frame, _FRAME_ROUNDING))
        s = np.append(s, arm.length)
        offsets = np.vstack([offsets, np.zeros(3)])
        values = np.vstack([values, np.zeros(3)])
        stds = np.vstack([stds, _stds("angle_std", angle_std, (1, 3))])
        rotations = np.vstack([rotations, from_matrix(rotation)])
    elif angle_std is not None:
        raise InputError("angle_std", angle_std, "None without pose")
    seen = np.isfinite(values)
    if not seen.any():
        raise InputError("points", "none seen", "at least one point with a measured coordinate")
    _check_places(arm, rows, points is None)
    kept = seen.any(axis=1)
    return Readings(
        s=np.minimum(s[kept], arm.length),
        offsets=offsets[kept],
        values=values[kept],
        rotations=rotations[kept],
        stds=stds[kept],
        seen=seen[kept],
    )


def _pair(pose: Any) -> tuple[Any, Any]:
    """Return position and frame of a pose, or raise InputError."""
    if not is_several(pose) or len(pose) != 2:
        raise InputError("pose", pose, "(position (3,) in m, frame (3, 3) with columns t, n, b)")
    return pose[0], pose[1]


def _points(points: Any) -> list[Point]:
    """Return arc length, offset and place of each point; NaN for coordinates without a value."""
    if not is_several(points) or not len(points):
        raise InputError("points", points, f"a sequence of {_POINT}")
    rows = []
    for i, point in enumerate(points):
        field = f"points[{i}]"
        if not is_several(point) or len(point) != 3:
            raise InputError(field, point, _POINT)
        s, offset, place = point
        place = (np.nan,) * 3 if place is None else place
        if not is_several(place) or len(place) != 3:
            raise InputError(f"{field}.place", place, "3 coordinates [m]")
        coordinates = [np.nan if x is None else x for x in place]
        rows.append(
            (
                float(finite_array(f"{field}.s", s, ())),
                finite_array(f"{field}.offset", offset, (3,)),
                _place(f"{field}.place", coordinates),
            )
        )
    return rows


def _place(field: str, coordinates: Sequence[Any]) -> Array:
    """Return coordinates (3,), NaN if not seen, or raise InputError."""
    place = numbers(field, coordinates, "3 coordinates [m]")
    finite_array(field, np.where(np.isnan(place), 0.0, place), (3,))
    return place


def _stds(field: str, std: Any, shape: tuple[int, ...]) -> Array:
    """Return standard deviations of a shape from one number, one per axis or one per number."""
    wanted = "" if shape[0] == 1 else f", or {shape[0]} rows of 3"
    allowed = f"positive: one number, 3 numbers{wanted}, from {SMALLEST:g} to {LARGEST:g}"
    if std is None:
        raise InputError(field, std, allowed)
    array = numbers(field, std, allowed)
    if array.shape not in ((), (3,), shape):
        raise InputError(field, std, allowed)
    # The negated comparison refuses NaN, too.
    if not np.all((array >= SMALLEST) & (array <= LARGEST)):
        raise InputError(field, std, allowed)
    return np.array(np.broadcast_to(array, shape))


def _check_places(arm: Arm, rows: Sequence[Point], is_tip: bool) -> None:
    """Raise InputError for places that the arm cannot reach, which suggests other units."""
    base = np.array(arm.base_position)
    places = [tuple(np.where(np.isnan(place), base, place).tolist()) for _, _, place in rows]
    points = [
        (s, tuple(offset.tolist()), place)
        for (s, offset, _), place in zip(rows, places, strict=True)
    ]
    none = np.zeros(arm.n_tendons).tolist()
    where = {"tip": places[0]} if is_tip else {"points": points}
    Measured(tensions=none, **where).checked(arm, "measured")
