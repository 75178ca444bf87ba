"""What is dragged on the page: a handle's pose as a target, and the target's as a pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from model.arm import Arm
from model.errors import InputError
from model.paths import Array
from model.rotations import from_matrix, matrices
from planner.live.follower import Goal
from planner.targets import BendingPlane, TipPose, TipPosition
from planner.targets.base import Target, toward

# The least bend that is asked for, where the plane is still told apart [rad].
_LEAST = 0.02
# Handles that are not turned stand along x, y, z.
_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
_FREE = np.full((3, 3), np.nan)


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
    goal : function
        Pose (7,) -> where the arm is to be.
    numbers : tuple of Numbers
    """

    turns: bool
    start: Array
    target: Callable[[Array], Target]
    goal: Callable[[Array], Goal]
    numbers: tuple[Numbers, ...]


def _placed(pose: Array, millimetres: Array) -> Array:
    return np.concatenate([pose[:4], 1e-3 * np.asarray(millimetres)])


PLACE = Numbers("Target x, y, z [mm]", lambda pose: 1e3 * pose[4:], _placed)


def handle_of(arm: Arm, targets: tuple[Target, ...]) -> Handle:
    """Return the handle of a scene's target; InputError where it has none."""
    wanted, L = targets[0] if len(targets) == 1 else None, arm.length
    if isinstance(wanted, TipPosition):
        return Handle(
            False,
            np.concatenate([_UPRIGHT, wanted.position]),
            lambda pose: TipPosition(tuple(pose[4:].tolist())),
            lambda pose: Goal(L, pose[4:], _FREE),
            (PLACE,),
        )
    if isinstance(wanted, TipPose):
        return Handle(
            True,
            np.concatenate([from_matrix(np.array(wanted.frame)), wanted.position]),
            _pose,
            lambda pose: Goal(L, pose[4:], matrices(pose[None, :4])[0]),
            (PLACE, Numbers("Turned about x, y, z [deg]", _angles, _turned)),
        )
    if isinstance(wanted, BendingPlane):
        return _bending(arm, wanted)
    kinds = [type(target).__name__ for target in targets]
    raise InputError("target", kinds, "one TipPosition, TipPose or BendingPlane to drag")


def _bending(arm: Arm, wanted: BendingPlane) -> Handle:
    """Return the handle at the end of a tangent, an arm's length from the base."""
    section = wanted.section

    def target(pose: Array) -> BendingPlane:
        frame = np.array(arm.base_frame)
        along, n, b = (pose[4:] - np.array(arm.base_position)) @ frame
        bend = float(np.arctan2(np.hypot(n, b), along))
        return BendingPlane(float(np.arctan2(-n, b)), min(max(bend, _LEAST), np.pi), section)

    def goal(pose: Array) -> Goal:
        axes = _FREE.copy()
        axes[:, 0] = _tangent(arm, target(pose))
        return Goal(arm.sections[section - 1].at, None, axes)

    def read(pose: Array) -> Array:
        request = target(pose)
        return np.degrees([request.angle, request.bend])

    def write(pose: Array, degrees: Array) -> Array:
        angle, bend = np.radians(degrees)
        request = BendingPlane(float(angle), float(min(max(bend, _LEAST), np.pi)), section)
        return np.concatenate([_UPRIGHT, _end(arm, request)])

    start = np.concatenate([_UPRIGHT, _end(arm, wanted)])
    return Handle(False, start, target, goal, (Numbers("Plane, bend [deg]", read, write),))


def _tangent(arm: Arm, wanted: BendingPlane) -> Array:
    t = np.array(arm.base_frame)[:, 0]
    return np.asarray(np.cos(wanted.bend) * t + np.sin(wanted.bend) * toward(arm, wanted.angle))


def _end(arm: Arm, wanted: BendingPlane) -> Array:
    """Return the end of the tip's tangent, an arm's length from the base: what bends is dragged."""
    return np.asarray(np.array(arm.base_position) + arm.length * _tangent(arm, wanted))


def _pose(pose: Array) -> TipPose:
    frame = matrices(pose[None, :4])[0]
    return TipPose(tuple(pose[4:].tolist()), tuple(tuple(row) for row in frame.tolist()))


def _angles(pose: Array) -> Array:
    """Return the rotations [deg] about x, then y, then z of the fixed frame that turn to a pose."""
    turned = Rotation.from_matrix(matrices(pose[None, :4])[0])
    return np.asarray(turned.as_euler("xyz", degrees=True))


def _turned(pose: Array, degrees: Array) -> Array:
    turned = Rotation.from_euler("xyz", degrees, degrees=True)
    return np.concatenate([from_matrix(turned.as_matrix()), pose[4:]])
