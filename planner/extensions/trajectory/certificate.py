"""Certificate of a motion: limits, rates, targets, and clearance between waypoints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from octoplan.model.forward import FINEST_ACCURACY
from octoplan.model.loads import has_complementarity, is_coupled
from octoplan.model.shape import Shape
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import OUT_OF_TIME, OutOfTime, check_time, report
from octoplan.model.support.text import HtmlRepr, to_text
from octoplan.planner.certificate import Certificate, Optimality, certify, tension_excess
from octoplan.planner.extensions.trajectory.clear import between, strokes_between
from octoplan.planner.extensions.trajectory.question import Question
from octoplan.planner.extensions.trajectory.time_law import Timed, fastest_pace
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from octoplan.planner.targets.base import Target

# Tolerance of rates and accelerations of strokes and tip, over the limits, because evaluations are
# at discrete instants.
SAMPLED = 1e-3
# Ratios of quantities to limits: attribute, label, words of the failure, tolerance.
_RATIOS = (
    ("rate", "rate of tension over limit [-]", "a rate of tension or joint", FINEST_ACCURACY),
    ("stroke_rate", "rate of stroke over limit [-]", "a rate of stroke", SAMPLED),
    (
        "stroke_acceleration",
        "stroke acceleration over limit",
        "an acceleration of a stroke",
        SAMPLED,
    ),
    ("tip_acceleration", "tip acceleration over limit", "the tip's acceleration", SAMPLED),
)


@dataclass(frozen=True)
class MotionCertificate(HtmlRepr):
    """Result of the check of a motion.

    Attributes
    ----------
    at_targets : (M,)
        Certificates of the waypoints that meet targets, as for plans: by another integrator.
    bounds : float
        Largest violation of a tension limit [N]. Tensions are linear between waypoints, so that the
        largest violation is at a waypoint.
    strokes : float
        Largest violation of a stroke limit beyond the accuracy of strokes [m], of the settled arm
        at waypoints and at 320 instants from each waypoint to the next.
    rate : float
        Largest rate of a tension or a base joint over its limit; exact, because both are linear
        between waypoints.
    stroke_rate, stroke_acceleration, tip_acceleration : float
        Largest rate and acceleration of a stroke, and acceleration of the tip, over their limits,
        of the settled arm at 320 instants from each waypoint to the next.
    clearance : float
        Smallest distance minus the required clearance, at and between waypoints [m]. The value is a
        lower bound, refined until nonnegative or close to the exact value. The value is -inf if the
        clearance cannot be verified, and inf if no clearance is required. Without loads the bound
        is proven; under loads the clearance is verified at steps, see
        octoplan.planner.extensions.avoidance.strain_bounds.
    nearest : float
        Time of the smallest clearance [s].
    step : float
        Under loads, the largest displacement of a point of the arm between two compared shapes [m];
        0 if clearance is proven.
    jumps : tuple of int
        Indices of waypoints before which an arm in contact or under loads jumps or is unstable; 0
        is the initial waypoint.
    problem : str
        Error that prevented the check, or "".
    """

    at_targets: tuple[Certificate, ...] = ()
    bounds: float = np.inf
    strokes: float = 0.0
    rate: float = np.inf
    stroke_rate: float = 0.0
    stroke_acceleration: float = 0.0
    tip_acceleration: float = 0.0
    clearance: float = np.inf
    nearest: float = 0.0
    step: float = 0.0
    jumps: tuple[int, ...] = ()
    problem: str = ""

    @property
    def residuals(self) -> tuple[float, ...]:
        """The largest equality residual at each target; lengths over the arm's length."""
        return tuple(one.residual for one in self.at_targets)

    @property
    def inequalities(self) -> tuple[float, ...]:
        """The smallest inequality at each target; nonnegative if all are satisfied."""
        return tuple(min(one.inequality.values(), default=0.0) for one in self.at_targets)

    @property
    def reached(self) -> tuple[bool, ...]:
        """Whether each target is met."""
        return tuple(one.attained for one in self.at_targets)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the certificates at targets, a sentence each; these do not fail a motion."""
        return tuple(
            f"at target {i} {warning}"
            for i, one in enumerate(self.at_targets)
            for warning in one.warnings
        )

    @property
    def failures(self) -> tuple[str, ...]:
        """Failed checks, a sentence each."""
        sentences = [self.problem] * bool(self.problem)
        pairs = enumerate(zip(self.residuals, self.inequalities, self.at_targets, strict=True))
        missed = [(i, max(size, -least)) for i, (size, least, of) in pairs if not of.attained]
        sentences += [f"target {i} is off by {size:.2g}" for i, size in missed[:3]]
        for i, one in enumerate(self.at_targets):
            # Report targets and limits once: only the other failures of the certificate remain.
            others = replace(one, equality={}, inequality={}, bounds=0.0, strokes=0.0)
            sentences += [f"at target {i} {failure}" for failure in others.failures]
        if self.bounds > 0:
            sentences.append(f"a tension limit is violated by {self.bounds:.2g} N")
        if self.strokes > 0:
            sentences.append(f"a limit of strokes is passed by {1e3 * self.strokes:.2g} mm")
        for name, _, words, allowed in _RATIOS:
            if getattr(self, name) > 1 + allowed:
                sentences.append(f"{words} is {getattr(self, name):.4g} times its limit")
        if self.jumps:
            places = ", ".join(map(str, self.jumps))
            sentences.append(f"the arm jumps on its way to waypoint {places}")
        if self.clearance < 0:
            short = f"{-1e3 * self.clearance:.3g} mm less than asked at {self.nearest:.4g} s"
            sentences.append(f"the arm is clear by {short}, or that is not verified")
        return tuple(sentences)

    @property
    def passed(self) -> bool:
        """Whether targets, limits, rates and clearance are verified."""
        return not self.failures

    @property
    def rows(self) -> list[list[str]]:
        """Table of the checks: column names, then rows of name with unit, and value."""
        numbers = {
            "limits violated by [N]": self.bounds,
            "stroke limits passed by [mm]": 1e3 * self.strokes,
            **{label: getattr(self, name) for name, label, *_ in _RATIOS},
            "clearance less asked [mm]": 1e3 * self.clearance,
            "verified at steps of [mm]": 1e3 * self.step,
        }
        met = ["targets met", f"{sum(self.reached)} of {len(self.reached)}"]
        return [["checked", "value"], met, *([name, f"{x:.3g}"] for name, x in numbers.items())]

    @property
    def numbers(self) -> dict[str, Any]:
        """Results by name, for files."""
        each = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "at_targets"}
        names = "residuals", "inequalities", "failures"
        return {name: getattr(self, name) for name in names} | each

    def __str__(self) -> str:
        return to_text(self)


def certify_motion(
    question: Question, way: Timed, settled: Callable[[], tuple[Shape, ...]]
) -> MotionCertificate:
    """Check a motion; `settled` returns the shapes at the waypoints, each near the previous one.

    If the time limit is reached first, `problem` reports this.
    """
    rates = question.rates
    parts = way.progress.c[2].astype(int)
    changes = (np.abs(np.diff(way.controls, axis=0)) / question.control_rates).max(axis=1)
    tensions, _ = question.split(way.controls)
    stroke_rate, stroke_acceleration, tip_acceleration = map(float, way.largest / rates.of_places)
    result = MotionCertificate(
        bounds=max(tension_excess(T, question.limits) for T in tensions),
        rate=float((changes[parts] * fastest_pace(way.progress)).max()),
        stroke_rate=stroke_rate,
        stroke_acceleration=stroke_acceleration,
        tip_acceleration=tip_acceleration,
    )
    try:
        return _checked(result, question, way, settled())
    except OutOfTime:
        return replace(result, problem=OUT_OF_TIME)
    except OctoplanError as reason:
        return replace(result, problem=str(reason))


def _checked(
    result: MotionCertificate, question: Question, way: Timed, shapes: tuple[Shape, ...]
) -> MotionCertificate:
    """Return a certificate with the checks at targets and between waypoints."""
    _, joints = question.split(way.controls[list(way.met)])
    pairs = zip(question.targets, (shapes[k] for k in way.met), joints.tolist(), strict=True)
    result = replace(
        result,
        at_targets=tuple(_at_target(question, *pair[:2], tuple(pair[2])) for pair in pairs),
        jumps=tuple(k for k, shape in enumerate(shapes) if k and shape.snaps),
    )
    check_time()  # a certificate at a target catches OutOfTime
    if has_complementarity(question.scene):
        return result
    report("verifying between waypoints")
    lines = question.lines()
    loaded = is_coupled(question.arm, question.scene)
    if loaded or question.limits.strokes is not None:
        slack, _, jumps = strokes_between(question, lines, way)
        result = replace(result, strokes=max(0.0, -float(slack.min())), jumps=jumps)
    bound, when, step = between(lines, way, question.surroundings)
    k = int(np.argmin(bound))
    return replace(
        result,
        clearance=float(bound[k]),
        nearest=float(when[k]),
        step=step * loaded,
    )


def _at_target(
    question: Question, targets: tuple[Target, ...], shape: Shape, joints: tuple[float, ...]
) -> Certificate:
    """Return the certificate of a waypoint: all targets must be met, optimality is not required."""
    problem = PlanningProblem(
        shape.arm,
        targets,
        question.scene,
        question.limits,
        NlpOptions(),
        question.accuracy,
        placement=question.placement and question.placement.at(joints),
    )
    one = certify(problem, shape.tensions, lambda: shape, lambda: Optimality(0.0))
    return replace(one, equality={**one.equality, **one.soft_residual}, soft_residual={})
