"""Interface of targets: small values that define residuals of a shape, independent of solvers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.rotations import conjugate, matrix, multiply
from octoplan.model.shape import Shape
from octoplan.model.support.checks import is_several
from octoplan.model.support.errors import InputError
from octoplan.model.support.machine.functions import cached
from octoplan.model.support.units import DISTANCE, warn_unusual
from octoplan.planner.limits import TendonLimits

if TYPE_CHECKING:
    from octoplan.model.centreline import Centreline
    from octoplan.model.stiffness import Hold

# End of the name of an inequality that is relative to the wanted value.
OVER_WANTED = " over that wanted, less 1"
# Distance from the base, in arm lengths, beyond which rounding errors hide differences of shapes.
_FAR = 1e6


@dataclass(frozen=True)
class Terms:
    """Terms of a target in a program; lengths in units of the arm length L, angles in rad.

    Attributes
    ----------
    equality : residuals that must be 0, by name
    soft_residual : residuals whose squares are minimised within the limits, by name
    inequality : quantities that must be nonnegative, by name
    objective : terms of the objective instead of the effort, by name
    high_priority : names of equalities that take precedence if the target cannot be met
    low_priority : names of inequalities and reciprocals with the lowest precedence
    reciprocal : quantities x whose reciprocal must be at least 1, by name, such as a compliance
        over the largest allowed one. Certificates use the inequality 1 / x - 1 >= 0; programs use
        1 - x >= 0, which is smooth if x passes through 0
    weights : weights of squared equalities if the target cannot be met, by name; 1 unless given
    units : by name, "L" for lengths over the arm length, "rad" for angles; otherwise none
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
    """Compliance of the tip that the terms of a target use.

    Attributes
    ----------
    hold : "tension" or "length"
        Quantity of the tendons that is held constant.
    width : int
        Number of directions; see Target.directions.
    tendon_EA : float or None
        Axial stiffness E A of tendons with constant lengths [N]; see octoplan.model.stiffness.
    """

    hold: Hold
    width: int
    tendon_EA: float | None = None


class View:
    """Poses of a shape at the stations of a target, and the compliance of the tip.

    Attributes
    ----------
    compliance : (width, width)
        D^T C D [m/N] with the compliance C (3, 3) of octoplan.model.stiffness for forces on the
        tip, and the target's directions D (3, width); only for targets with a ComplianceRequest.
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
        return self._pose(s)[4:7] if s > 0 else self.base_position

    def frame(self, s: float) -> ca.MX:
        """Return the frame (3, 3), columns t, n, b, at station s."""
        return cached(_frame)(self._pose(s)[:4]) if s > 0 else self.base_frame

    def rotation_from(self, s: float, wanted: ca.MX) -> ca.MX:
        """Return 2 sin(a / 2) u (3,) for the rotation by a about u [rad] from a wanted frame.

        The wanted frame is a quaternion (4,), and u has components along its columns. The result is
        smooth, has norm 2 at a = pi, and is 0 only if the frames are equal.
        """
        return cached(_rotation)(self._pose(s)[:4], wanted)

    def _pose(self, s: float) -> ca.MX:
        if s not in self._poses:
            stations = ", ".join(f"{each:.9g}" for each in self._poses)
            raise InputError("s", s, f"one of the stations of the targets, {stations} m")
        return self._poses[s]

    @property
    def compliance(self) -> ca.MX:
        """The compliance of the tip along the target's directions."""
        if self._compliance is None:
            allowed = "used by targets with a compliance_request only"
            raise InputError("View.compliance", None, allowed)
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
    q = ca.SX.sym("q", 4)
    wanted = ca.SX.sym("wanted", 4)
    relative = multiply(conjugate(wanted), q) / ca.sqrt(ca.sumsqr(q))
    return ca.Function("rotation", [q, wanted], [2 * relative[1:]])


