"""What is dragged on the page: a handle's pose as a target, and the target's as a pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from model.arm import Arm
from model.errors import InputError
from model.paths import Array
from model.rotations import from_matrix, matrices
from planner.live.goal import tangent
from planner.targets import BendingPlane, TipPose, TipPosition
from planner.targets.base import Target

# The least bend that is asked for, where the plane is still told apart [rad].
_LEAST = 0.02
# Handles that are not turned stand along x, y, z.
_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class Numbers:
    """Numbers of a pose that are typed.

    Attributes
    ----------
    label : str
        What they are, with their unit.
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
        Whether it is turned too.
    start : (7,)
        Its pose where the target is: quaternion, position [m].
    target : function
        Pose (7,) -> the target it asks for.
    numbers : tuple of Numbers
    """

    turns: bool
    start: Array
    target: Callable[[Array], TipPosition | TipPose | BendingPlane]
    numbers: tuple[Numbers, ...]


def handle_of(arm: Arm, targets: tuple[Target, ...]) -> Handle:
    """Return the handle of a scene's target; InputError where it has none."""
    wanted = targets[0] if len(targets) == 1 else None
    if isinstance(wanted, TipPosition):
        start = np.concatenate([_UPRIGHT, wanted.position])
        return Handle(False, start, lambda pose: TipPosition(tuple(pose[4:].tolist())), (_PLACE,))
    if isinstance(wanted, TipPose):
        start = np.concatenate([from_matrix(np.array(wanted.frame)), wanted.position])
        return Handle(True, start, _tip_pose, (_PLACE, _TURNS))
    if isinstance(wanted, BendingPlane):
        section = wanted.section
        numbers = Numbers(
            "Plane, bend [deg]",
            lambda pose: np.degrees([(at := _plane(arm, section, pose)).angle, at.bend]),
            lambda _, typed: _end(arm, _bent(section, *np.radians(typed))),
        )
        return Handle(False, _end(arm, wanted), partial(_plane, arm, section), (numbers,))
    kinds = [type(target).__name__ for target in targets]
    raise InputError("target", kinds, "one TipPosition, TipPose or BendingPlane to drag")


def _tip_pose(pose: Array) -> TipPose:
    return TipPose(tuple(pose[4:].tolist()), matrices(pose[:4]).tolist())


def _plane(arm: Arm, section: int, pose: Array) -> BendingPlane:
    """Return the bend that brings the tangent to the handle, as seen from the base."""
    along, n, b = (pose[4:] - np.array(arm.base_position)) @ np.array(arm.base_frame)
    return _bent(section, float(np.arctan2(-n, b)), float(np.arctan2(np.hypot(n, b), along)))


def _bent(section: int, angle: float, bend: float) -> BendingPlane:
    return BendingPlane(float(angle), float(np.clip(bend, _LEAST, np.pi)), section)


def _end(arm: Arm, wanted: BendingPlane) -> Array:
    """Return the pose at the end of the tangent, an arm's length from the base."""
    place = np.array(arm.base_position) + arm.length * tangent(arm, wanted)
    return np.concatenate([_UPRIGHT, place])


def _placed(pose: Array, millimetres: Array) -> Array:
    return np.concatenate([pose[:4], 1e-3 * np.asarray(millimetres)])


def _angles(pose: Array) -> Array:
    """Return the rotations [deg] about x, then y, then z of the fixed frame that turn to a pose."""
    turned = Rotation.from_quat(pose[:4], scalar_first=True)
    return np.asarray(turned.as_euler("xyz", degrees=True))


def _turned(pose: Array, degrees: Array) -> Array:
    turned = Rotation.from_euler("xyz", degrees, degrees=True)
    return np.concatenate([turned.as_quat(scalar_first=True), pose[4:]])


_PLACE = Numbers("Target x, y, z [mm]", lambda pose: 1e3 * pose[4:], _placed)
_TURNS = Numbers("Turned about x, y, z [deg]", _angles, _turned)
