"""Bend in a given plane, by the tendons of one section."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import casadi as ca
import numpy as np
from msgspec import Meta

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.support.quantities import Angle, unit
from octoplan.model.support.units import ANGLE, warn_unusual
from octoplan.model.support.value import value
from octoplan.planner.targets.base import Target, Terms, View, toward


@value
class BendingPlane(Target):
    """Bend by an angle in a plane, pulling tendons of one section only.

    The plane is where the tip goes, as section 6.1 and figure 10 have it: towards
    e = cos(angle) b - sin(angle) n of the base. The bend is the angle in that plane from the
    tangent at the base to the tangent at the tip.

    Attributes
    ----------
    angle : float
        Of the plane [rad]; pulling T_i2 alone is 0, T_i3 90, T_i4 180, T_i1 -90 degrees.
    bend : float
        In (0, pi] [rad].
    section : int
        Whose tendons pull, 1 at the tip.
    """

    angle: Angle
    bend: Annotated[float, unit("deg", gt=0, le=np.pi)]
    section: Annotated[int, Meta(ge=1)] = 1

    def __post_init__(self) -> None:
        warn_unusual("BendingPlane.angle", [self.angle], ANGLE)

    def check(self, arm: Arm) -> None:
        """See Target.check."""
        arm.tendons_of(self.section)

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: e (3,) and the bend."""
        return np.append(toward(arm, self.angle), self.bend)

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms."""
        e, bend = p[:3], p[3]
        t = view.base_frame[:, 0]
        tip = (view.tip - view.base_position) / view.arm.length
        tangent = view.tip_frame[:, 0]
        along, across = ca.dot(tangent, t), ca.dot(tangent, e)
        # The angle jumps half a turn from where it is measured. Measured from half the bend, the
        # jump is away from the straight arm also where half a turn is wanted, and an arm that
        # cannot bend so far bends towards its side, not to the opposite one.
        off = across * ca.cos(bend / 2) - along * ca.sin(bend / 2)
        near = across * ca.sin(bend / 2) + along * ca.cos(bend / 2)
        return Terms(
            equality={
                "bending plane": ca.dot(tip, ca.cross(t, e)),
                "bend": ca.atan2(off, near) - bend / 2,
            },
            high_priority=frozenset({"bending plane"}),
            units={"bending plane": "L", "bend": "rad"},
        )

    def tendons(self, arm: Arm) -> frozenset[int]:
        """See Target.tendons."""
        return frozenset(arm.tendons_of(self.section))

    def prescribed(self, arm: Arm) -> Mapping[str, Array]:
        """See Target.prescribed."""
        return {"bending plane and bend": np.array([self.angle, self.bend, self.section])}
