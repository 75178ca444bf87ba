"""Base joints: their limits and rates, and the weight of their motion in the effort."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta
from scipy.spatial.transform import Rotation

from octoplan.model.arm import Arm
from octoplan.model.support.errors import Described, InputError
from octoplan.model.support.units import ANGLE, STROKE, length_text, warn_unusual
from octoplan.model.support.value import NotNegative, Positive, unit, value

Pair = Annotated[tuple[float, ...], Meta(min_length=2, max_length=2)]
# Largest insertion over the length of the arm: beyond, digits of the shape are lost [-].
_FARTHEST = 1e3
# Largest weight of the joints [-]. Target rows are violated by up to 1e-12 times their multipliers,
# which grow with the weight; with 1e8 plans miss targets within reach.
_HEAVIEST = 1e4


class BasePosition(NamedTuple):
    """Values of the base joints: insertion [m] and rotation [rad]."""

    insertion: float = 0.0
    rotation: float = 0.0


@value
class BaseJoints:
    """Joints of the base: insertion along its axis, and rotation about its axis.

    Endoscopes and catheters are pushed and turned at the base. Insertion moves the base along its
    tangent t, and rotation turns its n and b about t, from n towards b. Both joint values are 0 at
    `Arm.base_position` and `Arm.base_frame`. Targets, gravity, currents and dead loads stay in
    space; followers and tendons turn with the arm. The arm beyond the base is free: no channel
    guides the part that is not inserted.

    The objective of a plan is the effort of the tensions plus

        weight / 2 [(insertion / L)^2 + (rotation / pi)^2]

    in units of T_1. Each tendon has a tension that alone bends the arm by about 1 rad, and T_1 is
    the largest of these tensions. The effort of the tensions in these units is 1/2 sum_j (T_j /
    T_1)^2, and the sum or the maximum of T_j / T_1 for the norms "1" and "inf". With the weight 1,
    an insertion by the length of the arm, or half a turn, counts as much as a tension that bends
    the arm by 1 rad. `Plan.effort` is the norm of the tensions alone.

    Attributes
    ----------
    insertion : (low, high) or None
        Limits of the insertion [m]; no such joint unless given.
    rotation : (low, high) or None
        Limits of the rotation [rad]; no such joint unless given.
    weight : float
        Weight of the joints in the effort, up to 1e4 [-]. With 0 the joints cost nothing, and plans
        may have several optima. Equal limits keep a joint still.
    insertion_rate : float or None
        Largest rate of the insertion in motions [m/s]; no limit unless given.
    rotation_rate : float or None
        Largest rate of the rotation in motions [rad/s]; no limit unless given.

    Raises
    ------
    InputError
        If both joints are absent, if low exceeds high, if a number is not finite, if the weight is
        negative or above 1e4, or if a rate is not positive or has no joint. `plan` and `trajectory`
        raise it for insertions beyond 1000 times the length of the arm.
    """

    insertion: Annotated[Pair | None, unit("mm")] = None
    rotation: Annotated[Pair | None, unit("deg")] = None
    weight: NotNegative = 1.0
    insertion_rate: Annotated[Positive | None, unit("mm/s")] = None
    rotation_rate: Annotated[Positive | None, unit("deg/s")] = None

    def __post_init__(self) -> None:
        if self.insertion is None and self.rotation is None:
            allowed = "an insertion, a rotation, or both, such as insertion=(0, 0.05)"
            raise InputError("BaseJoints", Described("no joint"), allowed)
        if self.weight > _HEAVIEST:
            allowed = f"a number up to {_HEAVIEST:g}; equal limits keep a joint still"
            raise InputError("BaseJoints.weight", self.weight, allowed)
        for name in ("insertion", "rotation"):
            limits = getattr(self, name)
            rate = f"{name}_rate"
            if limits is not None and limits[0] > limits[1]:
                allowed = f"(low, high) with low <= high, such as {limits[::-1]}"
                raise InputError(f"BaseJoints.{name}", limits, allowed)
            if limits is None and getattr(self, rate) is not None:
                raise InputError(f"BaseJoints.{rate}", getattr(self, rate), f"None without {name}")
        if self.rotation is not None:
            warn_unusual("BaseJoints.rotation", list(self.rotation), ANGLE)

    def check(self, arm: Arm) -> None:
        """Raise InputError for limits that are too far for an arm."""
        if self.insertion is None:
            return
        most = _FARTHEST * arm.length
        farthest = max(map(abs, self.insertion))
        if farthest > most:
            allowed = f"limits within {length_text(most)} of 0"
            raise InputError("BaseJoints.insertion", self.insertion, allowed)
        warn_unusual("BaseJoints.insertion", [farthest / arm.length], STROKE)

    @property
    def limits(self) -> tuple[BasePosition, BasePosition]:
        """The smallest and the largest joint values; 0 for a joint that is absent."""
        both = [(0.0, 0.0) if each is None else each for each in (self.insertion, self.rotation)]
        low, high = zip(*both, strict=True)
        return BasePosition(*low), BasePosition(*high)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the joints that exist."""
        return tuple(name for name in BasePosition._fields if getattr(self, name) is not None)

    @property
    def rates(self) -> tuple[float, float]:
        """The largest rates of insertion [m/s] and rotation [rad/s]; infinite for no limit.

        A joint that is absent does not move; its rate is 1.
        """
        pairs = (self.insertion, self.insertion_rate), (self.rotation, self.rotation_rate)
        one, other = (
            1.0 if limits is None else np.inf if rate is None else rate for limits, rate in pairs
        )
        return one, other

    @property
    def reference(self) -> BasePosition:
        """Joint values for first guesses: near 0, with all directions within half a turn."""
        low, high = self.limits
        insertion = min(max(0.0, low.insertion), high.insertion)
        ends = sorted((low.rotation + np.pi, high.rotation - np.pi))
        rotation = min(max(0.0, ends[0]), ends[1])
        return BasePosition(insertion, min(max(rotation, low.rotation), high.rotation))

    def moved(self, arm: Arm, position: BasePosition) -> Arm:
        """Return an arm with its base moved by joint values."""
        if not any(position):
            return arm
        frame = np.array(arm.base_frame)
        turn = Rotation.from_rotvec([position.rotation, 0.0, 0.0]).as_matrix()
        place = np.array(arm.base_position) + position.insertion * frame[:, 0]
        return replace(
            arm,
            base_frame=tuple(map(tuple, (frame @ turn).tolist())),
            base_position=tuple(place.tolist()),
        )
