"""An interactive session: a moving target, tensions that follow, and a plan at rest."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.obstacles.base import Obstacle, check_obstacles
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.shape import Shape
from octoplan.model.stiffness import stiffness
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import check_time
from octoplan.model.tendons import strokes
from octoplan.planner.frontends.live.follower import ACCURACY, Follower
from octoplan.planner.frontends.live.handles import Goal, Handle, goal_of
from octoplan.planner.limits import checked_limits
from octoplan.planner.plan import plan
from octoplan.planner.plan_result import Plan
from octoplan.planner.targets import BendingPlane, TipPose, TipPosition

# Computing time between two pictures of the moving arm [s].
_PICTURE = 0.02


class Session:
    """An arm with switchable effects and obstacles, the shape, and the last plan.

    Attributes
    ----------
    handle : Handle
        The handle of the target.
    pose : (7,)
        Current pose of the handle.
    enabled : dict
        Whether each effect of the scene is enabled.
    obstacles : tuple of Obstacle
    present : list of bool
        Whether each obstacle is enabled.
    shape : Shape or None
        Current shape of the arm; None before the first step.
    last : Plan or None
        The last plan.
    """

    def __init__(self, arm: Arm, scene: Scene, handle: Handle, options: dict[str, Any]) -> None:
        self.arm = arm
        self.effects = scene.effects
        self.handle = handle
        self._options = options
        self.enabled: dict[Effect, bool] = dict.fromkeys(scene.effects, True)
        self.obstacles = check_obstacles(options.get("obstacles", ()))
        self.present = [True] * len(self.obstacles)
        self.pose = handle.start
        self.shape: Shape | None = None
        self.last: Plan | None = None
        self._follower: Follower | None = None

    @property
    def scene(self) -> Scene:
        """Scene with the enabled effects; raises InputError for an invalid combination."""
        return Scene(*(effect for effect in self.effects if self.enabled[effect]))

    @property
    def there(self) -> tuple[Obstacle, ...]:
        """Enabled obstacles."""
        return tuple(
            obstacle for obstacle, here in zip(self.obstacles, self.present, strict=True) if here
        )

    @property
    def target(self) -> TipPosition | TipPose | BendingPlane:
        """Target at the current pose of the handle."""
        return self.handle.target(self.pose)

    @property
    def goal(self) -> Goal:
        """Goal of the target for the arm."""
        return goal_of(self.arm, self.target)

    @property
    def missed(self) -> float:
        """Distance from the target, see Goal.missed; infinite before the first step."""
        return np.inf if self.shape is None else self.goal.missed(self.shape)

    @property
    def is_there(self) -> bool:
        """True if the arm is at the target to the accuracy of the picture."""
        # A miss in rad is not divided by the arm length.
        unit = 1.0 if self.goal.position is None else self.arm.length
        return self.missed <= ACCURACY * unit

    @property
    def is_held(self) -> bool:
        """True if the arm becomes unstable closer to the target."""
        return self._follower is not None and self._follower.brink

    @property
    def is_planned(self) -> bool:
        """True if the current arm is that of the last plan, with the current target."""
        last = self.last
        now = ((self.target,), self.scene, self.there)
        if last is None or self.shape is not last.shape:
            return False
        return (last.targets, last.scene, last.problem.environment.obstacles) == now

    def step(self) -> bool:
        """Move the arm towards the target for at most a picture's time; return whether to continue.

        Raises OctoplanError for an invalid combination of effects, or without a stable shape.
        """
        follower = self._make_follower()
        if self.is_planned:
            return False
        more = follower.approach(self.goal, _PICTURE)
        self.shape = follower.shape
        return more

    def settled(self) -> Plan | None:
        """Return the plan for the current target to full accuracy; None before the first step.

        The plan starts from the current arm. If the plan neither meets the target nor has a closer
        tip, the arm stays unplanned.
        """
        if self._follower is None or self.is_planned:
            return self.last
        request = self._options | {"obstacles": self.there}
        if not self.there and not request.get("self_clearance"):
            request["clearance"] = 0.0  # nothing is left to keep clear of
        target = self.target
        scene = self.scene
        near = self._warm_start
        result = plan(self.arm, target, scene, near=near, progress=False, **request)
        check_time()  # discard a plan that was cut off
        self.last = result
        missed = self.goal.missed(result.shape)
        if result.mode == "exact" or (missed < self.missed and not self.is_there):
            self.shape = result.shape
            self._follower.begin(result.shape)
        return result

    def ellipsoid(self, p: Plan) -> tuple[Array, Array]:
        """Return the half axes (3,) of a plan's compliance at the tip [m/N], and directions."""
        by = p.problem.machine_code
        k = stiffness(self.arm, p.tensions, p.scene, accuracy=ACCURACY, compile=by)
        return k.ellipsoid()

    @property
    def most(self) -> Array:
        """Tensions of full bars and of the colour `high` (n_tendons,) [N]."""
        if self._follower is None or self.shape is None:
            return np.full(self.arm.n_tendons, np.nan)
        upper = np.array(self._follower.limits.upper)
        largest = max(float(self.shape.tensions.max()), 1e-9)
        return np.where(np.isfinite(upper) & (upper > 0), upper, largest)

    @property
    def strokes(self) -> Array:
        """Lengths that the winches have taken in (n_tendons,) [m]; nan before the first step."""
        if self._follower is None or self.shape is None:
            return np.full(self.arm.n_tendons, np.nan)
        return strokes(self.shape, self._follower.limits.stroke_zero)

    def _make_follower(self) -> Follower:
        """Return the follower for the enabled effects and obstacles, from the current shape."""
        scene = self.scene
        around = (self.there, self._options.get("clearance", 0.0))
        before = self._follower
        self._follower = None
        if before is None or (before.shape.scene, before.around) != (scene, around):
            code = bool(self._options.get("compile"))
            limits = checked_limits(self.arm, scene, **self._options)
            limits = limits.of_tendons(self.target.tendons(self.arm))
            tensions = None if before is None else before.shape.tensions
            try:
                before = Follower(self.arm, scene, limits, around, code, tensions)
            except OctoplanError:
                before = Follower(self.arm, scene, limits, around, code)
        self._follower = before
        return before

    @property
    def _warm_start(self) -> Plan | None:
        """The current arm as a plan from which the next one is warm-started."""
        last = self.last
        shape = self.shape
        if last is None or shape is None or last.scene != self.scene:
            return None
        if shape is last.shape:
            return last
        tensions = self.arm.by_section(shape.tensions)
        problem = replace(last.problem, targets=(self.target,))
        solution = replace(last.solution, tensions=tensions, lam_x=(), lam_g=())
        return replace(last, problem=problem, solution=solution)
