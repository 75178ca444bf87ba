"""Result of planning a motion: tensions over time, definition and certificate."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import simpson

from octoplan.model.arm import Arm
from octoplan.model.effects import Buoyancy
from octoplan.model.loads import has_complementarity
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.stiffness import stiffness
from octoplan.model.support.checks import finite_array, numbers
from octoplan.model.support.errors import InputError
from octoplan.model.support.progress import OUT_OF_TIME, OutOfTime, track
from octoplan.model.support.text import TextRepr, counted, plotted
from octoplan.planner.entry_points import SAVE_TRAJECTORY, load
from octoplan.planner.extensions.trajectory.certificate import (
    SAMPLED,
    MotionCertificate,
    certify_motion,
)
from octoplan.planner.extensions.trajectory.question import GRAVITY, QUASI_STATIC, Question
from octoplan.planner.extensions.trajectory.time_law import Timed


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(TextRepr):
    """Tensions over time.

    `trajectory` returns complete motions; `complete` computes certificate and outcome of others.

    Attributes
    ----------
    question : Question
        Definition of the motion.
    way : Timed
        Waypoints, and the progress over time.
    """

    question: Question
    way: Timed

    @property
    def times(self) -> Array:
        """Times (N + 1,) [s], from 0.

        The times of targets, of additional waypoints around obstacles, and with limits of
        accelerations of intermediate knots. Tensions are linear between the times without limits of
        accelerations, and nearly linear with such limits; `at` is exact.
        """
        return np.asarray(self.way.progress.x)

    @property
    def flat(self) -> Array:
        """Tensions (N + 1, n_tendons) at the times [N]."""
        return self.question.split(self.way.at(self.times))[0]

    @property
    def base(self) -> Array:
        """Insertion [m] and rotation [rad] of the base (N + 1, 2) at the times; 0 if it is fixed.

        Joint values are linear between the times.
        """
        return self.base_at(self.times)

    @property
    def stops(self) -> tuple[int, ...]:
        """Indices of the times at which the targets are met."""
        at = np.searchsorted(self.times, self.way.starts[list(self.way.met)] * (1 - 1e-12))
        return tuple(at.tolist())

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.question.arm

    @property
    def tensions(self) -> Array:
        """Tensions (N + 1, n_sections, n), or (N + 1, n_tendons), at the times [N]."""
        return np.array([self.arm.by_section(T) for T in self.flat])

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """Settled shapes at the times."""
        return tuple(self.shape(t) for t in self.times)

    @cached_property
    def _at_waypoints(self) -> tuple[Shape, ...]:
        """Settled shapes at the waypoints, each near the previous one.

        `Shape.snaps` reports a jump of an arm in contact on the path to the waypoint.
        """
        shapes = list[Shape]()
        for controls in track("shapes", list(self.way.controls)):
            shapes.append(self.question.shape(controls, shapes[-1] if shapes else None))
        return tuple(shapes)

    @property
    def lengths(self) -> Array:
        """Lengths of the tendons (N + 1, n_tendons) at the times [m]."""
        return np.array([shape.tendon_lengths for shape in self.shapes])

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        return float(self.times[-1])

    @cached_property
    def certificate(self) -> MotionCertificate:
        """Certificate: targets, limits, rates and clearance, at and between the times."""
        return certify_motion(self.question, self.way, lambda: self._at_waypoints)

    def complete(self) -> None:
        """Compute certificate and outcome, as far as the time limit allows."""
        self.certificate  # noqa: B018  (cached)
        try:
            self._pace  # noqa: B018  (cached)
        except OutOfTime:
            vars(self)["_pace"] = ""

    @property
    def reached(self) -> tuple[bool, ...]:
        """Whether each target is met according to the certificate."""
        return self.certificate.reached or (False,) * len(self.question.targets)

    @cached_property
    def period(self) -> float:
        """Slowest period of the arm along the motion [s]; quasi-static motions take much longer."""
        return max(slowest_period(self.shapes[stop]) for stop in (0, *self.stops))

    @cached_property
    def inertia(self) -> float:
        """Largest acceleration of the tip over gravity.

        An estimate if accelerations are not limited: the arm accelerates for half of the time
        between two waypoints, and decelerates for the other half.
        """
        if self.question.rates.at_rest:
            return float(self.way.largest[2] / GRAVITY)
        tips = np.array([shape.tip for shape in self.shapes])
        steps = np.linalg.norm(np.diff(tips, axis=0), axis=1)
        # Between equal targets the arm moves within the accuracy, in no time: ignore this.
        steps[steps <= self.question.accuracy * self.arm.length] = 0.0
        return float((4 * steps / np.diff(self.times) ** 2).max() / GRAVITY)

    @cached_property
    def outcome(self) -> str:
        """Result of the planning and one remedy, in a sentence or two."""
        certificate = self.certificate
        result = f"{self.duration:.4g} s for {counted(len(self.stops), 'target')}"
        said = f"Reached: {result}, every target met, limits, rates and clearance kept."
        if not certificate.passed:
            advice = "pass longer times or lower rates"
            if certificate.problem == OUT_OF_TIME:
                advice = "raise time_limit"
            said = f"Not certified ({result}): {'; '.join(certificate.failures)}; {advice}."
        if certificate.problem:
            return said
        warnings = "".join(f" Beware: {warning}." for warning in certificate.warnings[:3])
        return f"{said}{warnings}{self._pace}"

    @cached_property
    def _pace(self) -> str:
        """Sentence on whether the motion is quasi-static, after a space."""
        if self.certificate.problem:
            return ""
        factor = f"{self.inertia:.2g} times gravity"
        period = f"{self.period:.2g} s"
        is_slow = self.inertia <= QUASI_STATIC * (1 + SAMPLED)
        between = np.diff(self.times[[0, *self.stops]])
        shortest = float(between[between > 0].min(initial=np.inf))
        if is_slow and shortest < self.period:
            return (
                f" Slow enough to be quasi-static by the acceleration of the tip, {factor}, but "
                f"not by the slowest period of the arm, {period}: the shortest leg takes "
                f"{shortest:.2g} s; pass longer times."
            )
        remedy = "" if is_slow else "; pass quasi_static=True"
        return (
            f" {'Slow' if is_slow else 'Not slow'} enough to be quasi-static: the tip "
            f"accelerates by {factor}, the slowest period of the arm is {period}{remedy}."
        )

    def at(self, t: Any) -> Array:
        """Return tensions at a time [s], by section; or at times (M,) [s], flat (M, n_tendons) [N].

        Raises InputError for times outside of the motion.
        """
        tensions, _ = self.question.split(self._controls_at(t))
        return self.arm.by_section(tensions[0]) if np.ndim(t) == 0 else tensions

    def base_at(self, t: Any) -> Array:
        """Return insertion [m] and rotation [rad] of the base (2,) or (M, 2) at times [s].

        Raises InputError for times outside of the motion.
        """
        _, joints = self.question.split(self._controls_at(t))
        joints = joints if joints.size else np.zeros((len(joints), 2))
        return np.asarray(joints[0] if np.ndim(t) == 0 else joints)

    def _controls_at(self, t: Any) -> Array:
        """Return tensions and joint values (M, n) at times [s]."""
        times = numbers("t", t, "a time, or a list of times")
        wanted = finite_array("t", np.atleast_1d(times), (None,))
        if wanted.size and (wanted.min() < 0 or wanted.max() > self.duration * (1 + 1e-12)):
            raise InputError("t", t, f"times from 0 to {self.duration:g} s")
        return self.way.at(wanted)

    def shape(self, t: float) -> Shape:
        """Settle at a time [s]."""
        k = int(np.searchsorted(self.way.starts, t, side="right")) - 1
        before = self._at_waypoints[k]
        if t == self.way.starts[k]:
            return before
        return self.question.shape(self._controls_at(t)[0], before)

    def save(self, path: str | Path) -> Path:
        """Write times [s], tensions [N] and tendon lengths [m] to a .csv file.

        Write an animation to a .gif file, or to an .mp4 file if ffmpeg is installed. The file is
        written completely or not at all. Raises InputError for another suffix, and if the file
        cannot be written.
        """
        written: Path = load(SAVE_TRAJECTORY)(self, path)
        return written

    def plot(self) -> Any:
        """Draw the motion; see octoplan.planner.frontends.plots.motion."""
        return plotted(self)


def slowest_period(shape: Shape) -> float:
    """Estimate the period of the arm's slowest oscillation about a shape [s].

    2 pi sqrt(c m), with the largest compliance c of the tip at constant tensions, and the effective
    mass m at the tip, for displacements proportional to the square of the arc length, roughly as
    for a cantilever (Rayleigh's method). A fluid with buoyancy adds the displaced mass.
    """
    arm = shape.arm
    fluid = shape.scene.find(Buoyancy)
    density = arm.material.density + (fluid.density if fluid else 0.0)
    share = np.linspace(0.0, 1.0, 201)
    area = arm.area(arm.length * share)
    mass = density * arm.length * simpson(area * share**4, x=share)
    near = shape if has_complementarity(shape.scene) else None
    k = stiffness(arm, shape.tensions, shape.scene, accuracy=1e-3, near=near)
    compliance = float(np.linalg.eigvalsh(k.compliance[:3, :3]).max())
    return float(2 * np.pi * np.sqrt(compliance * mass))
