"""One arm in the hand: a pose that moves, tensions that follow it, and the plan once it rests."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.effects import Effect
from octoplan.model.extensions.obstacles import Obstacle, check_obstacles
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.shape import Shape
from octoplan.model.stiffness import stiffness
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import check_time
from octoplan.planner.frontends.live.follower import ACCURACY, Follower
from octoplan.planner.frontends.live.handles import Goal, Handle, goal_of
from octoplan.planner.limits import checked_limits
from octoplan.planner.measure import strokes
from octoplan.planner.plan import Plan, plan
from octoplan.planner.targets import BendingPlane, TipPose, TipPosition

# How long the arm moves on before it is drawn [s].
_PICTURE = 0.02


class Session:
    """An arm, effects and obstacles that may be switched, where it is, and its last plan.

    Attributes
    ----------
    handle : Handle
        What is dragged.
    pose : (7,)
        Where it is wanted now.
    enabled : dict
        Which of the scene's effects are.
    obstacles : tuple of Obstacle
    present : list of bool
        Which of the obstacles are there.
    shape : Shape or None
        The arm as it is now; None before its first step.
    last : Plan or None
        The last plan.
    """

    def __init__(self, arm: Arm, scene: Scene, handle: Handle, options: dict[str, Any]) -> None:
        self.arm, self.effects, self.handle, self._options = arm, scene.effects, handle, options
        self.enabled: dict[Effect, bool] = dict.fromkeys(scene.effects, True)
        self.obstacles = check_obstacles(options.get("obstacles", ()))
        self.present = [True] * len(self.obstacles)
        self.pose = handle.start
        self.shape: Shape | None = None
        self.last: Plan | None = None
        self._follower: Follower | None = None

    @property
    def scene(self) -> Scene:
        """The scene of the effects that are enabled; raises InputError where they do not go."""
        return Scene(*(effect for effect in self.effects if self.enabled[effect]))

    @property
    def there(self) -> tuple[Obstacle, ...]:
        """The obstacles that are present."""
        return tuple(
            obstacle for obstacle, here in zip(self.obstacles, self.present, strict=True) if here
        )

    @property
    def target(self) -> TipPosition | TipPose | BendingPlane:
        """What the handle asks for."""
        return self.handle.target(self.pose)

    @property
    def goal(self) -> Goal:
        """Where the target wants the arm."""
        return goal_of(self.arm, self.target)

    @property
    def missed(self) -> float:
        """How far the arm is from the target, see Goal.missed; infinite before its first step."""
        return np.inf if self.shape is None else self.goal.missed(self.shape)

    @property
    def is_there(self) -> bool:
        """Whether the arm is at the target, as far as a picture shows."""
        # Angles are not over the arm's length.
        unit = 1.0 if self.goal.position is None else self.arm.length
        return self.missed <= ACCURACY * unit

    @property
    def is_held(self) -> bool:
        """Whether the arm would not stand under its loads if it came nearer."""
        return self._follower is not None and self._follower.brink

    @property
    def is_planned(self) -> bool:
        """Whether the arm as it is now is the last plan's, for the target as it is now."""
        last, now = self.last, ((self.target,), self.scene, self.there)
        if last is None or self.shape is not last.shape:
            return False
        return (last.targets, last.scene, last.surroundings.obstacles) == now

    def step(self) -> bool:
        """Bring the arm nearer, for no longer than a picture; return whether more would do more.

        Raises OctoplanError where effects do not go together, or the arm has no stable shape.
        """
        follower = self._make_follower()
        if self.is_planned:
            return False
        more = follower.approach(self.goal, _PICTURE)
        self.shape = follower.shape
        return more

    def settled(self) -> Plan | None:
        """Return the plan for a target that rests, as accurate as asked; None before a step.

        It begins with the arm as it is. Where that leads to no plan that meets the target, nor to a
        shape that is nearer than the arm is, the arm stays: it is no plan.
        """
        if self._follower is None or self.is_planned:
            return self.last
        request = self._options | {"obstacles": self.there}
        if not self.there and not request.get("self_clearance"):
            request["clearance"] = 0.0  # there is nothing left to be clear of
        target, scene, near = self.target, self.scene, self._warm_start
        result = plan(self.arm, target, scene, near=near, progress=False, **request)
        check_time()  # what was cut short is no plan to go on with
        self.last = result
        missed = self.goal.missed(result.shape)
        if result.mode == "exact" or (missed < self.missed and not self.is_there):
            self.shape = result.shape
            self._follower.begin(result.shape)
        return result

    def ellipsoid(self, p: Plan) -> tuple[Array, Array]:
        """Return the half axes (3,) of a plan's compliance at the tip [m/N], and directions."""
        by = p.machine_code
        k = stiffness(self.arm, p.tensions, p.scene, accuracy=ACCURACY, compile=by)
        return k.ellipsoid()

    @property
    def most(self) -> Array:
        """The tension at which each tendon has its last colour, and its bar is full [N]."""
        if self._follower is None or self.shape is None:
            return np.full(self.arm.n_tendons, np.nan)
        upper = np.array(self._follower.limits.upper)
        largest = max(float(self.shape.tensions.max()), 1e-9)
        return np.where(np.isfinite(upper) & (upper > 0), upper, largest)

    @property
    def strokes(self) -> Array:
        """What winches have taken in (n_tendons,) [m]; nan before the first step."""
        if self._follower is None or self.shape is None:
            return np.full(self.arm.n_tendons, np.nan)
        return strokes(self.shape, self._follower.limits.stroke_zero)

    def _make_follower(self) -> Follower:
        """Return what follows in the scene as it is switched now, from where the arm is."""
        scene, around = self.scene, (self.there, self._options.get("clearance", 0.0))
        before, self._follower = self._follower, None
        if before is None or (before.shape.scene, before.around) != (scene, around):
            code = bool(self._options.get("compile"))
            limits = checked_limits(self.arm, scene, **self._options)
            limits = limits.of_tendons(self.target.tendons(self.arm))
            arguments = (self.arm, scene, limits, around, code)
            try:
                before = Follower(*arguments, None if before is None else before.shape.tensions)
            except OctoplanError:
                before = Follower(*arguments)
        self._follower = before
        return before

    @property
    def _warm_start(self) -> Plan | None:
        """The arm as it is now, as a plan that the next one begins with."""
        last, shape = self.last, self.shape
        if last is None or shape is None or last.scene != self.scene:
            return None
        if shape is last.shape:
            return last
        tensions = self.arm.by_section(shape.tensions)
        return replace(last, tensions=tensions, targets=(self.target,), lam_x=(), lam_g=())
