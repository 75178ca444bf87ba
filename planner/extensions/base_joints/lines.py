"""Midlines of an arm whose base moves along joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from octoplan.model.centreline import Centreline
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.planner.extensions.avoidance.lines import Lines
from octoplan.planner.extensions.base_joints.placement import JointPlacement, moved_poses


class MovingLines(Lines):
    """Tensions and joint values to midlines; see Lines.

    Without joint values, the base is that of the placement.
    """

    def __init__(
        self,
        placement: JointPlacement,
        scene: Scene,
        refinement: int,
        at: tuple[float, ...],
        machine_code: bool,
    ) -> None:
        super().__init__(placement.arm, scene, refinement, at, machine_code)
        self._placement = placement

    def __call__(self, tensions: Array) -> Centreline | None:
        """Return the centreline under tensions and joint values (n_tendons + 2,), or None."""
        if self.loaded:
            return super().__call__(tensions)
        T, joints = self._split(tensions)
        line = super().__call__(T)
        if line is None or joints == self._placement.values:
            return line
        placement = self._placement.at(joints)
        change = np.array(joints) - self._placement.values
        poses = moved_poses(line.poses[None], self.arm, change[None])[0]
        return replace(line, arm=placement.arm, poses=poses)

    def _split(self, tensions: Array) -> tuple[Array, tuple[float, ...]]:
        """Return the tensions and the joint values, by default those of the placement."""
        n = self.arm.n_tendons
        return tensions[:n], tuple(tensions[n:].tolist()) or self._placement.values

    def lengths(self, tensions: Array) -> Array:
        """Return the lengths of the tendons (n_tendons,) [m] for tensions and joint values."""
        return super().lengths(tensions if self.loaded else self._split(tensions)[0])

    def _equilibrium(self, tensions: Array) -> Equilibrium | None:
        """Return the equilibrium under tensions and joint values (n_tendons + 2,), or None."""
        T, joints = self._split(tensions)
        arm = self._placement.at(joints).arm
        forward = CollocationMap(self._forward.system.with_base(arm))
        return self._near(forward, T, np.append(T, joints))
