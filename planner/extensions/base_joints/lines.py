"""Midlines of an arm whose base moves along joints."""

from __future__ import annotations

from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.load_steps import Collocation
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.planner.extensions.avoidance.lines import Lines
from octoplan.planner.extensions.base_joints.placement import JointPlacement


class MovingLines(Lines):
    """Tensions and joint values to tendon lengths; see Lines.

    Without loads the lengths do not depend on the base.
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

    def lengths(self, tensions: Array) -> Array:
        """Return the lengths of the tendons (n_tendons,) [m] for tensions and joint values."""
        n = self.arm.n_tendons
        return super().lengths(tensions if self.loaded else tensions[:n])

    def _equilibrium(self, tensions: Array) -> Equilibrium | None:
        """Return the equilibrium under tensions and joint values (n_tendons + 2,), or None."""
        T, joints = tensions[: self.arm.n_tendons], tensions[self.arm.n_tendons :]
        arm = self._placement.at(tuple(joints.tolist())).arm
        forward = Collocation(self._forward.system.with_base(arm))
        return self._near(forward, T, tensions)
