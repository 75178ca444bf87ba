"""Target: wrap a part of the arm around an obstacle."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.centreline import Centreline
from octoplan.model.extensions.clearance.farthest import largest_excess, maxima
from octoplan.model.extensions.obstacles import HalfSpace
from octoplan.model.extensions.obstacles.base import SIZE, Convex, signed_distance
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.support.errors import InputError
from octoplan.model.support.units import length_text
from octoplan.model.support.value import ArcLength, Length, Positive, value
from octoplan.planner.extensions.contact.remarks import curvature_remark
from octoplan.planner.limits import TendonLimits
from octoplan.planner.targets.base import OVER_WANTED, Target, Terms, View

NEAR = "nearness along the obstacle"
CLEAR = "gap to the obstacle"
TURNS = f"turns{OVER_WANTED}"
# Number of uniformly spaced arc lengths at which programs constrain the part, including both ends.
PLACES = 17
# Accuracy of the certified bound of the gap, over the accuracy of targets.
_CLOSE = 0.1
# Allowed violation of the gap between stations, over the accuracy of targets.
_ALLOWED = 0.5
# Constant that keeps the angle between equal normals differentiable.
_TINY = 1e-24


@value
class Wrap(Target):
    """A part of the arm along an obstacle, with a given contact length or number of turns.

    A part lies along an obstacle if the gap between the surfaces is between 0 and `tolerance`
    times the radius of the arm. The gap at s is the distance of the midline minus the radius at
    rest. A plan constrains 17 uniformly spaced arc lengths, and adds more if the gap is too
    large in between, until the largest gap is within the tolerance. The certificate bounds the
    largest gap. The part need not press on the obstacle everywhere: a tapered arm on a cylinder
    touches at points, with low arches in between, because uniform curvature would require
    pressure that pulls. A length may lie along the axis of a rod as well as around it; turns go
    around.

    A wrap of least effort only touches. More tension presses the arm on the object. The answer of
    the study `grip` in studies/README.md relates grip and stiffness to the ratio of the curvatures
    of object and arm.

    The part ends at the tip unless `start` is given. The number of turns is the angle by which the
    obstacle's outward normal rotates along the part, over 2 pi; for a cylinder, the angle around
    the axis. The plan determines the length of a part with turns.

    The arm does not penetrate the obstacle. It presses on the obstacle only if the scene contains
    the obstacle as Contact and no other shape satisfies the target. A neo-Hookean body swells if it
    is shortened, so that the actual gap is smaller. With extension, tendons may shorten the part, a
    slender tip to a few hundredths of its length (see `p.shape.strains`); a neo-Hookean body
    resists this.

    Attributes
    ----------
    obstacle : Convex
        Such as a Sphere, Capsule, Box or HalfSpace.
    turns : float
        Smallest number of turns, above 0; alternative to a length.
    length : float
        Length of the part, in arc length of the arm at rest [m].
    start : float
        Arc length of the part's base end [m]. A part with turns ends at the tip in any case.
    tolerance : float
        Largest gap over the arm's radius.
    places : tuple of float
        Additional arc lengths at which a plan constrains the part [m]; determined by the plan.
    """

    plan_strategy = "contact"

    obstacle: Convex
    turns: Positive | None = None
    length: Length | None = None
    start: ArcLength | None = None
    tolerance: Positive = 0.25
    places: tuple[ArcLength, ...] = ()

    def __post_init__(self) -> None:
        if (self.turns is None) == (self.length is None):
            argument = "neither" if self.turns is None else "both"
            raise InputError("Wrap", argument, "turns, or the length of the part in m")
        if self.turns is not None and isinstance(self.obstacle, HalfSpace):
            raise InputError("Wrap.turns", self.turns, "a length: there are no turns round a plane")

    @property
    def is_open(self) -> bool:
        """Whether the base end of the part is unknown."""
        return self.turns is not None and self.start is None

    def part(self, arm: Arm) -> tuple[float, float]:
        """Return the ends of the part [m]; with turns and no `start`, an initial guess."""
        if self.length is None:
            return (self._guess(arm) if self.start is None else self.start), arm.length
        if self.start is None:
            return arm.length - self.length, arm.length
        return self.start, self.start + self.length

    def _guess(self, arm: Arm) -> float:
        """Return a guess of the part's base end for a number of turns, for the arm at rest.

        The obstacle is approximated by a cylinder with the smallest width.
        """
        assert self.turns is not None
        s = np.linspace(0.0, arm.length, 201)
        radius = self._half_width + arm.outer_radius(s)[0]
        angle = np.append(0.0, np.cumsum((1 / radius[1:] + 1 / radius[:-1]) / 2 * np.diff(s)))
        return float(np.interp(angle[-1] - 2 * np.pi * self.turns, angle, s))

    @property
    def _half_width(self) -> float:
        """Half the obstacle's smallest width [m]."""
        parameters = self.obstacle.parameters
        return float(np.sort(parameters[12:15])[1] + parameters[15])

    def check(self, arm: Arm) -> None:
        """See Target.check."""
        L = arm.length
        if self.start is not None and self.start >= L:
            raise InputError("Wrap.start", self.start, f"below the arm's length, {length_text(L)}")
        start, end = self.part(arm)
        if start < 0 or end > L * (1 + 1e-12):
            allowed = f"a part of the arm, which is {length_text(L)} long"
            raise InputError("Wrap.length", self.length, allowed)
        if self.turns is not None and self.start is None and start <= 0:
            most = L / (
                2 * np.pi * (self._half_width + float(arm.outer_radius(np.array([L]))[0][0]))
            )
            allowed = f"fewer: all of the arm goes {most:.3g} times round the obstacle at most"
            raise InputError("Wrap.turns", self.turns, allowed)
        distance = float(self.obstacle.distance(np.array(arm.base_position)))
        near = (1 + self.tolerance) * float(arm.outer_radius(np.array([start]))[0][0])
        if self.length is not None and distance - near > start:
            allowed = f"an obstacle within reach: it is {1e3 * distance:.4g} mm from the base, "
            allowed += f"and the part begins at {1e3 * start:.4g} mm"
            raise InputError("Wrap.obstacle", self.obstacle, allowed)
        if distance > L:
            allowed = f"an obstacle within reach: it is {1e3 * distance:.4g} mm from the base"
            raise InputError("Wrap.obstacle", self.obstacle, allowed)

    def stations(self, arm: Arm) -> tuple[float, ...]:
        """See Target.stations."""
        start, end = self.part(arm)
        end = min(end, arm.length)
        inside = [s for s in self.places if start < s < end]
        places = np.union1d(np.linspace(start, end, PLACES), inside)
        return tuple(places[places > 0].tolist())

    def least_along(self, line: Callable[[], Centreline], accuracy: float) -> Mapping[str, float]:
        """See Target.least_along: the bound of the gap."""
        midline = line()
        length = midline.arm.length
        part = self.part(midline.arm)
        factor = 1 + self.tolerance
        close = _CLOSE * accuracy * length
        return {NEAR: -largest_excess(midline, self.obstacle, factor, part, close) / length}

    def refined_along(self, line: Callable[[], Centreline], accuracy: float) -> Wrap:
        """See Target.refined_along: local maxima of the gap replace stations nearby."""
        midline = line()
        arm = midline.arm
        start, end = self.part(arm)
        found, excess = maxima(midline, self.obstacle, 1 + self.tolerance, (start, end))
        found = found[excess > _ALLOWED * accuracy * arm.length]
        even = np.linspace(start, end, PLACES)
        apart = (end - start) / (PLACES - 1) / 4
        known = np.array(self.places)
        far = np.abs(known[:, None] - found).min(axis=1, initial=np.inf) > apart
        news = found[np.abs(found[:, None] - even).min(axis=1) > _ALLOWED * accuracy * arm.length]
        if not news.size:
            return self
        return replace(self, places=tuple(np.sort(np.append(known[far], news)).tolist()))

    def remark(self, shape: Shape, limits: TendonLimits, missed: bool, accuracy: float) -> str:
        """See Target.remark: the curvatures of a wrap that was missed."""
        return curvature_remark(self, shape, limits) if missed else ""

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: the obstacle's parameters, tolerance, turns, radii at stations."""
        radii = arm.outer_radius(np.array(self.stations(arm)))[0]
        return np.concatenate(
            [self.obstacle.parameters, [self.tolerance, self.turns or 1.0], radii]
        )

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms."""
        stations = self.stations(view.arm)
        body = p[:SIZE]
        rows = [signed_distance()(view.position(s), body) for s in stations]
        radii = p[SIZE + 2 :]
        gap = ca.vertcat(*(distance for distance, _ in rows)) - radii
        L = view.arm.length
        inequality = {NEAR: (p[SIZE] * radii - gap) / L, CLEAR: gap / L}
        if self.turns is not None:
            normals = [normal for _, normal in rows]
            angle = sum((_angle(*pair) for pair in pairwise(normals)), ca.MX(0))
            inequality[TURNS] = angle / (2 * np.pi * p[SIZE + 1]) - 1
        return Terms(inequality=inequality, units={NEAR: "L", CLEAR: "L"})


def _angle(a: ca.MX, b: ca.MX) -> ca.MX:
    """Return the angle between two unit vectors (3,) [rad]."""
    half = ca.sqrt(ca.sumsqr(a - b) + _TINY) / 2
    return 2 * ca.asin(ca.fmin(half, 1))
