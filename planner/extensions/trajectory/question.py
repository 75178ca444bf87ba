"""The definition of a motion: its targets, how fast tensions and strokes may change, when."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.effects import Weight
from octoplan.model.forward import FINEST_ACCURACY
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.checks import finite_array, kind, positive
from octoplan.model.support.errors import InputError
from octoplan.model.support.progress import OutOfTime
from octoplan.model.support.units import STROKE, warn_unusual
from octoplan.planner.extensions.avoidance.lines import Lines
from octoplan.planner.extensions.avoidance.rows import ClearanceConstraints, grid
from octoplan.planner.extensions.avoidance.surroundings import Environment
from octoplan.planner.extensions.contact.load_path import settled_along
from octoplan.planner.frontends.io.csv_files import load_waypoints
from octoplan.planner.plan import ContactPlan, Plan, plan
from octoplan.planner.question import Limits, check_targets, each_tendon
from octoplan.planner.targets import TipPosition
from octoplan.planner.targets.base import Target

GRAVITY = float(np.linalg.norm(Weight().g))
# The tip's acceleration over gravity up to which a motion counts as quasi-static.
QUASI_STATIC = 0.1
# Of the mesh of centrelines; what waypoints keep besides the clearance, over L, for the way
# between them.
_MESH, _SPARE = 3, 1e-3


@dataclass(frozen=True)
class Rates:
    """How fast tensions, strokes and the tip may change.

    Attributes
    ----------
    tension : (n_tendons,)
        [N/s], infinite where there is no limit.
    stroke : float
        [m/s], of every tendon.
    acceleration : float
        Of every stroke [m/s2].
    tip_acceleration : float
        [m/s2]. Where this or that of strokes is limited, motions rest at each waypoint.
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
        """Return the rates of an arm; None is no limit. InputError for what is none."""
        if not isinstance(quasi_static, bool | np.bool_):
            raise InputError("quasi_static", quasi_static, "True or False")
        if quasi_static and tip is not None:
            allowed = "None beside quasi_static=True, which sets it"
            raise InputError("tip_acceleration_max", tip, allowed)
        each = each_tendon(arm, "rate_max", np.inf if tension is None else tension)
        if not each.min() > 0:
            raise InputError("rate_max", each.tolist(), "numbers above 0 N/s")
        options = {
            "stroke_rate_max": stroke,
            "stroke_acceleration_max": acceleration,
            "tip_acceleration_max": QUASI_STATIC * GRAVITY if quasi_static else tip,
        }
        most = [np.inf if limit is None else positive(key, limit) for key, limit in options.items()]
        warn_unusual("stroke_rate_max", [most[0] / arm.length], STROKE)
        return cls(tuple(each.tolist()), *most)

    @property
    def of_places(self) -> Array:
        """The largest stroke rate [m/s], accelerations of strokes and of the tip [m/s2] (3,)."""
        return np.array([self.stroke, self.acceleration, self.tip_acceleration])

    @property
    def at_rest(self) -> bool:
        """Whether accelerations are limited, so that motions rest at each waypoint."""
        return bool(np.isfinite(self.of_places[1:]).any())

    @property
    def pace(self) -> float:
        """The rate of strokes that the program over the waypoints counts with [m/s].

        Where only accelerations are limited, any: durations are theirs then.
        """
        free = not np.isfinite(self.stroke) and self.at_rest
        return 1.0 if free and not np.all(np.isfinite(self.tension)) else self.stroke


@dataclass(frozen=True, eq=False)
class Waypoint:
    """A place of a motion: the targets there, if any, tensions (n_tendons,) [N], inequalities.

    `fraction` is that of the time between two targets in which the arm goes there from the waypoint
    before.
    """

    targets: tuple[Target, ...]
    tensions: Array
    avoidance: ClearanceConstraints | None = None
    fraction: float = 1.0

    @property
    def stated(self) -> tuple[Target, ...]:
        """The targets of its program."""
        return self.targets if self.avoidance is None else self.avoidance.beside(self.targets)


