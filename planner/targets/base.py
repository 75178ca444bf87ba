"""What a target is: a small value that states residuals of a shape and knows no solver."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.centreline import Centreline
from octoplan.model.paths import Array
from octoplan.model.rotations import conjugate, matrix, multiply
from octoplan.model.stiffness import Hold
from octoplan.model.support.errors import InputError
from octoplan.model.support.machine.functions import cached
from octoplan.model.support.units import DISTANCE, warn_unusual

# How the name of an inequality ends that is a share of what is wanted.
OVER_WANTED = " over that wanted, less 1"
# Arm lengths.
_FAR = 1e6


@dataclass(frozen=True)
class Terms:
    """What a target asks of a shape; lengths are in units of L, angles in rad.

    Attributes
    ----------
    equality : residuals that have to be 0, by name
    soft_residual : residuals to be made as small as the limits allow, by name
    inequality : quantities that have to be 0 or above, by name
    objective : numbers whose sum is made least, by name, instead of effort
    high_priority : names of equalities that come first where not all can be had
    low_priority : names of inequalities and reciprocals that come last
    reciprocal : quantities x whose reciprocal has to be 1 or above, by name: a compliance over the
        largest allowed one. Certificates have 1 / x - 1 among the inequalities; programs have
        1 - x, which is smooth where x passes through 0
    weights : by name, of the squares of equalities where not all can be had; 1 unless given
    units : by name, "L" of what is a length over the arm's, "rad" of angles; others have none
    """

    equality: Mapping[str, ca.MX] = field(default_factory=dict)
    soft_residual: Mapping[str, ca.MX] = field(default_factory=dict)
    inequality: Mapping[str, ca.MX] = field(default_factory=dict)
    objective: Mapping[str, ca.MX] = field(default_factory=dict)
    high_priority: frozenset[str] = frozenset()
    low_priority: frozenset[str] = frozenset()
    reciprocal: Mapping[str, ca.MX] = field(default_factory=dict)
    weights: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ComplianceRequest:
    """A compliance of the tip that a target is stated with.

    Attributes
    ----------
    hold : "tension" or "length"
        What holds the tendons.
    width : int
        Along how many directions at once; see Target.directions.
    tendon_EA : float or None
        Stiffness E A of tendons whose lengths are held [N]; see octoplan.model.stiffness.
    """

    hold: Hold
    width: int
    tendon_EA: float | None = None


class View:
    """The poses of a shape at the stations that a target asked for, and its tip's compliance.

    Attributes
    ----------
    compliance : (width, width)
        D^T C D [m/N] with the compliance C (3, 3) of octoplan.model.stiffness against forces on the
        tip, and the target's directions D (3, width); only there for a target with a request.
    """

    def __init__(
        self, arm: Arm, poses: Mapping[float, ca.MX], compliance: ca.MX | None = None
    ) -> None:
        self.arm = arm
        self._poses = poses
        self._compliance = compliance

    @cached_property
    def base_frame(self) -> ca.MX:
        """Frame of the base (3, 3), columns t, n, b."""
        return ca.MX(ca.DM(np.array(self.arm.base_frame)))

    @cached_property
    def base_position(self) -> ca.MX:
        """Position of the base (3,) [m]."""
        return ca.MX(ca.DM(np.array(self.arm.base_position)))

    def position(self, s: float) -> ca.MX:
        """Return the position (3,) at station s [m]."""
        return self._poses[s][4:7] if s > 0 else self.base_position

    def frame(self, s: float) -> ca.MX:
        """Return the frame (3, 3), columns t, n, b, at station s."""
        return cached(_frame)(self._poses[s][:4]) if s > 0 else self.base_frame

    def rotation_from(self, s: float, wanted: ca.MX) -> ca.MX:
        """Return 2 sin(a / 2) u (3,): rotation by a about u [rad] from a frame to that at s.

        The frame is given by its quaternion (4,); u has components along its columns. Smooth
        everywhere, of norm 2 at a = pi, and 0 where the frames are the same alone.
        """
        return cached(_rotation)(self._poses[s][:4], wanted)

    @property
    def compliance(self) -> ca.MX:
        """The tip's compliance along the target's directions."""
        assert self._compliance is not None
        return self._compliance

    @property
    def tip(self) -> ca.MX:
        """Position of the tip (3,) [m]."""
        return self.position(self.arm.length)

    @property
    def tip_frame(self) -> ca.MX:
        """Frame of the tip (3, 3)."""
        return self.frame(self.arm.length)


def _frame() -> ca.Function:
    q = ca.SX.sym("q", 4)
    return ca.Function("frame", [q], [matrix(q)])


def _rotation() -> ca.Function:
    q, wanted = ca.SX.sym("q", 4), ca.SX.sym("wanted", 4)
    relative = multiply(conjugate(wanted), q) / ca.sqrt(ca.sumsqr(q))
    return ca.Function("rotation", [q, wanted], [2 * relative[1:]])


class Target:
    """A wanted shape; the base class of all targets asks for nothing.

    Numbers from `parameters` enter the program as parameters: targets whose expressions are equal
    share one program. Other attributes may be used in `terms` too: they are constants of the
    program, and each value of them needs a program of its own, which takes longer to build.
    """

    def check(self, arm: Arm) -> None:
        """Raise InputError if the target is not one that this arm can be asked for."""

    def stations(self, arm: Arm) -> tuple[float, ...]:
        """Return the arc lengths at which the target looks at the shape [m]: the tip's."""
        return (arm.length,)

    def parameters(self, arm: Arm) -> Array:
        """Return the target's numbers (n,)."""
        return np.zeros(0)

    def terms(self, view: View, p: ca.MX) -> Terms:
        """Return the residuals of the shape in view, with the numbers p (n,)."""
        return Terms()

    def least_along(self, line: Callable[[], Centreline], accuracy: float) -> Mapping[str, float]:
        """Return lower bounds of inequalities that hold all along a part of the arm, by name.

        Of a settled midline, to a fraction of the accuracy. Stations only sample them.
        """
        return {}

    def refined_along(self, line: Callable[[], Centreline], accuracy: float) -> Self:
        """Return the target with stations where a settled midline violates it between stations.

        By more than a part of the accuracy; itself if there are none.
        """
        return self

    def tendons(self, arm: Arm) -> frozenset[int]:
        """Return the tendons that may pull."""
        return frozenset(range(arm.n_tendons))

    def prescribed(self, arm: Arm) -> Mapping[str, Array]:
        """Return the quantities that the target fixes, by name; two targets have to agree."""
        return {}

    def compliance_request(self) -> ComplianceRequest | None:
        """Return the compliance of the tip that it is stated with, if it is."""
        return None

    def directions(self, p: ca.MX) -> ca.MX:
        """Return the directions (3, width) of its request, base frame, from its numbers p."""
        return ca.MX(3, 0)


def check_near(arm: Arm, field: str, points: Any) -> None:
    """Raise InputError if points (..., 3) are so far off that no digit tells shapes apart."""
    distance = np.abs(np.asarray(points) / arm.length - np.array(arm.base_position) / arm.length)
    if not distance.max() <= _FAR:
        raise InputError(field, points, f"within {_FAR:g} arm lengths of the base, in m")
    warn_unusual(field, [float(np.linalg.norm(distance, axis=-1).max())], DISTANCE)


def toward(arm: Arm, angle: float) -> Array:
    """Return the direction cos(angle) b - sin(angle) n of the base frame (3,), as in figure 10."""
    frame = np.array(arm.base_frame)
    return np.asarray(np.cos(angle) * frame[:, 2] - np.sin(angle) * frame[:, 1])
