"""A motion: tensions over time through targets, within limits on their rates."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from model.arm import Arm
from model.checks import finite_array, kind
from model.clearance import clearances
from model.errors import InputError
from model.loads import check_loads
from model.machine.compiled import Compile, checked_compile
from model.mesh_refinement import checked_accuracy
from model.paths import Array
from model.scene import Scene
from model.settle import settle
from model.shape import Shape
from planner.avoidance.asked import surroundings
from planner.files import write_named
from planner.plan import Plan
from planner.program.limits import Limits
from planner.question import check_strokes, check_targets
from planner.targets.base import Target
from planner.trajectory.asked import Rates, checked_times, waypoints_of
from planner.trajectory.certificate import MotionCertificate, certify_motion, stroke_rates
from planner.trajectory.initial import planned
from planner.trajectory.question import Question, Waypoint
from planner.trajectory.search import led
from planner.trajectory.time_scale import inertia, slowest_period

_LATE = 1e-6
# The share of inertia in weight below which a motion counts as quasi-static.
_SLOW = 0.05


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Tensions over time; between two times they change linearly. Numbers only.

    Attributes
    ----------
    question : Question
        What was asked.
    times : (N + 1,)
        [s], from 0; more than targets where the way around obstacles takes further waypoints.
    flat : (N + 1, n_tendons)
        Tensions at these times [N].
    stops : tuple of int
        At which of the times each target is met.
    branches : tuple of int
        Targets, from 0, whose plan is another branch of optima than that of the one before.
    """

    question: Question
    times: Array
    flat: Array
    stops: tuple[int, ...]
    branches: tuple[int, ...] = ()

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.question.arm

    @cached_property
    def tensions(self) -> Array:
        """Tensions (N + 1, n_sections, n), or (N + 1, n_tendons), at the times [N]."""
        return np.array([self.arm.by_section(T) for T in self.flat])

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """The settled shapes at the times."""
        return tuple(self._shape(T) for T in self.flat)

    @cached_property
    def lengths(self) -> Array:
        """Lengths of the tendons (N + 1, n_tendons) at the times [m]."""
        return np.array([shape.tendon_lengths for shape in self.shapes])

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.times[-1])

    @cached_property
    def certificate(self) -> MotionCertificate:
        """The check of targets, limits, rates, and of clearance between the times, too."""
        return certify_motion(self.question, self.times, self.flat, self.stops)

    @property
    def reached(self) -> tuple[bool, ...]:
        """Whether each target is met, by the certificate."""
        return self.certificate.reached

    @cached_property
    def period(self) -> float:
        """The slowest period of the arm on its way [s]: what is much slower is quasi-static."""
        return max(slowest_period(self.shapes[stop]) for stop in (0, *self.stops))

    @property
    def inertia(self) -> float:
        """An estimate of the tip's largest acceleration over gravity."""
        return inertia(self.times, np.array([shape.tip for shape in self.shapes]))

    @property
    def outcome(self) -> str:
        """What happened, and what to try: a sentence or two."""
        found, certificate = (
            f"{self.duration:.4g} s for {len(self.stops)} targets",
            self.certificate,
        )
        if certificate.passed:
            told = [f"Reached: {found}, every target met, limits, rates and clearance kept."]
        else:
            advice = "give it more time, room or tension, or move what is missed"
            told = [f"Not certified ({found}): {'; '.join(certificate.failures)}; {advice}."]
        if self.branches:
            names = ", ".join(str(i) for i in self.branches)
            told.append(f"At target {names} the plan goes over to another way of reaching.")
        share = f"the tip accelerates by some {self.inertia:.2g} times gravity"
        slow = self.inertia < _SLOW
        words = f"{'Slow' if slow else 'Not slow'} enough to be quasi-static"
        told.append(f"{words}: {share}, the arm's slowest period {self.period:.2g} s.")
        return " ".join(told)

    def at(self, t: Any) -> Array:
        """Return the tensions at a time, by section, or at times (M,), flat (M, n_tendons) [N]."""
        wanted = finite_array("t", np.atleast_1d(t), (None,))
        if wanted.size and (wanted.min() < 0 or wanted.max() > self.duration * (1 + 1e-12)):
            raise InputError("t", t, f"times from 0 to {self.duration:g} s")
        found = np.column_stack([np.interp(wanted, self.times, own) for own in self.flat.T])
        return self.arm.by_section(found[0]) if np.ndim(t) == 0 else found

    def shape(self, t: float) -> Shape:
        """Return the settled shape at a time [s]."""
        return self._shape(np.ravel(self.at(t)))

    def save(self, path: str | Path) -> Path:
        """Write times [s], tensions [N] and lengths [m] of the tendons to a .csv file, for a robot.

        Or an animation to .gif, or .mp4 where there is ffmpeg. The file is there whole or not at
        all. Raises InputError for another suffix, and where it cannot be written.
        """
        if Path(path).suffix.lower() in (".gif", ".mp4"):
            from planner.plots.motion import animate_trajectory, save_motion, writer_of

            writer_of(Path(path))
            return save_motion(animate_trajectory(self), path)
        return write_named(path, ".csv", self.csv)

    def plot(self) -> Any:
        """Draw the motion; see planner.plots.trajectory."""
        from planner.plots.trajectory import plot_trajectory

        return plot_trajectory(self)

    @property
    def csv(self) -> bytes:
        """What is saved."""
        names = [self.arm.tendon_name(j).replace(",", "_") for j in range(self.arm.n_tendons)]
        head = ["t_s", *(f"{name}_N" for name in names), *(f"{name}_length_m" for name in names)]
        rows = np.column_stack([self.times, self.flat, self.lengths]).tolist()
        lines = [",".join(head), *(",".join(map(repr, row)) for row in rows)]
        return ("\n".join(lines) + "\n").encode()

    def _shape(self, T: Array) -> Shape:
        asked = self.question
        fine = max(asked.accuracy / 10, 1e-12)
        return settle(self.arm, T, asked.scene, fine, compile=asked.machine_code)