class Target:
    """A requirement on the shape; the base class requires nothing.

    Values from `parameters` are parameters of the program, so that targets with equal expressions
    share one program. `terms` may use other attributes too. Such attributes are constants of the
    program; each new value requires another program, which takes longer to build.
    """

    # Name of the strategy that plans the target; see octoplan.planner.entry_points.
    plan_strategy = ""
    # Verb with which the outcome begins if the target is met.
    success = "Reached"
    # Unit of the inverse of the target's compliance, for the outcome of a plan.
    stiffness_unit = "N/m"

    def check(self, arm: Arm) -> None:
        """Raise InputError if the target is unsuitable for the arm."""

    def stations(self, arm: Arm) -> tuple[float, ...]:
        """Return the arc lengths at which `terms` uses poses [m]; the tip by default."""
        return (arm.length,)

    def parameters(self, arm: Arm) -> Array:
        """Return the target's parameters (n,)."""
        return np.zeros(0)

    def terms(self, view: View, p: ca.MX) -> Terms:
        """Return the residuals of a shape, with the parameters p (n,)."""
        return Terms()

    def least_along(self, line: Callable[[], Centreline], accuracy: float) -> Mapping[str, float]:
        """Return lower bounds of inequalities that must be satisfied along a part of the arm.

        Stations only sample these inequalities. The bounds, by name, are for a settled midline, and
        exact to a fraction of the accuracy.
        """
        return {}

    def refined_along(self, line: Callable[[], Centreline], accuracy: float) -> Self:
        """Return the target with more stations if a midline violates it between stations.

        Violations below a fraction of the accuracy do not count; without others, return the target
        itself.
        """
        return self

    def equilibrium_residuals(self, shape: Shape) -> Mapping[str, Array]:
        """Return residuals that depend on the forces of a settled shape, by name.

        Certificates add these residuals to the equalities of `terms`.
        """
        return {}

    def describe_miss(self, name: str, shape: Shape) -> str:
        """Return by how much a shape misses a residual of `terms`, for the outcome of a plan.

        An empty text stands for the name and the number in its unit.
        """
        return ""

    def remark(self, shape: Shape, limits: TendonLimits, missed: bool, accuracy: float) -> str:
        """Return a sentence for the outcome of a plan; empty for none.

        Parameters
        ----------
        shape : Shape
            The shape of the plan.
        limits : TendonLimits
        missed : bool
            Whether a completed search missed the targets.
        accuracy : float
            The accuracy of the plan.
        """
        return ""

    def tendons(self, arm: Arm) -> frozenset[int]:
        """Return the indices of the tendons that may pull."""
        return frozenset(range(arm.n_tendons))

    def prescribed(self, arm: Arm) -> Mapping[str, Array]:
        """Return quantities that the target prescribes, by name; combined targets must agree."""
        return {}

    def compliance_request(self) -> ComplianceRequest | None:
        """Return the compliance of the tip that `terms` uses, if any."""
        return None

    def directions(self, p: ca.MX) -> ca.MX:
        """Return the directions (3, width) of the compliance request from the parameters p."""
        return ca.MX(3, 0)


def as_targets(target: Any) -> tuple[Any, ...]:
    """Return one or several targets as a tuple, other objects as its only item."""
    has_several = is_several(target) or isinstance(target, Iterator)
    return tuple(target) if has_several else (target,)


def check_near(arm: Arm, field: str, points: Any) -> None:
    """Raise InputError if points (..., 3) are too far from the base for double precision."""
    distance = np.abs(np.asarray(points) / arm.length - np.array(arm.base_position) / arm.length)
    if not distance.max() <= _FAR:
        raise InputError(field, points, f"within {_FAR:g} arm lengths of the base, in m")
    warn_unusual(field, [float(np.linalg.norm(distance, axis=-1).max())], DISTANCE)


def toward(arm: Arm, angle: float) -> Array:
    """Return the direction cos(angle) b - sin(angle) n of the base frame (3,), as in figure 10."""
    frame = np.array(arm.base_frame)
    return np.asarray(np.cos(angle) * frame[:, 2] - np.sin(angle) * frame[:, 1])
