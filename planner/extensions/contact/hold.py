"""Target: hold an object by contact forces within friction cones that balance a wrench."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.extensions.obstacles.base import Convex
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.support.errors import InputError
from octoplan.model.support.value import NotNegative, value
from octoplan.planner.extensions.contact.grasp import LEVER, Grasp
from octoplan.planner.limits import TendonLimits
from octoplan.planner.targets.base import Target

WRENCH = "balance of the held wrench"


@value
class Hold(Target):
    """Contact forces with which the arm can balance a wrench on an object.

    The static grasp problem. The normal forces follow from the equilibrium of the arm without
    friction. Each contact point adds a free tangential force within Coulomb's cone, of at most the
    friction coefficient times the normal force. Together the forces balance the wrench. The
    reaction of the tangential forces on the arm is neglected, as small compared with the loads that
    bend it. The scene contains the obstacle as a Contact, and the object does not move.

    The normal forces of an arm around an object grow with the difference between the curvature of
    the free arm and the curvature of the object. An arm of given curvature grips objects of about
    half its curvature hardest. A quarter of a turn touches at one point, and the object can slip
    out without friction; half a turn and more hold the object; see the study `grip`
    in studies/README.md.

    Attributes
    ----------
    obstacle : Convex
        Such as a Sphere, Capsule, Box or HalfSpace.
    wrench : (3,) or (6,)
        Wrench on the object in the base frame, such as its weight: a force [N], if something else
        supports moments; or force and moment about the object's centre [N, N m].
    friction : float
        Coulomb's coefficient between arm and object.
    """

    plan_strategy = "contact"
    success = "Held"

    obstacle: Convex
    wrench: tuple[float, ...]
    friction: NotNegative = 0.0

    def __post_init__(self) -> None:
        if len(self.wrench) not in (3, 6):
            allowed = "a force (3,) [N], or force and moment (6,) [N, N m]"
            raise InputError("Hold.wrench", self.wrench, allowed)
        if not any(self.wrench):
            raise InputError("Hold.wrench", self.wrench, "a force or moment that is not 0")

    def scaled(self, arm: Arm) -> Array:
        """Return the wrench [N], with moments over LEVER times the arm's length."""
        scaled = np.array(self.wrench)
        scaled[3:] /= LEVER * arm.length
        return scaled

    def size(self, arm: Arm) -> float:
        """Return the norm of the scaled wrench [N]."""
        return float(np.linalg.norm(self.scaled(arm)))

    def equilibrium_residuals(self, shape: Shape) -> Mapping[str, Array]:
        """See Target.equilibrium_residuals: the wrench that remains, over its size."""
        return {WRENCH: Grasp.of(shape.arm, shape.contacts, self).least}

    def remark(self, shape: Shape, limits: TendonLimits, missed: bool, accuracy: float) -> str:
        """See Target.remark: the friction that the grasp needs, or the wrench that remains."""
        grasp, size = Grasp.of(shape.arm, shape.contacts, self), self.size(shape.arm)
        if np.linalg.norm(grasp.least) <= 10 * accuracy:
            needed = self.friction * grasp.needed_friction(10 * accuracy)
            return (
                f"The wrench is held with friction from {needed:.3g} on, {self.friction:g} given."
            )
        units = np.repeat([size, size * LEVER * shape.arm.length], 3)[: grasp.least.size]
        left = [f"{component:.3g}" for component in units * grasp.least]
        more = f" and a moment ({', '.join(left[3:])}) N m" if left[3:] else ""
        left_over = f"a force ({', '.join(left[:3])}) N{more} is left"
        if not grasp.most.size:
            return f"The arm does not touch the object in that shape: of the wrench {left_over}."
        return f"Of the wrench {left_over}; more friction or tension may hold it."
