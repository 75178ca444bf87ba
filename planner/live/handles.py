"""What is dragged on the page: a handle's pose as a target, and the target's as a pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from model.arm import Arm
from model.errors import InputError
from model.paths import Array
from model.rotations import from_matrix, matrices
from planner.targets import BendingPlane, TipPose, TipPosition
from planner.targets.base import Target, toward

# The least bend that is asked for, where the plane is still told apart [rad].
_LEAST = 0.02
# Handles that are not turned stand along x, y, z.
_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


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
    """

    turns: bool
    start: Array
    target: Callable[[Array], Target]


def on_the_way(here: Array, wanted: Array, most: float) -> Array:
    """Return the pose (7,) on the way from one to another that is at most so far [m]; or the last.

    A turn of a radian counts as far as ten steps.
    """
    turn = wanted[:4] if here[:4] @ wanted[:4] >= 0 else -wanted[:4]
    away = float(np.linalg.norm(wanted[4:] - here[4:])) / most
    turned = 20 * float(np.linalg.norm(turn - here[:4]))
    if max(away, turned) <= 1:
        return wanted
    found = here + (np.concatenate([turn, wanted[4:]]) - here) / max(away, turned)
    found[:4] /= np.linalg.norm(found[:4])
    return np.asarray(found)


def handle_of(arm: Arm, targets: tuple[Target, ...]) -> Handle:
    """Return the handle of a scene's target; InputError where it has none."""
    wanted = targets[0] if len(targets) == 1 else None
    if isinstance(wanted, TipPosition):
        start = np.concatenate([_UPRIGHT, wanted.position])
        return Handle(False, start, lambda pose: TipPosition(tuple(pose[4:].tolist())))
    if isinstance(wanted, TipPose):
        turned = from_matrix(np.array(wanted.frame))
        return Handle(True, np.concatenate([turned, wanted.position]), _pose)
    if isinstance(wanted, BendingPlane):
        start = np.concatenate([_UPRIGHT, _end(arm, wanted)])
        return Handle(False, start, lambda pose: _bend(arm, wanted.section, pose[4:]))
    kinds = [type(target).__name__ for target in targets]
    raise InputError("target", kinds, "one TipPosition, TipPose or BendingPlane to drag")


def _pose(pose: Array) -> TipPose:
    frame = matrices(pose[None, :4])[0]
    return TipPose(tuple(pose[4:].tolist()), tuple(tuple(row) for row in frame.tolist()))


def _end(arm: Arm, wanted: BendingPlane) -> Array:
    """Return the end of the tip's tangent, an arm's length from the base: what bends is dragged."""
    t = np.array(arm.base_frame)[:, 0]
    direction = np.cos(wanted.bend) * t + np.sin(wanted.bend) * toward(arm, wanted.angle)
    return np.asarray(np.array(arm.base_position) + arm.length * direction)


def _bend(arm: Arm, section: int, place: Array) -> BendingPlane:
    frame = np.array(arm.base_frame)
    along, n, b = (place - np.array(arm.base_position)) @ frame
    bend = float(np.arctan2(np.hypot(n, b), along))
    return BendingPlane(float(np.arctan2(-n, b)), min(max(bend, _LEAST), np.pi), section)
