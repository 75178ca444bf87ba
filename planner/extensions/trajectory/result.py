"""A motion: tensions over time, its definition, and how it was checked."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import simpson

from octoplan.model.arm import Arm
from octoplan.model.effects import Buoyancy
from octoplan.model.extensions.contact.effects import contacts
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.model.stiffness import stiffness
from octoplan.model.support.checks import finite_array
from octoplan.model.support.errors import InputError
from octoplan.model.support.progress import OUT_OF_TIME, OutOfTime, track
from octoplan.model.support.text import TextRepr, plotted
from octoplan.planner.extensions.trajectory.certificate import (
    SAMPLED,
    MotionCertificate,
    certify_motion,
)
from octoplan.planner.extensions.trajectory.question import GRAVITY, QUASI_STATIC, Question
from octoplan.planner.extensions.trajectory.time_law import Timed
from octoplan.planner.frontends.io.csv_files import motion_csv
from octoplan.planner.frontends.io.files import path_of, write_named


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(TextRepr):
    """Tensions over time. Numbers only.

    `complete` computes certificate and outcome; `trajectory` has done so.

    Attributes
    ----------
    question : Question
        Its definition.
    way : Timed
        The waypoints and the pace between them.
    """

    question: Question
    way: Timed

    @property
    def times(self) -> Array:
        """Times (N + 1,) [s], from 0.

        Those of the targets, of further waypoints around obstacles, and where accelerations of
        strokes are limited more in between. From one to the next tensions change linearly, or
        where accelerations are limited nearly so: `at` is exact.
        """
        return np.asarray(self.way.progress.x)

    @property
    def flat(self) -> Array:
        """Tensions (N + 1, n_tendons) at the times [N]."""
        return self.way.at(self.times)

    @property
    def stops(self) -> tuple[int, ...]:
        """At which of the times each target is met."""
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
        """The settled shapes at the times."""
        return tuple(self.shape(t) for t in self.times)

    @cached_property
    def _at_waypoints(self) -> tuple[Shape, ...]:
        """The settled shapes at the waypoints, each near the one before.

        `Shape.snaps` of each tells where an arm in contact jumps before it.
        """
        shapes = list[Shape]()
        for T in track("shapes", list(self.way.tensions)):
            shapes.append(self.question.shape(T, shapes[-1] if shapes else None))
        return tuple(shapes)

    @property
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
        """Whether each target is met, by the certificate."""
        return self.certificate.reached or (False,) * len(self.question.targets)

    @cached_property
    def period(self) -> float:
        """The slowest period of the arm on its way [s]; quasi-static ways take much longer."""
        return max(slowest_period(self.shapes[stop]) for stop in (0, *self.stops))

    @cached_property
    def inertia(self) -> float:
        """The tip's largest acceleration over gravity; an estimate where it has no limit.

        That is from waypoint to waypoint, as if halfway faster and halfway slower.
        """
        if self.question.rates.at_rest:
            return float(self.way.largest[2] / GRAVITY)
        tips = np.array([shape.tip for shape in self.shapes])
        steps = np.linalg.norm(np.diff(tips, axis=0), axis=1)
        # Between targets that are the same it moves by what these are met to, in no time.
        steps[steps <= self.question.accuracy * self.arm.length] = 0.0
        return float((4 * steps / np.diff(self.times) ** 2).max() / GRAVITY)

    @cached_property
    def outcome(self) -> str:
        """What happened, and what to try: a sentence or two."""
        result, certificate = (
            f"{self.duration:.4g} s for {len(self.stops)} targets",
            self.certificate,
        )
        said = f"Reached: {result}, every target met, limits, rates and clearance kept."
        if not certificate.passed:
            advice = "give it more time, room or tension, or move what is missed"
            if certificate.problem == OUT_OF_TIME:
                advice = "raise time_limit"
            said = f"Not certified ({result}): {'; '.join(certificate.failures)}; {advice}."
        if certificate.problem:
            return said
        warnings = "".join(f" Beware: {warning}." for warning in certificate.warnings[:3])
        return f"{said}{warnings}{self._pace}"

    @cached_property
    def _pace(self) -> str:
        """Whether the motion is slow enough to be quasi-static: a sentence after a space."""
        if self.certificate.problem:
            return ""
        factor, period = f"{self.inertia:.2g} times gravity", f"{self.period:.2g} s"
        is_slow = self.inertia <= QUASI_STATIC * (1 + SAMPLED)
        between = np.diff(self.times[[0, *self.stops]])
        shortest = float(between[between > 0].min(initial=np.inf))
        if is_slow and shortest < self.period:
            return (
                f" Slow enough to be quasi-static by the tip's acceleration, some {factor}, "
                f"but not by the arm's slowest period of {period}: the shortest way takes "
                f"{shortest:.2g} s, give it more time."
            )
        return (
            f" {'Slow' if is_slow else 'Not slow'} enough to be quasi-static: the tip "
            f"accelerates by some {factor}, the arm's slowest period {period}."
        )

    def at(self, t: Any) -> Array:
        """Return the tensions at a time [s], by section, or at times (M,), flat (M, n_tendons) [N].

        Raises InputError for times beyond the motion's.
        """
        wanted = finite_array("t", np.atleast_1d(t), (None,))
        if wanted.size and (wanted.min() < 0 or wanted.max() > self.duration * (1 + 1e-12)):
            raise InputError("t", t, f"times from 0 to {self.duration:g} s")
        result = self.way.at(wanted)
        return self.arm.by_section(result[0]) if np.ndim(t) == 0 else result

    def shape(self, t: float) -> Shape:
        """Return the settled shape at a time [s]."""
        k = int(np.searchsorted(self.way.starts, t, side="right")) - 1
        before = self._at_waypoints[k]
        return (
            before if t == self.way.starts[k] else self.question.shape(np.ravel(self.at(t)), before)
        )

    def save(self, path: str | Path) -> Path:
        """Write times [s], tensions [N] and lengths [m] of the tendons to a .csv file, for a robot.

        Or an animation to .gif, or .mp4 where there is ffmpeg. The file is there whole or not at
        all. Raises InputError for another suffix, and where it cannot be written.
        """
        path = path_of(path)
        if path.suffix.lower() in (".gif", ".mp4"):
            from octoplan.planner.frontends.plots.motion import (
                animate_trajectory,
                save_motion,
                writer_of,
            )

            writer_of(path)
            return save_motion(animate_trajectory(self), path)
        return write_named(path, ".csv", motion_csv(self))

    def plot(self) -> Any:
        """Draw the motion; see octoplan.planner.frontends.plots.motion."""
        return plotted(self)


def slowest_period(shape: Shape) -> float:
    """Return an estimate of the period of the arm's slowest oscillation about a shape [s].

    2 pi sqrt(c m): c the tip's largest compliance, tensions held; m the mass that moves with the
    tip, of places that move in proportion to their arc length squared, as those of a cantilever
    about do (Rayleigh's method). A fluid that buoys the arm moves along, as much as it displaces.
    """
    arm, fluid = shape.arm, shape.scene.find(Buoyancy)
    density = arm.material.density + (fluid.density if fluid else 0.0)
    share = np.linspace(0.0, 1.0, 201)
    area = np.pi * arm.radius.evaluate(arm.length * share, arm.length)[0] ** 2
    mass = density * arm.length * simpson(area * share**4, x=share)
    near = shape if contacts(shape.scene) else None
    k = stiffness(arm, shape.tensions, shape.scene, accuracy=1e-3, near=near)
    compliance = float(np.linalg.eigvalsh(k.compliance[:3, :3]).max())
    return float(2 * np.pi * np.sqrt(compliance * mass))