def trajectory(
    arm: Arm,
    targets: Any,
    scene: Scene | None = None,
    tension_max: Any = np.inf,
    *,
    rate_max: Any = None,
    stroke_rate_max: float | None = None,
    times: Any = None,
    start: Plan | Any = None,
    tension_min: Any = 0.0,
    total_pull: float | None = None,
    obstacles: Any = (),
    clearance: float = 0.0,
    self_clearance: bool = False,
    waypoints: int = 20,
    accuracy: float = 1e-6,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    stroke_max: Any = None,
    stroke_min: Any = None,
) -> Trajectory:
    """Return tensions over time that bring an arm through targets, in the least time or effort.

    Quasi-static: the arm is at rest at each instant; the outcome says how slow is slow enough.

    Parameters
    ----------
    targets : sequence of targets (or of several to be met together), function, or file
        In order; a function of a share from 0 to 1 that returns a target or a place of the tip (3,)
        [m], asked so often as `waypoints` says; or the name of a .csv file with columns x_m, y_m,
        z_m, and t_s if times are given.
    tension_max, tension_min, total_pull, stroke_max, stroke_min, scene, accuracy, compile
        As plan takes them.
    rate_max : float, or one for each tendon
        The fastest that tensions change [N/s].
    stroke_rate_max : float
        The fastest that lengths of tendons change [m/s].
    times : (M,)
        When each target is to be reached [s]; then effort is made least, otherwise time.
    start : Plan, or tensions
        Where the motion begins; at rest, with the least tensions, unless given.
    obstacles, clearance, self_clearance
        What the arm keeps clear of, all the time; see plan.

    Raises
    ------
    InputError
        Naming the field, for anything that is not allowed; for times that the rates do not allow,
        with what would do.
    """
    scene = scene or Scene()
    check_loads(arm, scene)
    path, own = waypoints_of(targets, waypoints)
    times = own if times is None else times
    limits = Limits.of(arm, tension_max, tension_min, total_pull)
    limits = limits.with_strokes(arm, stroke_max, stroke_min)
    check_strokes(scene, limits)
    asked = []
    for i, target in enumerate(path):
        try:
            asked.append(check_targets(arm, target))
        except InputError as reason:
            name = f"targets[{i}]: {reason.field}"
            raise InputError(name, reason.given, reason.allowed) from None
    rates = Rates.of(arm, rate_max, stroke_rate_max)
    found = checked_times(times, len(asked))
    if found is None and not rates.limited:
        told = "rate_max [N/s] or stroke_rate_max [m/s] for the least time, or times [s]"
        raise InputError("times", None, told)
    every: tuple[Target, ...] = tuple(target for targets in asked for target in targets)
    around = surroundings(arm, every, obstacles, clearance, self_clearance)
    accuracy = checked_accuracy(accuracy)
    begin = _start(arm, start, limits)
    given = (around, found, begin, accuracy, checked_compile(compile))
    question = Question(arm, scene, tuple(asked), limits, rates, *given)
    _check_start(question)
    ways = planned(question)
    branches = tuple(
        i for i, way in enumerate(ways) if i and way.plan is not None and way.plan.jump > 0
    )
    met = [i for i, way in enumerate(ways) if way.plan is None or way.plan.mode == "exact"]
    if len(met) < len(ways):
        _out_of_reach(ways, met)
    ways, durations, clear = led(question, ways)
    if not clear and any(way.plan is None for way in ways if way.targets):
        ways, durations, _ = led(question, planned(question, step=False))
    flat = np.vstack([question.start, *(way.tensions for way in ways)])
    ends = np.concatenate([[0.0], np.cumsum(durations)])
    # Strokes are no linear functions of tensions: somewhere in between they may be faster.
    durations *= np.maximum(stroke_rates(question, ends, flat), 1.0)
    ends = np.concatenate([[0.0], np.cumsum(durations)])
    _check_durations(question, ways, durations)
    stops = tuple(i + 1 for i, way in enumerate(ways) if way.targets)
    return Trajectory(question, ends, flat, stops, branches)


