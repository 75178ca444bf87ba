"""Target: bend in a given plane, by the tendons of one section."""

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

    The tip moves in the plane of the base tangent and e = cos(angle) b - sin(angle) n of the base
    frame, towards e, as in section 6.1 and figure 10 of the paper. The bend is the angle in this
    plane from the tangent at the base to the tangent at the tip.

    Attributes
    ----------
    angle : float
        Angle of the plane [rad]: 0 degrees for T_i2 alone, 90 for T_i3, 180 for T_i4, -90 for T_i1.
    bend : float
        Bend in (0, pi] [rad].
    section : int
        Section whose tendons pull; 1 is the tip section.
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
        e = p[:3]
        bend = p[3]
        t = view.base_frame[:, 0]
        tip = (view.tip - view.base_position) / view.arm.length
        tangent = view.tip_frame[:, 0]
        along = ca.dot(tangent, t)
        across = ca.dot(tangent, e)
        # An angle has a jump half a turn from its reference direction. With the reference at half
        # the bend, the jump is away from the straight arm even for a bend of half a turn, and an
        # arm that cannot bend so far bends towards e, not away from e.
        sine = across * ca.cos(bend / 2) - along * ca.sin(bend / 2)
        cosine = across * ca.sin(bend / 2) + along * ca.cos(bend / 2)
        return Terms(
            equality={
                "bending plane": ca.dot(tip, ca.cross(t, e)),
                "bend": ca.atan2(sine, cosine) - bend / 2,
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
