"""One arm in the hand: a pose that moves, tensions that follow it, and the plan once it rests."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from model.arm import Arm
from model.effects import Effect
from model.errors import OctoplanError
from model.obstacles import check_obstacles
from model.paths import Array
from model.scene import Scene
from model.settle import ACCURACY
from model.shape import Shape
from model.stiffness import stiffness
from model.time_limit import check_time
from planner.live.follower import THERE, Follower
from planner.live.handles import Handle, on_the_way
from planner.plan import Plan, plan
from planner.program.limits import Limits, natural_tensions
from planner.question import checked_limits
from planner.tendon_lengths import strokes, zeroed_at

# The accuracy of ellipsoids, and of what is drawn while the target moves: a pixel or so.
_ROUGH, _SEEN = 1e-2, 1e-3
# The farthest that a plan follows its target from picture to picture, over the arm's length; how
# long that may take, and how long the arm moves on by itself before it is drawn [s].
_SHORT, _SLOW, _PICTURE = 0.02, 0.1, 0.04
# First guesses where a plan is followed; there is one more place that it can be searched from.
_FEW = 1


@dataclass(frozen=True, eq=False)
class Step:
    """The arm on its way to a target.

    Attributes
    ----------
    shape : Shape
        As it is now.
    missed : float
        How far it is from the target [m]; of a target without a place by its angle [rad].
    more : bool
        Whether a further step brings it nearer.
    """

    shape: Shape
    missed: float
    more: bool


class Session:
    """An arm, effects and obstacles that may be switched, where it is, and its last plan.

    While the target moves the last plan's optimum is followed, as long as that is fast; otherwise
    the arm moves on by planner.live.follower. Plans are searched for once the target rests.

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
    last : Plan or None
        The last plan.
    """

    def __init__(self, arm: Arm, scene: Scene, handle: Handle, options: dict[str, Any]) -> None:
        self.arm, self.effects, self.handle, self._options = arm, scene.effects, handle, options
        self._accuracy = options.get("accuracy", ACCURACY)
        self.enabled: dict[Effect, bool] = dict.fromkeys(scene.effects, True)
        self.obstacles = check_obstacles(options.get("obstacles", ()))
        self.present = [True] * len(self.obstacles)
        self.pose = handle.start
        self.last: Plan | None = None
        self._follower: Follower | None = None
        self._stated: tuple[Any, ...] = ()
        self._here, self._slow = handle.start, False

    @property
    def scene(self) -> Scene:
        """The scene of the effects that are enabled; raises InputError where they do not go."""
        return Scene(*(effect for effect in self.effects if self.enabled[effect]))

    @property
    def shape(self) -> Shape | None:
        """The arm as it is now; None before its first step."""
        return None if self._follower is None else self._follower.shape

    @property
    def limits(self) -> Limits:
        """The limits of tensions and strokes."""
        given, scene = self._options, self.scene
        ends = (given.get("stroke_max"), given.get("stroke_min"))
        most, least = given.get("tension_max", np.inf), given.get("tension_min", 0.0)
        limits = checked_limits(self.arm, most, least, given.get("total_pull"), ends)
        zero = zeroed_at(self.arm, scene, given.get("stroke_zero", "straight"))
        return replace(limits, stroke_zero=zero)

    @property
    def most(self) -> Array:
        """The tension at which each tendon has its last colour, and its bar is full [N]."""
        if self.shape is None:
            return natural_tensions(self.arm)
        upper, T = np.array(self._stated[1].upper), self.shape.tensions
        return np.where(np.isfinite(upper) & (upper > 0), upper, max(float(T.max()), 1e-9))

    @property
    def strokes(self) -> Array:
        """What winches have taken in (n_tendons,) [m]; nan before the first step."""
        if self.shape is None:
            return np.full(self.arm.n_tendons, np.nan)
        return strokes(self.shape, self._stated[1].stroke_zero)

    @property
    def is_there(self) -> bool:
        """Whether the arm is at the target, as far as a picture shows."""
        return self.shape is not None and self.missed <= THERE * self.arm.length

    @property
    def missed(self) -> float:
        """How far the arm is from the target, see Step; infinite before its first step."""
        return np.inf if self.shape is None else self.handle.goal(self.pose).missed(self.shape)

    @property
    def is_planned(self) -> bool:
        """Whether the arm as it is now is the last plan's, for the target as it is now."""
        last, shape = self.last, self.shape
        if last is None or shape is None or not self._is_of(last, self.handle.target(self.pose)):
            return False
        return bool(np.array_equal(np.ravel(last.tensions), shape.tensions))

    def step(self) -> Step:
        """Bring the arm nearer to the target, for no longer than a picture; see Step.

        Raises OctoplanError where effects do not go together, or the arm does not stand at all.
        """
        follower = self._ready()
        if self._leads() and self._followed():
            return Step(follower.shape, self.missed, not np.array_equal(self._here, self.pose))
        more = follower.approach(self.handle.goal(self.pose), _PICTURE)
        self._here = self.pose
        missed = self.missed
        return Step(follower.shape, missed, more and missed > THERE * self.arm.length)

    def settled(self) -> Plan | None:
        """Return the plan for a target that rests, as accurate as asked; None before a step.

        It begins with the arm as it is. Where that leads to no plan that meets the target, while
        the arm does, the arm stays: it is no plan.
        """
        if self._follower is None:
            return None
        target, last = self.handle.target(self.pose), self.last
        if last is not None and self._is_of(last, target) and last.accuracy <= self._accuracy:
            return last
        found = self._plan(near=self._near(target))
        check_time()  # what was cut short is no plan to go on with
        self.last = found
        if found.mode == "exact" or not self.is_there:
            self._follower.shape = found.shape
        self._here, self._slow = self.pose, False
        return found

    def ellipsoid(self, p: Plan) -> tuple[Array, Array]:
        """Return the half axes (3,) of a plan's compliance at the tip [m/N], and directions."""
        by = p.machine_code
        k = stiffness(self.arm, p.tensions, p.scene, accuracy=_ROUGH, compile=by)
        return k.ellipsoid()

    def _ready(self) -> Follower:
        """Return what follows in the scene as it is switched now."""
        scene, there = self.scene, self._there
        if self._follower is None or self._stated[0] != (scene, there):
            limits, T = self.limits, None if self.shape is None else self.shape.tensions
            around = (there, self._options.get("clearance", 0.0))
            asked = (self.arm, scene, limits, around, bool(self._options.get("compile")))
            try:
                self._follower = Follower(*asked, tensions=T)
            except OctoplanError:
                if T is None:
                    raise
                self._follower = Follower(*asked)
            self._stated = ((scene, there), limits)
        return self._follower

    @property
    def _there(self) -> tuple[Any, ...]:
        own = zip(self.obstacles, self.present, strict=True)
        return tuple(obstacle for obstacle, here in own if here)

    def _leads(self) -> bool:
        """Whether there is a plan whose optimum can be followed, and is soon enough."""
        last = self.last
        return (
            last is not None
            and not self._slow
            and last.mode == "exact"
            and last.scene == self.scene
            and last.surroundings.obstacles == self._there
            and np.array_equal(np.ravel(last.tensions), self._ready().shape.tensions)
        )

    def _followed(self) -> bool:
        """Follow the last plan's optimum a short way; return whether it led there."""
        here = on_the_way(self._here, self.pose, _SHORT * self.arm.length)
        began = time.perf_counter()
        accuracy = max(_SEEN, self._accuracy)
        asked = {"accuracy": accuracy, "starts": _FEW, "time_limit": 2 * _SLOW}
        found = self._plan(self.handle.target(here), self.last, **asked)
        took = time.perf_counter() - began
        self._slow = took > _SLOW
        if found.mode != "exact" or found.jump or found.stopped or len(found.starts) != 1:
            self._slow = True
            return False
        self.last, self._here, self._ready().shape = found, here, found.shape
        return True

    def _near(self, target: Any) -> Plan | None:
        """Return the arm as it is now, as a plan that the next one begins with."""
        last, shape = self.last, self.shape
        if last is None or shape is None or last.scene != shape.scene:
            return None
        if np.array_equal(np.ravel(last.tensions), shape.tensions):
            return last
        tensions = self.arm.by_section(shape.tensions)
        return replace(last, tensions=tensions, targets=(target,), lam_x=(), lam_g=())

    def _is_of(self, last: Plan, target: Any) -> bool:
        return last.targets == (target,) and (last.scene, last.surroundings.obstacles) == (
            self.scene,
            self._there,
        )

    def _plan(self, target: Any = None, near: Plan | None = None, **options: Any) -> Plan:
        there = self._there
        asked = self._options | {"obstacles": there} | options
        if not there and not asked.get("self_clearance"):
            asked["clearance"] = 0.0  # there is nothing left to be clear of
        wanted = self.handle.target(self.pose) if target is None else target
        return plan(self.arm, wanted, self.scene, near=near, progress=False, **asked)