def _start(arm: Arm, start: Any, limits: Limits) -> Array:
    """Return the tensions (n_tendons,) that a motion begins with."""
    if start is None:
        return np.array(limits.lower)
    if isinstance(start, Plan):
        if start.arm != arm:
            raise InputError("start", "a plan for another arm", "one for the same")
        return np.ravel(start.tensions)
    kind("start", start, Iterable, "a Plan, or tensions [N]")
    return arm.flat(start, "start")


def _check_start(question: Question) -> None:
    """Raise InputError where the arm is too near to something before it moves."""
    line, asked = question.lines()(question.start), question.surroundings
    if not asked or line is None or asked.keeps(line):
        return
    found = clearances(line, asked.obstacles, asked.least)
    nearest = min(found.values(), key=lambda clear: clear.gap)
    kept = f"{1e3 * asked.clearance:g} mm of clearance" if asked.clearance else "clear"
    allowed = f"a start or obstacles that leave the arm {kept} before it moves: {nearest}"
    raise InputError("start", [round(float(T), 6) for T in question.start], allowed)


def _out_of_reach(ways: list[Waypoint], met: list[int]) -> None:
    """Raise InputError that tells from where to where a path cannot be followed."""
    missed = [i for i in range(len(ways)) if i not in met]
    last = missed[0]
    while last + 1 in missed:
        last += 1
    place = f"targets[{missed[0]}]" if last == missed[0] else f"targets[{missed[0]}] to [{last}]"
    own = ways[missed[0]].plan
    why = "" if own is None else own.outcome
    raise InputError(place, "out of reach", f"targets that can be met: {why}")


def _check_durations(question: Question, ways: list[Waypoint], durations: Array) -> None:
    """Raise InputError for times that the rates do not allow, with what would do."""
    if question.times is None:
        return
    group = np.cumsum([0, *(bool(way.targets) for way in ways[:-1])])
    needed = np.bincount(group, durations)
    late = np.flatnonzero(needed > question.least * (1 + _LATE) + 1e-12)
    if late.size:
        i, faster = int(late[0]), (needed / question.least).max()
        allowed = (
            f"{needed[i]:.4g} s after what is before, at these rates, which is given "
            f"{question.least[i]:.4g} s; or some {faster:.3g} times the rates"
        )
        raise InputError(f"times[{i}]", float(question.times[i]), allowed)
