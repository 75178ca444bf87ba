"""Target: bend in a given plane, by the tendons of one section."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import casadi as ca
import numpy as np
from msgspec import Meta

from octoplan.model.arm import Arm
from octoplan.model.loads import is_coupled
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.support.units import ANGLE, warn_unusual
from octoplan.model.support.value import Angle, unit, value
from octoplan.planner.limits import TendonLimits
from octoplan.planner.targets.base import Target, Terms, View, toward


@value
class BendingPlane(Target):
    """Bend by an angle in a plane, pulling tendons of one section only.

    The tip lies in the plane of the base tangent and e = cos(angle) b - sin(angle) n of the base
    frame, on the side of e, as in section 6.1 and figure 10 of the paper. The bend is the angle in
    this plane from the tangent at the base to the tangent at the tip. With `at="anchorage"`, the
    anchorage of the section takes the place of the tip: loads also bend the arm beyond this
    anchorage. Without loads the arm is straight there, so that the bends are equal.

    Attributes
    ----------
    angle : float
        Angle of the plane [rad]: 0 degrees for T_i2 alone, 90 for T_i3, 180 for T_i4, -90 for T_i1.
    bend : float
        Bend in (0, pi] [rad].
    section : int
        Section whose tendons pull; 1 is the tip section.
    at : "tip" or "anchorage"
        The point of the arm that plane and bend refer to.
    """

    angle: Angle
    bend: Annotated[float, unit("deg", gt=0, le=np.pi)]
    section: Annotated[int, Meta(ge=1)] = 1
    at: Literal["tip", "anchorage"] = "tip"

    def __post_init__(self) -> None:
        warn_unusual("BendingPlane.angle", [self.angle], ANGLE)

    def check(self, arm: Arm) -> None:
        """See Target.check."""
        arm.tendons_of(self.section)

    def station(self, arm: Arm) -> float:
        """Return the arc length that plane and bend refer to [m]."""
        return arm.length if self.at == "tip" else arm.sections[self.section - 1].at

    def stations(self, arm: Arm) -> tuple[float, ...]:
        """See Target.stations."""
        return (self.station(arm),)

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: e (3,) and the bend."""
        return np.append(toward(arm, self.angle), self.bend)

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms."""
        e = p[:3]
        bend = p[3]
        t = view.base_frame[:, 0]
        s = self.station(view.arm)
        end = (view.position(s) - view.base_position) / view.arm.length
        tangent = view.frame(s)[:, 0]
        along = ca.dot(tangent, t)
        across = ca.dot(tangent, e)
        # An angle has a jump half a turn from its reference direction. With the reference at half
        # the bend, the jump is away from the straight arm even for a bend of half a turn, and an
        # arm that cannot bend so far bends towards e, not away from e.
        sine = across * ca.cos(bend / 2) - along * ca.sin(bend / 2)
        cosine = across * ca.sin(bend / 2) + along * ca.cos(bend / 2)
        return Terms(
            equality={
                "bending plane": ca.dot(end, ca.cross(t, e)),
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
        values = np.array([self.angle, self.bend, self.section])
        return {f"bending plane and bend of the {self.at}": values}

    def describe_miss(self, name: str, shape: Shape) -> str:
        """See Target.describe_miss: angles of plane and bend, and the distance from the plane."""
        s = self.station(shape.arm)
        angle, bend, distance = self.measured(shape, s)
        place = "tip" if self.at == "tip" else f"anchorage of section {self.section}"
        if name == "bend":
            return f"the bend of the {place} by {abs(np.degrees(bend - self.bend)):.3g} deg"
        if name != "bending plane":
            return ""
        turned = np.degrees(np.angle(np.exp(1j * (angle - self.angle))))
        return (
            f"the bending plane of the {place} by {abs(turned):.3g} deg "
            f"({1e3 * abs(distance):.3g} mm from the plane)"
        )

    def measured(self, shape: Shape, s: float) -> tuple[float, float, float]:
        """Return the angle of the plane through s and the bend [rad], and the distance [m].

        The distance is from s to the plane of the target. The bend is in the plane of the target,
        from -pi to pi around it.
        """
        t, n, b = np.array(shape.arm.base_frame).T
        e = toward(shape.arm, self.angle)
        place = shape.position(s) - np.array(shape.arm.base_position)
        tangent = shape.frame(s)[:, 0]
        bend = np.arctan2(tangent @ e, tangent @ t)
        bend = self.bend + np.angle(np.exp(1j * (bend - self.bend)))
        angle = np.arctan2(-place @ n, place @ b)
        return float(angle), float(bend), float(place @ np.cross(t, e))

    def remark(self, shape: Shape, limits: TendonLimits, missed: bool, accuracy: float) -> str:
        """See Target.remark: under loads, the bend of the tip and of the anchorage."""
        arm = shape.arm
        end = arm.sections[self.section - 1].at
        if end == arm.length or not is_coupled(arm, shape.scene):
            return ""
        tip, anchorage = (np.degrees(self.measured(shape, s)[1]) for s in (arm.length, end))
        other = "anchorage" if self.at == "tip" else "tip"
        return (
            f"The target is the bend of the {self.at}: under the loads the tip is bent by "
            f"{tip:.4g} deg, the anchorage of section {self.section} by {anchorage:.4g} deg; pass "
            f'at="{other}" to plan the bend of the {other}.'
        )