@dataclass(frozen=True, eq=False)
class Question:
    """The definition of a motion.

    `start` are the tensions (n_tendons,) that it begins with [N]; `begin`, in contact, the plan
    that these are of.
    """

    arm: Arm
    scene: Scene
    targets: tuple[tuple[Target, ...], ...]
    limits: Limits
    rates: Rates
    surroundings: Environment
    times: Array | None
    start: Array
    accuracy: float
    machine_code: bool = field(default=False, compare=False)
    begin: ContactPlan | None = field(default=None, compare=False)

    @property
    def steps(self) -> Array | None:
        """The time (M,) that is given from target to target [s], if times are."""
        return None if self.times is None else np.diff(self.times, prepend=0.0)

    def check_durations(self, needed: Array) -> None:
        """Raise InputError for times that the rates do not allow, with what would do.

        `needed` (M,) is what the ways from target to target take [s].
        """
        steps = needed if self.steps is None else self.steps
        for i in np.flatnonzero(needed > steps * (1 + self.accuracy)):
            allowed = (
                f"{needed[i]:.4g} s after the target before at these rates, not {steps[i]:.4g} s; "
                f"or rates {(needed / steps).max():.3g} times as high"
            )
            raise InputError(f"times[{i}]", float(steps[: i + 1].sum()), allowed)

    @property
    def wider(self) -> Environment:
        """What waypoints are planned to keep clear of: by a little more than is asked."""
        spare = _SPARE * self.arm.length * bool(self.surroundings)
        return replace(self.surroundings, clearance=self.surroundings.clearance + spare)

    def planned(self, i: int, near: Plan | None = None) -> Plan:
        """Return the plan that meets a target alone, as clear of what stands still as waypoints.

        Raises InputError, with the targets after it that are missed as well, if there is none.
        """
        missed = list[Plan]()
        more = self.limits.keywords | self.wider.keywords
        more |= {"accuracy": self.accuracy, "compile": self.machine_code, "certify": False}
        for k in range(i, len(self.targets) if near is None else i + 1):
            with of_target(k):
                result = plan(self.arm, self.targets[k], self.scene, near=near, **more)
            if result.stopped:
                raise OutOfTime
            # Least squares may meet them, too.
            if result.mode == "exact" or result.reached:
                break
            missed.append(result)
        if not missed:
            return result
        place = f"targets[{i}]" + (len(missed) > 1) * f" to [{i + len(missed) - 1}]"
        raise InputError(place, "not reached", f"targets that can be met: {missed[0].outcome}")

    def shape(self, T: Array, near: Shape | None) -> Shape:
        """Return the settled shape under tensions (n_tendons,), near another.

        Where the motion begins there is none: from rest, or on the load path of its plan.
        """
        fine = max(self.accuracy / 10, FINEST_ACCURACY)
        if near is None:
            path = self.begin.load_path if self.begin else ()
            return settled_along(self.arm, path, T, self.scene, fine, self.machine_code)
        return settle(self.arm, T, self.scene, fine, compile=self.machine_code, near=near)

    def lines(self) -> Lines:
        """Return centrelines by tensions, under loads each near the one before."""
        places = tuple(grid(self.arm)[1:].tolist())
        return Lines(self.arm, self.scene, _MESH, places, self.machine_code)


@contextmanager
def of_target(i: int) -> Iterator[None]:
    """Let errors of input name the target that they are about."""
    try:
        yield
    except InputError as reason:
        name = f"targets[{i}]: {reason.field}"
        raise InputError(name, reason.given, reason.allowed) from None


def waypoints_of(
    arm: Arm, path: Any, count: int
) -> tuple[tuple[tuple[Target, ...], ...], Array | None]:
    """Return the targets of each waypoint, and the times of a file that has them.

    Parameters
    ----------
    path : sequence of targets, function, or name of a .csv file
        A function takes a share from 0 to 1 and returns a target, or a place (3,) [m] for the tip;
        it is asked `count` times. A file has columns x_m, y_m, z_m and, if it has, t_s.

    Raises
    ------
    InputError
        For what is none of these, and no targets; FileError with the place in a file.
    """
    times = None
    if isinstance(path, str | Path):
        path, times = load_waypoints(Path(path))
    elif callable(path):
        if isinstance(count, bool) or not isinstance(count, int) or count < 1:
            raise InputError("waypoints", count, "a whole number from 1")
        places = [path(float(share)) for share in np.linspace(0, 1, count)]
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


def checked_times(times: Any, count: int, rates: Rates) -> Array | None:
    """Return the time of each target [s], increasing from above 0.

    None for the least time, which InputError asks for unless rates are limited.
    """
    limited = np.all(np.isfinite(rates.tension)) or np.isfinite(rates.of_places).any()
    if times is None and not limited:
        allowed = (
            "rate_max [N/s], a limit of strokes [m/s, m/s2] or of the tip's acceleration [m/s2] "
            "for the least time, or times [s]"
        )
        raise InputError("times", None, allowed)
    if times is None:
        return None
    checked = finite_array("times", times, (count,))
    for i in np.flatnonzero(np.diff(checked, prepend=0.0) <= 0):
        allowed = "times above 0 that increase, one for each target"
        raise InputError(f"times[{i}]", float(checked[i]), allowed)
    return checked


def checked_start(arm: Arm, start: Any, limits: Limits) -> Array:
    """Return the tensions (n_tendons,) that a motion begins with [N]."""
    if start is None:
        return np.array(limits.lower)
    if not isinstance(start, Plan):
        kind("start", start, Iterable, "a Plan, or tensions [N]")
        return arm.flat(start, "start")
    if start.arm != arm:
        raise InputError("start", "a plan for another arm", "one for the same")
    return np.ravel(start.tensions)
