"""Hold an object: contact forces that balance a wrench on it within their friction cones."""

from __future__ import annotations

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.extensions.obstacles.base import Convex
from octoplan.model.support.errors import InputError
from octoplan.model.support.quantities import NotNegative
from octoplan.model.support.value import value
from octoplan.planner.targets.base import Target

WRENCH = "balance of the held wrench"
# What moments are divided by to be compared with forces, over the arm's length.
LEVER = 0.1


@value
class Hold(Target):
    """Contact forces with which the arm can balance a wrench on an object.

    The static grasp problem: the normal forces are those of the arm in equilibrium, without
    friction; at each place that touches a tangential force is free within Coulomb's cone,
    of size at most friction times the normal force; together they balance the wrench. That the
    tangential forces push back on the arm is left out: they are taken as small against what bends
    it. The scene has the obstacle as a Contact, and the object does not move.

    Attributes
    ----------
    obstacle : Convex
        Such as a Sphere, Capsule, Box or HalfSpace.
    wrench : (3,) or (6,)
        On the object, base frame, such as its weight: a force [N], moments being taken up by
        something else; or force and moment about its centre [N, N m].
    friction : float
        Coulomb's coefficient between arm and object.
    """

    obstacle: Convex
    wrench: tuple[float, ...]
    friction: NotNegative = 0.0

    def __post_init__(self) -> None:
        if len(self.wrench) not in (3, 6):
            allowed = "a force (3,) [N], or force and moment (6,) [N, N m]"
            raise InputError("Hold.wrench", self.wrench, allowed)
        if not any(self.wrench):
            raise InputError("Hold.wrench", self.wrench, "a force or moment that is not 0")

    def size(self, arm: Arm) -> float:
        """Return how large the wrench is [N], moments over a tenth of the arm's length."""
        scaled = np.array(self.wrench)
        scaled[3:] /= LEVER * arm.length
        return float(np.linalg.norm(scaled))
