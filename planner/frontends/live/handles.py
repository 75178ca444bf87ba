"""Handles of targets: the target for a pose of the handle, and the goal for a point of the arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.rotations import from_matrix, matrices
from octoplan.model.shape import Shape
from octoplan.model.support.errors import InputError
from octoplan.planner.targets import BendingPlane, TipPose, TipPosition
from octoplan.planner.targets.base import Target, toward

# Smallest bend of a bending plane [rad]; below, the plane is undefined.
_LEAST = 0.02
# Orientation of handles that do not rotate: axes along x, y, z.
_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class Goal:
    """The desired position of a point of the arm, and desired directions of the axes.

    Attributes
    ----------
    s : float
        Arc length of the point [m].
    position : (3,) or None
        Desired position [m]; None if free.
    axes : (3, 3)
        Desired directions of t, n, b as columns; nan if free.
    """

    s: float
    position: Array | None
    axes: Array

    def residual(self, shape: Shape) -> Array:
        """Return the residual: position over the arm length, then directions."""
        rows = [] if self.position is None else [self._offset(shape) / shape.arm.length]
        frame = shape.frame(self.s)
        rows += [self.axes[:, k] - frame[:, k] for k in self._fixed_axes]
        return np.concatenate(rows)

    def jacobian(self, shape: Shape, moved: Array) -> Array:
        """Return the negative derivatives of the residual by tensions (rows, n_tendons).

        `moved` (6, n_tendons) has the derivatives of the pose at s.
        """
        rows = [] if self.position is None else [moved[:3] / shape.arm.length]
        frame = shape.frame(self.s)
        rows += [np.cross(moved[3:], frame[:, k], axisa=0, axisc=0) for k in self._fixed_axes]
        return np.vstack(rows)

    def missed(self, shape: Shape) -> float:
        """Return the distance to the position [m], or without position the angle to axes [rad]."""
        if self.position is not None:
            return float(np.linalg.norm(self._offset(shape)))
        chord = float(np.linalg.norm(self.residual(shape)))
        return 2 * float(np.arcsin(min(chord / 2, 1.0)))

    @property
    def _fixed_axes(self) -> list[int]:
        return [k for k in range(3) if np.isfinite(self.axes[0, k])]

    def _offset(self, shape: Shape) -> Array:
        return np.asarray(self.position) - np.asarray(shape.position(self.s))


def goal_of(arm: Arm, target: TipPosition | TipPose | BendingPlane) -> Goal:
    """Return the goal of a target: for the tip, or for a tangent of a bending plane."""
    if isinstance(target, BendingPlane):
        axes = np.full((3, 3), np.nan)
        axes[:, 0] = tangent(arm, target)
        return Goal(target.station(arm), None, axes)
    axes = np.array(target.frame) if isinstance(target, TipPose) else np.full((3, 3), np.nan)
    return Goal(arm.length, np.array(target.position), axes)


def tangent(arm: Arm, target: BendingPlane) -> Array:
    """Return the tangent (3,) that the target requires."""
    along = np.cos(target.bend) * np.array(arm.base_frame)[:, 0]
    return np.asarray(along + np.sin(target.bend) * toward(arm, target.angle))


@dataclass(frozen=True, eq=False)
class Numbers:
    """Numbers of a pose for input boxes.

    Attributes
    ----------
    label : str
        Description and unit.
    read : function
        Pose (7,) -> numbers (3,) or (2,).
    write : function
        Pose (7,), numbers -> pose (7,).
    """

    label: str
    read: Callable[[Array], Array]
    write: Callable[[Array, Array], Array]


@dataclass(frozen=True, eq=False)
class Handle:
    """A handle of a target.

    Attributes
    ----------
    turns : bool
        Whether the handle rotates.
    start : (7,)
        Initial pose: quaternion, position [m].
    target : function
        Pose (7,) -> target.
    numbers : tuple of Numbers
    """

    turns: bool
    start: Array
    target: Callable[[Array], TipPosition | TipPose | BendingPlane]
    numbers: tuple[Numbers, ...]


def handle_of(arm: Arm, targets: tuple[Target, ...]) -> Handle:
    """Return the handle of the target of a scene; raise InputError for other targets."""
    wanted = targets[0] if len(targets) == 1 else None
    if isinstance(wanted, TipPosition):
        start = np.concatenate([_UPRIGHT, wanted.position])
        return Handle(False, start, lambda pose: TipPosition(tuple(pose[4:].tolist())), (_PLACE,))
    if isinstance(wanted, TipPose):
        start = np.concatenate([from_matrix(np.array(wanted.frame)), wanted.position])
        return Handle(True, start, _tip_pose, (_PLACE, _TURNS))
    if isinstance(wanted, BendingPlane):
        numbers = Numbers(
            "Plane, bend [deg]",
            lambda pose: np.degrees([(at := _plane(arm, wanted, pose)).angle, at.bend]),
            lambda _, typed: _end(arm, _bent(wanted, *np.radians(typed))),
        )
        return Handle(False, _end(arm, wanted), partial(_plane, arm, wanted), (numbers,))
    kinds = [type(target).__name__ for target in targets]
    raise InputError("target", kinds, "one TipPosition, TipPose or BendingPlane to drag")


def _tip_pose(pose: Array) -> TipPose:
    return TipPose(tuple(pose[4:].tolist()), matrices(pose[:4]).tolist())


def _plane(arm: Arm, wanted: BendingPlane, pose: Array) -> BendingPlane:
    """Return the bending plane whose tangent points from the base to the handle."""
    along, n, b = (pose[4:] - np.array(arm.base_position)) @ np.array(arm.base_frame)
    return _bent(wanted, float(np.arctan2(-n, b)), float(np.arctan2(np.hypot(n, b), along)))


def _bent(wanted: BendingPlane, angle: float, bend: float) -> BendingPlane:
    """Return the target with another plane and bend [rad]."""
    return replace(wanted, angle=float(angle), bend=float(np.clip(bend, _LEAST, np.pi)))


def _end(arm: Arm, wanted: BendingPlane) -> Array:
    """Return the pose of the handle on the tangent, at an arm length from the base."""
    place = np.array(arm.base_position) + arm.length * tangent(arm, wanted)
    return np.concatenate([_UPRIGHT, place])


def _moved_to(pose: Array, millimetres: Array) -> Array:
    return np.concatenate([pose[:4], 1e-3 * np.asarray(millimetres)])


def _angles(pose: Array) -> Array:
    """Return the rotations [deg] about the fixed axes x, then y, then z that give a pose."""
    turned = Rotation.from_quat(pose[:4], scalar_first=True)
    return np.asarray(turned.as_euler("xyz", degrees=True))


def _turned(pose: Array, degrees: Array) -> Array:
    turned = Rotation.from_euler("xyz", degrees, degrees=True)
    return np.concatenate([turned.as_quat(scalar_first=True), pose[4:]])


_PLACE = Numbers("Target x, y, z [mm]", lambda pose: 1e3 * pose[4:], _moved_to)
_TURNS = Numbers("Turned about x, y, z [deg]", _angles, _turned)
