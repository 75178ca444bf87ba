"""Lie along an obstacle: wrap a part of the arm round it."""

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
from octoplan.model.support.errors import InputError
from octoplan.model.support.quantities import ArcLength, Length, Positive
from octoplan.model.support.units import length_text
from octoplan.model.support.value import value
from octoplan.planner.targets.base import OVER_WANTED, Target, Terms, View

NEAR, CLEAR, TURNS = "nearness along the obstacle", "gap to the obstacle", f"turns{OVER_WANTED}"
# Even places at which programs constrain the part, its ends among them.
PLACES = 17
# Parts of the accuracy: of the bound that verifies the nearness all along, and what the nearness
# may be exceeded by between places.
_CLOSE, _ALLOWED = 0.1, 0.5
# Keeps the angle between two normals that are the same differentiable.
_TINY = 1e-24


@value
class Wrap(Target):
    """A part of the arm along an obstacle, for a contact length or so many turns round it.

    A part lies along an obstacle where the gap between surfaces is from 0 to `tolerance` times the
    arm's radius there; the gap at s is the distance of the midline minus the radius at rest. A
    plan constrains 17 even places, and adds places where the gap is too large in between, until
    the largest gap all along is within the tolerance; the certificate has a bound of that gap.
    Pressed contact all along is not asked for: a tapered arm on a cylinder touches at points with
    low arches in between, as its even curvature would take pressure that pulls. A length may lie
    along the axis of a rod as well as across it, turns go round.

    The part ends at the tip, unless `start` says where it begins. Turns are by how much the
    obstacle's outward normal rotates along the part, over 2 pi: of a cylinder the angle round its
    axis. The part is as long as they take then, found by the plan.

    The arm is kept clear of the obstacle and lies beside it; it leans on it where it cannot lie
    along otherwise, if the scene has it as Contact. A neo-Hookean body swells where it is
    shortened, and is nearer than told. With extension tendons may shorten the part to lay it along,
    at a slender tip to a few hundredths of its length: `p.shape.strains` tells; a neo-Hookean body
    resists.

    Attributes
    ----------
    obstacle : Convex
        Such as a Sphere, Capsule, Box or HalfSpace.
    turns : float
        At least so many, above 0; or else a length.
    length : float
        Of the part, arc length of the arm at rest [m].
    start : float
        Arc length at which the part begins [m]. With turns it ends at the tip all the same.
    tolerance : float
        Gap over the arm's radius.
    places : tuple of float
        Further arc lengths at which a plan constrains the part [m]; a plan finds them.
    """

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
        """Whether a plan has to find where the part begins."""
        return self.turns is not None and self.start is None

    def part(self, arm: Arm) -> tuple[float, float]:
        """Return where the part begins and ends [m]; with turns of unknown length, a guess."""
        if self.length is None:
            return (self._guess(arm) if self.start is None else self.start), arm.length
        if self.start is None:
            return arm.length - self.length, arm.length
        return self.start, self.start + self.length

    def _guess(self, arm: Arm) -> float:
        """Return about where a part begins that goes so often round, of the arm as it is at rest.

        Round a cylinder as wide as the obstacle is at its narrowest.
        """
        assert self.turns is not None
        s = np.linspace(0.0, arm.length, 201)
        round_ = self._half_width + arm.outer_radius(s)[0]
        angle = np.append(0.0, np.cumsum((1 / round_[1:] + 1 / round_[:-1]) / 2 * np.diff(s)))
        return float(np.interp(angle[-1] - 2 * np.pi * self.turns, angle, s))

    @property
    def _half_width(self) -> float:
        """Half the obstacle's narrowest width [m]."""
        numbers = self.obstacle.numbers
        return float(np.sort(numbers[12:15])[1] + numbers[15])

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
        """See Target.least_along: of the nearness."""
        midline = line()
        length = midline.arm.length
        part, factor = self.part(midline.arm), 1 + self.tolerance
        close = _CLOSE * accuracy * length
        return {NEAR: -largest_excess(midline, self.obstacle, factor, part, close) / length}

    def refined_along(self, line: Callable[[], Centreline], accuracy: float) -> Wrap:
        """See Target.refined_along: places of local maxima take the place of places nearby."""
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

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: the obstacle's numbers, tolerance, turns, radii at stations."""
        radii = arm.outer_radius(np.array(self.stations(arm)))[0]
        return np.concatenate([self.obstacle.numbers, [self.tolerance, self.turns or 1.0], radii])

    def terms(self, view: View, p: ca.MX) -> Terms:
        """See Target.terms."""
        stations, body = self.stations(view.arm), p[:SIZE]
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
