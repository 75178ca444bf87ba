"""The placement of an arm whose base moves along joints, and the checks of the argument `base`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.effects.base import Effect
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.support.checks import kind
from octoplan.model.support.errors import InputError
from octoplan.planner.block import Block
from octoplan.planner.certificate import Check
from octoplan.planner.extensions.base_joints.block import JointBlock, joint_text
from octoplan.planner.extensions.base_joints.joints import BaseJoints, BasePosition
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.targets.base import Target

# Relative distance from a limit below which a joint is at its limit, over the range [-].
_AT_LIMIT = 1e-6


@dataclass(frozen=True)
class JointPlacement:
    """A base at joint values; see octoplan.planner.block.Placement.

    Attributes
    ----------
    home : Arm
        The arm at joint values 0.
    joints : BaseJoints
    values : (insertion [m], rotation [rad])
    """

    home: Arm
    joints: BaseJoints
    values: tuple[float, ...] = field(default=(0.0, 0.0))

    @cached_property
    def arm(self) -> Arm:
        """The arm at the joint values."""
        return self.joints.moved(self.home, self.position)

    @property
    def position(self) -> BasePosition:
        """The joint values by name."""
        return BasePosition(*self.values)

    def at(self, values: tuple[float, ...]) -> JointPlacement:
        """Return the placement at other joint values; at 0 for no values."""
        return replace(self, values=tuple(values) or (0.0, 0.0))

    def blocks(self, norm: str) -> tuple[Block, ...]:
        """Return the block of the joints."""
        joints = self.joints
        has = joints.insertion is not None, joints.rotation is not None
        return (JointBlock(*has, norm, self.arm, joints, self.position),)

    def guesses(self, problem: PlanningProblem, missed: bool) -> Iterator[Array]:
        """Yield initial tensions and joint values."""
        from octoplan.planner.extensions.base_joints.guesses import guesses

        yield from guesses(problem, self, missed)

    def checks(self) -> Mapping[str, Check]:
        """Return the violation of the limits of each joint."""
        low, high = self.joints.limits
        names = {"insertion": "insertion limit violated by [m]"}
        names["rotation"] = "rotation limit violated by [rad]"
        pairs = zip(names.items(), self.values, low, high, strict=True)
        return {
            text: Check(max(least - value, value - most, 0.0), 0.0)
            for (name, text), value, least, most in pairs
            if getattr(self.joints, name) is not None
        }

    def remark(self) -> str:
        """Return a sentence about the joint values and the limits that they are at."""
        low, high = self.joints.limits
        verbs = {"insertion": "inserted by", "rotation": "rotated by"}
        parts = list[str]()
        for k, (name, verb) in enumerate(verbs.items()):
            if getattr(self.joints, name) is None:
                continue
            near = _AT_LIMIT * (high[k] - low[k])
            at = ""
            if low[k] < high[k]:
                at = " (its minimum)" * (self.values[k] <= low[k] + near)
                at += " (its maximum)" * (self.values[k] >= high[k] - near)
            parts.append(f"{verb} {joint_text(name, self.position)}{at}")
        return f"The base is {' and '.join(parts)}."


def placed(problem: PlanningProblem, joints: Any) -> PlanningProblem:
    """Return a problem with base joints, at the joint values nearest to 0.

    Raises InputError for joints that the problem cannot have.
    """
    placement = placement_of(problem.arm, problem.scene, problem.targets, joints)
    if problem.environment.of_itself:
        raise InputError("base", joints, "None beside self_clearance: its base plane is fixed")
    return replace(problem, arm=placement.arm, placement=placement)


def placement_of(
    arm: Arm, scene: Scene, targets: tuple[Target, ...], joints: Any
) -> JointPlacement:
    """Return the placement of an arm at the joint values nearest to 0.

    Raises InputError for joints that the arm, the scene or the targets cannot have.
    """
    kind("base", joints, BaseJoints, "BaseJoints, such as BaseJoints(insertion=(0, 0.05)), or None")
    joints.check(arm)
    parts: tuple[Effect | Target, ...] = (*scene.effects, *targets)
    for each in parts:
        if each.plan_strategy:
            name = type(each).__name__
            raise InputError("base", joints, f"None with {name}: the base is fixed in contact")
    return JointPlacement(arm, joints, tuple(joints.reference))


def moved_poses(poses: Array, arm: Arm, change: Array) -> Array:
    """Return poses (m, K, 7) of an arm whose base moves by changes (m, 2) of the joint values."""
    frame = np.array(arm.base_frame)
    axis = frame[:, 0]
    origin = np.array(arm.base_position)
    half = change[:, 1] / 2
    w = np.cos(half)[:, None]
    v = np.sin(half)[:, None, None] * axis
    q = poses[..., :4]
    turned = np.empty_like(poses)
    turned[..., 0] = w * q[..., 0] - (v * q[..., 1:]).sum(axis=-1)
    turned[..., 1:4] = w[..., None] * q[..., 1:] + q[..., :1] * v
    turned[..., 1:4] += np.cross(np.broadcast_to(v, q[..., 1:].shape), q[..., 1:])
    off = poses[..., 4:] - origin
    twice = 2 * np.cross(np.broadcast_to(v, off.shape), off)
    moved = off + w[..., None] * twice + np.cross(np.broadcast_to(v, off.shape), twice)
    turned[..., 4:] = origin + moved + change[:, :1, None] * axis
    return turned
