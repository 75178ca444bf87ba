"""Definition of a motion: targets, rate limits, clearance and times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.effects import Weight
from octoplan.model.forward import FINEST_ACCURACY
from octoplan.model.loads import has_complementarity
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.checks import finite_array, flag, kind, positive, whole
from octoplan.model.support.errors import Described, InputError, as_given
from octoplan.model.support.progress import OutOfTime
from octoplan.model.support.text import counted
from octoplan.model.support.units import STROKE, warn_unusual
from octoplan.planner.block import Block, Constraints
from octoplan.planner.entry_points import LOAD_WAYPOINTS, load
from octoplan.planner.extensions.avoidance.lines import Lines
from octoplan.planner.extensions.avoidance.rows import grid
from octoplan.planner.extensions.base_joints.lines import MovingLines
from octoplan.planner.limits import TendonLimits, each_tendon
from octoplan.planner.plan import plan
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import Environment, check_targets
from octoplan.planner.targets import TipPosition
from octoplan.planner.targets.base import Target

if TYPE_CHECKING:
    from octoplan.planner.extensions.base_joints.joints import BaseJoints
    from octoplan.planner.extensions.base_joints.placement import JointPlacement
    from octoplan.planner.extensions.contact.plan import ContactPlan

GRAVITY = float(np.linalg.norm(Weight().g))
# Acceleration of the tip over gravity up to which a motion counts as quasi-static.
QUASI_STATIC = 0.1
# Refinement of the mesh of midlines.
_MESH = 3
# Additional clearance at waypoints, over the arm's length, as a reserve for the path in between.
_SPARE = 1e-3


@dataclass(frozen=True)
class Rates:
    """Limits of the rates of tensions, strokes and tip.

    Attributes
    ----------
    tension : (n_tendons,)
        Rate of each tension [N/s]; inf for no limit.
    stroke : float
        Rate of each stroke [m/s].
    acceleration : float
        Acceleration of each stroke [m/s2].
    tip_acceleration : float
        Acceleration of the tip [m/s2]. Motions with a limit of accelerations stop at each waypoint.
    """

    tension: tuple[float, ...]
    stroke: float = np.inf
    acceleration: float = np.inf
    tip_acceleration: float = np.inf

    @classmethod
    def of(
        cls,
        arm: Arm,
        tension: Any,
        stroke: Any,
        acceleration: Any = None,
        tip: Any = None,
        quasi_static: Any = False,
    ) -> Rates:
        """Return the rate limits of an arm, None for no limit; InputError for unsuitable values."""
        if flag("quasi_static", quasi_static) and tip is not None:
            allowed = "None beside quasi_static=True, which sets it"
            raise InputError("tip_acceleration_max", tip, allowed)
        each = each_tendon(arm, "rate_max", np.inf if tension is None else tension)
        for j in np.flatnonzero(each <= 0):
            is_one = np.ndim(tension) == 0
            field = "rate_max" if is_one else f"rate_max[{j}] ({arm.tendon_name(int(j))})"
            raise InputError(field, float(each[j]), "a number above 0 [N/s]")
        options = {
            "stroke_rate_max": stroke,
            "stroke_acceleration_max": acceleration,
            "tip_acceleration_max": QUASI_STATIC * GRAVITY if quasi_static else tip,
        }
        largest = [
            np.inf if limit is None else positive(key, limit) for key, limit in options.items()
        ]
        warn_unusual("stroke_rate_max", [largest[0] / arm.length], STROKE)
        return cls(tuple(each.tolist()), *largest)

    @property
    def of_places(self) -> Array:
        """Limits of stroke rate [m/s], and of accelerations of strokes and tip [m/s2] (3,)."""
        return np.array([self.stroke, self.acceleration, self.tip_acceleration])

    @property
    def at_rest(self) -> bool:
        """Whether accelerations are limited, so that motions stop at each waypoint."""
        return bool(np.isfinite(self.of_places[1:]).any())

    @property
    def pace(self) -> float:
        """Stroke rate limit in the program over the waypoints [m/s].

        The value is arbitrary if only accelerations are limited, because accelerations then
        determine the durations.
        """
        free = not np.isfinite(self.stroke) and self.at_rest
        return 1.0 if free and not np.all(np.isfinite(self.tension)) else self.stroke


@dataclass(frozen=True, eq=False)
class Waypoint:
    """A waypoint of a motion.

    Attributes
    ----------
    targets : tuple of Target
        Targets at the waypoint, if any.
    tensions : (n_tendons,)
        [N].
    avoidance : Constraints or None
        Clearance inequalities.
    fraction : float
        Fraction of the duration between two targets that the arm takes from the previous waypoint.
    base : tuple of float
        Joint values of the base: insertion [m] and rotation [rad]; empty for a fixed base.
    """

    targets: tuple[Target, ...]
    tensions: Array
    avoidance: Constraints | None = None
    fraction: float = 1.0
    base: tuple[float, ...] = ()

    @property
    def controls(self) -> Array:
        """Tensions (n_tendons,) [N], followed by the joint values of the base if any."""
        return np.append(self.tensions, self.base)

    def blocks(self, arm: Arm) -> tuple[Block, ...]:
        """Return the blocks of its program that keep the arm clear."""
        return self.avoidance.blocks(arm) if self.avoidance else ()


@dataclass(frozen=True, eq=False)
class Question:
    """Definition of a motion.

    Attributes
    ----------
    arm, scene : Arm, Scene
    targets : tuple of tuple of Target
        Targets in order.
    limits : TendonLimits
        Limits of tensions and strokes.
    rates : Rates
        Limits of rates.
    surroundings : Environment
        Obstacles and clearance.
    times : (M,) or None
        Prescribed time of each target [s].
    start : (n_tendons,)
        Initial tensions [N].
    accuracy : float
        Accuracy of targets, over the arm's length.
    machine_code : bool
        Whether to use compiled kernels.
    begin : ContactPlan or None
        With contact, the plan from which the motion starts.
    placement : JointPlacement or None
        Joints that move the base, at their initial values.
    """

    arm: Arm
    scene: Scene
    targets: tuple[tuple[Target, ...], ...]
    limits: TendonLimits
    rates: Rates
    surroundings: Environment
    times: Array | None
    start: Array
    accuracy: float
    machine_code: bool = field(default=False, compare=False)
    begin: ContactPlan | None = field(default=None, compare=False)
    placement: JointPlacement | None = None

    @property
    def start_controls(self) -> Array:
        """Initial tensions (n_tendons,) [N], followed by the joint values of the base if any."""
        return np.append(self.start, self.placement.values if self.placement else ())

    @property
    def control_rates(self) -> Array:
        """Rates of the tensions [N/s], followed by those of the base joints [m/s, rad/s] if any."""
        joints = self.placement.joints.rates if self.placement else ()
        return np.append(self.rates.tension, joints)

    def split(self, controls: Array) -> tuple[Array, Array]:
        """Return the tensions (..., n_tendons) and the joint values (..., n) of controls."""
        n = self.arm.n_tendons
        return controls[..., :n], controls[..., n:]

    @property
    def steps(self) -> Array | None:
        """The prescribed durations (M,) from target to target [s], if any."""
        return None if self.times is None else np.diff(self.times, prepend=0.0)

    def check_durations(self, needed: Array) -> None:
        """Raise InputError for times that the rates do not allow, with times that suffice.

        `needed` (M,) are the smallest durations from target to target [s].
        """
        steps = needed if self.steps is None else self.steps
        for i in np.flatnonzero(needed > steps * (1 + self.accuracy)):
            before = float(steps[:i].sum())
            allowed = (
                f">= {before + needed[i]:.4g} s, {needed[i]:.4g} s after the target before; or "
                f"raise the limits of rates {(needed / steps).max():.3g} times"
            )
            raise InputError(f"times[{i}]", float(steps[: i + 1].sum()), allowed)

    @property
    def wider(self) -> Environment:
        """The environment of waypoint plans, with slightly more than the given clearance."""
        spare = _SPARE * self.arm.length * bool(self.surroundings)
        return replace(self.surroundings, clearance=self.surroundings.clearance + spare)

    def planned(self, i: int, near: Plan | None = None) -> Plan:
        """Return the plan of a single target, with the clearance of waypoints from fixed obstacles.

        Raises InputError if the target is missed; the message includes the next targets that are
        missed too.
        """
        missed = list[Plan]()
        options = self.limits.keywords | self.wider.keywords
        options |= {
            "accuracy": self.accuracy,
            "compile": self.machine_code,
            "certify": False,
            "base": self.placement.joints if self.placement else None,
        }
        for k in range(i, len(self.targets) if near is None else i + 1):
            with of_target(k):
                result = plan(self.arm, self.targets[k], self.scene, near=near, **options)
            if result.solution.stopped:
                raise OutOfTime
            # The nearest shape in the least squares sense may meet the targets, too.
            if result.mode == "exact" or result.reached:
                break
            missed.append(result)
        if not missed:
            return result
        place = f"targets[{i}]" + (len(missed) > 1) * f" to [{i + len(missed) - 1}]"
        targets = [plan.targets for plan in missed]
        texts = (as_given(each[0] if len(each) == 1 else each) for each in targets)
        given = Described(", ".join(texts))
        outcome = missed[0].outcome
        raise InputError(place, given, f"within reach. {outcome}")

    def shape(self, controls: Array, near: Shape | None) -> Shape:
        """Settle under tensions (n_tendons,), and at joint values of the base if any.

        The start is the shape `near`.

        The first shape of a motion has no `near`: settle from rest, or along the load path of the
        initial plan.
        """
        T, joints = self.split(controls)
        arm = self.arm
        if self.placement is not None:
            arm = self.placement.at(tuple(joints.tolist())).arm
            near = near and replace(near, arm=arm)
        fine = max(self.accuracy / 10, FINEST_ACCURACY)
        if near is None and has_complementarity(self.scene):
            from octoplan.planner.extensions.contact.load_path import settled_along

            path = self.begin.solution.load_path if self.begin else ()
            return settled_along(self.arm, path, T, self.scene, fine, self.machine_code)
        return settle(arm, T, self.scene, fine, compile=self.machine_code, near=near)

    def lines(self) -> Lines:
        """Return a function from tensions to midlines, which under loads warm-starts each solve.

        With base joints, the tensions are followed by joint values.
        """
        places = tuple(grid(self.arm)[1:].tolist())
        if self.placement is not None:
            return MovingLines(self.placement, self.scene, _MESH, places, self.machine_code)
        return Lines(self.arm, self.scene, _MESH, places, self.machine_code)


@contextmanager
def of_target(i: int) -> Iterator[None]:
    """Add the index of a target to errors of its input."""
    try:
        yield
    except InputError as reason:
        name = f"targets[{i}]: {reason.field}"
        raise InputError(name, reason.given, reason.allowed) from None


def waypoints_of(
    arm: Arm, path: Any, count: int
) -> tuple[tuple[tuple[Target, ...], ...], Array | None]:
    """Return the targets of each waypoint, and the times in a file if any.

    Parameters
    ----------
    arm : Arm
    path : sequence of targets, function, or name of a .csv file
        A function maps a fraction from 0 to 1 to a target or a place (3,) [m] of the tip, and is
        evaluated `count` times. A file has columns x_m, y_m, z_m and optionally t_s.
    count : int

    Raises
    ------
    InputError
        If `path` has another type or no targets; FileError with the position in a file.
    """
    times = None
    if isinstance(path, str | Path):
        path, times = load(LOAD_WAYPOINTS)(Path(path))
    elif callable(path):
        shares = np.linspace(0, 1, whole("waypoints", count, 1))
        places = [path(share) for share in shares.tolist()]
        path = [place if isinstance(place, Target) else TipPosition(place) for place in places]
    if not isinstance(path, Iterable):
        allowed = "targets in order, a function, or the name of a .csv file"
        raise InputError("targets", path, allowed)
    checked = []
    for i, target in enumerate(path):
        with of_target(i):
            checked.append(check_targets(arm, target))
    if not checked:
        raise InputError("targets", path, "at least one target")
    return tuple(checked), times


def checked_times(
    times: Any, count: int, rates: Rates, joints: BaseJoints | None = None
) -> Array | None:
    """Return the prescribed time of each target [s], or None for minimal time.

    Raises InputError if times do not increase from above 0, and for minimal time without limits of
    rates.
    """
    limited = np.all(np.isfinite(rates.tension)) or np.isfinite(rates.of_places).any()
    if times is None and joints is not None and not np.isfinite(joints.rates).all():
        allowed = "base joints with insertion_rate and rotation_rate, or times [s]"
        raise InputError("base", joints, allowed)
    if times is None and not limited:
        allowed = (
            "a rate of tensions [N/s] for the least time; or pass another limit of rates or "
            "accelerations, or times [s]"
        )
        raise InputError("rate_max", None, allowed)
    if times is None:
        return None
    given = finite_array("times", times, (None,))
    if given.size != count:
        allowed = f"{counted(count, 'time')}, one for each target"
        raise InputError("times", given.tolist(), allowed)
    checked = given
    for i in np.flatnonzero(np.diff(checked, prepend=0.0) <= 0):
        allowed = f"above {checked[i - 1] if i else 0:g} s: times increase from target to target"
        raise InputError(f"times[{i}]", float(checked[i]), allowed)
    return checked


def checked_start(arm: Arm, start: Any, limits: TendonLimits) -> Array:
    """Return the initial tensions (n_tendons,) of a motion [N]."""
    if start is None:
        return np.array(limits.lower)
    if not isinstance(start, Plan):
        kind("start", start, Iterable, "a Plan, or tensions [N]")
        return arm.flat(start, "start")
    if start.arm != arm:
        raise InputError("start", Described("a plan for another arm"), "a plan for this arm")
    return np.ravel(start.tensions)
