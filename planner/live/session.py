"""One arm in the hand: a target that moves, and the plan that follows it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from model.arm import Arm
from model.effects import Effect
from model.obstacles import check_obstacles
from model.paths import Array
from model.scene import Scene
from model.settle import ACCURACY
from model.stiffness import stiffness
from planner.plan import Plan, plan
from planner.program.limits import natural_tensions
from planner.targets.base import Target

# First guesses while the target moves beyond reach; the accuracy of ellipsoids, and of what is
# drawn while the target moves: a pixel or so.
_FEW, _ROUGH, _SEEN = 3, 1e-2, 1e-3


@dataclass(frozen=True, eq=False)
class Step:
    """A plan of a moving target; `left` says that it is not on the branch of the one before."""

    plan: Plan
    left: bool


class Session:
    """An arm, effects and obstacles that may be switched, and the last plan.

    Attributes
    ----------
    target : Target
        What is wanted now.
    enabled : dict
        Which of the scene's effects are.
    obstacles : tuple of Obstacle
    present : list of bool
        Which of the obstacles are there.
    """

    def __init__(self, arm: Arm, scene: Scene, target: Target, options: dict[str, Any]) -> None:
        self.arm, self.effects, self.target, self._options = arm, scene.effects, target, options
        self._accuracy = options.get("accuracy", ACCURACY)
        self.enabled: dict[Effect, bool] = dict.fromkeys(scene.effects, True)
        self.obstacles = check_obstacles(options.get("obstacles", ()))
        self.present = [True] * len(self.obstacles)
        self.last: Plan | None = None
        self._rough = False

    @property
    def scene(self) -> Scene:
        """The scene of the effects that are enabled; raises InputError where they do not go."""
        return Scene(*(effect for effect in self.effects if self.enabled[effect]))

    @property
    def most(self) -> Array:
        """The tension at which each tendon has its last colour, and its bar is full [N]."""
        if self.last is None:
            return natural_tensions(self.arm)
        upper, T = np.array(self.last.limits.upper), np.ravel(self.last.tensions)
        return np.where(np.isfinite(upper) & (upper > 0), upper, max(float(T.max()), 1e-9))

    @property
    def follows(self) -> bool:
        """Whether there is a plan whose optimum can be followed to a target nearby."""
        last = self.last
        return last is not None and last.mode == "exact" and last.scene == self.scene

    def step(self) -> Step:
        """Return the plan for the target as it is now, near the last one where that leads there.

        It is as accurate as a picture shows. What cannot be followed is searched for by few initial
        guesses.
        """
        last, scene = self.last, self.scene
        near = last if last is not None and last.scene == scene else None
        found = self._plan(near=near, starts=_FEW, accuracy=max(_SEEN, self._accuracy))
        known = near is not None and near.mode == "exact"
        # A plan that is followed has the one start that it was followed from.
        self._rough = not known or len(found.starts) != 1
        return Step(found, known and (found.jump > 0 or found.mode != "exact"))

    def settled(self) -> Plan | None:
        """Return the plan for a target that rests, as accurate as asked; None without one yet.

        What few initial guesses found is searched for by as many as were asked for.
        """
        last = self.last
        if self._rough:
            self._plan()
        elif last is not None and last.accuracy > self._accuracy:
            self._plan(near=last)
        self._rough = False
        return self.last

    def _plan(self, **options: Any) -> Plan:
        there = [own for own, here in zip(self.obstacles, self.present, strict=True) if here]
        asked = self._options | {"obstacles": there} | options
        if not there and not asked.get("self_clearance"):
            asked["clearance"] = 0.0  # there is nothing left to be clear of
        self.last = plan(self.arm, self.target, self.scene, **asked)
        return self.last

    def ellipsoid(self, p: Plan) -> tuple[Array, Array]:
        """Return the half axes (3,) of a plan's compliance at the tip [m/N], and directions."""
        by = p.machine_code
        k = stiffness(self.arm, p.tensions, p.scene, accuracy=_ROUGH, compile=by)
        return k.ellipsoid()
