"""Target: the octopus's fetch, with a proximal, a medial and a distal bend."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, NamedTuple

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.support.errors import Described, InputError
from octoplan.model.support.text import counted
from octoplan.model.support.units import ANGLE, warn_unusual
from octoplan.model.support.value import Angle, Place, unit, value
from octoplan.planner.targets.base import Target, Terms, View, check_near, toward


class Bend(NamedTuple):
    """One bend: its angle in [0, pi] and the angle of its plane as in figure 10 [rad]."""

    angle: Annotated[float, unit("deg", ge=0, le=np.pi)]
    plane: Angle


def stretches(arm: Arm) -> tuple[float, float, float, float]:
    """Return the ends of the proximal, medial and distal stretch, from base to tip [m].

    The ends are anchorages. An arm with more than three anchorages is divided at the ones that
    distribute the sections most evenly. Raises InputError for an arm with fewer than three.
    """
    n = len(arm.sections)
    if n < 3:
        raise InputError("arm.sections", Described(counted(n, "section")), ">= 3 for a fetch")
    first = round(2 * n / 3)
    second = round(n / 3)
    return 0.0, arm.sections[first].at, arm.sections[second].at, arm.sections[0].at


@value
class Fetch(Target):
    """Three prescribed bends; `Fetch.reach(...)` is the variant that brings the tip to a mouth.

    Each bend is relative to the frame at the base end of its stretch: the tangent at the other end
    is cos(angle) t + sin(angle) (cos(plane) b - sin(plane) n). The stretches end at anchorages. A
    bend prescribes the end tangents only: between them a stretch may wind up, a slender tip more
    than once, if this takes less effort and the limits allow it.

    Attributes
    ----------
    proximal, medial, distal : (angle, plane)
        [rad].
    """

    proximal: Annotated[Bend, unit("deg")]
    medial: Annotated[Bend, unit("deg")]
    distal: Annotated[Bend, unit("deg")]

    def __post_init__(self) -> None:
        for name in ("proximal", "medial", "distal"):
            warn_unusual(f"Fetch.{name} plane", [getattr(self, name).plane], ANGLE)

    @staticmethod
    def reach(
        mouth: tuple[float, ...], bend: float = np.radians(30), plane: float | None = None
    ) -> FetchReach:
        """Return the target that brings the tip close to a mouth; see FetchReach."""
        return FetchReach(mouth, bend, plane)

    def check(self, arm: Arm) -> None:
        """See Target.check."""
        stretches(arm)

    def stations(self, arm: Arm) -> tuple[float, ...]:
        """See Target.stations."""
        return stretches(arm)[1:]

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: angle and plane of each bend, base to tip."""
        return np.ravel([self.proximal, self.medial, self.distal])

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms: two components of each tangent, perpendicular to the wanted one."""
        equality = {}
        inequality = {}
        for i, (name, (start, end)) in enumerate(
            zip(("proximal", "medial", "distal"), pairwise(stretches(view.arm)), strict=True)
        ):
            tangent = view.frame(start).T @ view.frame(end)[:, 0]
            cos = ca.cos(p[2 * i])
            sin = ca.sin(p[2 * i])
            b = ca.cos(p[2 * i + 1])
            n = -ca.sin(p[2 * i + 1])
            bend = ca.dot(tangent, ca.vertcat(-sin, cos * n, cos * b))
            plane = ca.dot(tangent, ca.vertcat(0, -b, n))
            equality[f"{name} bend"] = ca.vertcat(bend, plane)
            inequality[f"side of the {name} bend"] = ca.dot(
                tangent, ca.vertcat(cos, sin * n, sin * b)
            )
        return Terms(equality=equality, inequality=inequality, units=dict.fromkeys(equality, "rad"))

    def prescribed(self, arm: Arm) -> Mapping[str, Array]:
        """See Target.prescribed."""
        return {"three bends": self.parameters(arm)}

    def describe_miss(self, name: str, shape: Shape) -> str:
        """See Target.describe_miss: the angle between a tangent and the wanted one."""
        for i, bend in enumerate(("proximal", "medial", "distal")):
            if name == f"{bend} bend":
                start, end = stretches(shape.arm)[i : i + 2]
                angle, plane = getattr(self, bend)
                tangent = shape.frame(start).T @ shape.frame(end)[:, 0]
                sin = np.sin(angle)
                wanted = [np.cos(angle), -sin * np.sin(plane), sin * np.cos(plane)]
                off = np.arctan2(np.linalg.norm(np.cross(tangent, wanted)), tangent @ wanted)
                return f"the {name} by {np.degrees(off):.3g} deg"
        return ""


@value
class FetchReach(Target):
    """Bring the tip as close to a mouth as the limits allow, with three bends.

    Attributes
    ----------
    mouth : (3,)
        In the base frame [m].
    bend : float
        Smallest angle between the tangents at the two ends of each stretch, in [0, pi) [rad].
    plane : float or None
        Angle of the plane that contains every anchorage, as in figure 10 [rad]; no plane if
        None.
    """

    mouth: Place
    bend: Annotated[float, unit("deg", ge=0, lt=np.pi)] = float(np.radians(30))
    plane: Angle | None = None

    def __post_init__(self) -> None:
        if self.plane is not None:
            warn_unusual("FetchReach.plane", [self.plane], ANGLE)

    def check(self, arm: Arm) -> None:
        """See Target.check."""
        stretches(arm)
        check_near(arm, "FetchReach.mouth", self.mouth)

    def stations(self, arm: Arm) -> tuple[float, ...]:
        """See Target.stations."""
        return tuple(sorted({*stretches(arm)[1:], arm.length}))

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: mouth, cosine of the smallest bend, normal of the plane."""
        e = toward(arm, self.plane or 0.0)
        across = np.cross(np.array(arm.base_frame)[:, 0], e)
        return np.concatenate([self.mouth, [np.cos(self.bend)], across])

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms."""
        ends = stretches(view.arm)
        tangents = [view.frame(s)[:, 0] for s in ends]
        bends = [p[3] - ca.dot(a, b) for a, b in pairwise(tangents)]
        equality = {}
        if self.plane is not None:
            off = [ca.dot(view.position(s) - view.base_position, p[4:]) for s in ends[1:]]
            equality["distance from the plane"] = ca.vertcat(*off) / view.arm.length
        return Terms(
            equality=equality,
            soft_residual={"distance to the mouth": (view.tip - p[:3]) / view.arm.length},
            inequality={"least bend": ca.vertcat(*bends)},
            high_priority=frozenset(equality),
            units={"distance from the plane": "L", "distance to the mouth": "L"},
        )

    def describe_miss(self, name: str, shape: Shape) -> str:
        """See Target.describe_miss: the smallest of the three bends."""
        if name != "least bend":
            return ""
        tangents = [shape.frame(s)[:, 0] for s in stretches(shape.arm)]
        least = min(np.arccos(np.clip(a @ b, -1.0, 1.0)) for a, b in pairwise(tangents))
        return (
            f"the least bend by {np.degrees(self.bend - least):.3g} deg "
            f"({np.degrees(least):.3g} deg found)"
        )
