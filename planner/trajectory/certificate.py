"""The certificate of a motion: limits and rates exactly, targets, and clearance in between."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.errors import OctoplanError
from model.loads import contacts, is_loaded
from model.mesh import FINEST_ACCURACY
from model.paths import Array
from model.settle import settle
from model.shape import Shape
from model.text import in_notebook
from planner.certificate import Certificate
from planner.measure import compliances_along, measure
from planner.program.terms import stations_of
from planner.targets.base import Target
from planner.trajectory.clear import between
from planner.trajectory.question import Question
from planner.trajectory.timed import Timed
from planner.trajectory.touching import certified_touching

# Rounding, over a limit.
_ROUNDING = 1e-9
# What rates and accelerations of strokes and tip may be off by, over their limit: at instants.
SAMPLED = 1e-3
# What is told over its limit: its name, label, words, and what it may be off by.
_RATIOS = (
    ("rate", "rate of tension over limit [-]", "a rate of tension", _ROUNDING),
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
class MotionCertificate:
    """What the check of a motion found.

    Attributes
    ----------
    residuals : (M,)
        The largest residual of what has to be met at each target; lengths over the arm's length.
    inequalities : (M,)
        The least of what has to be 0 or above there.
    bounds : float
        Largest violation of a tension limit [N]; between waypoints there is none beyond theirs.
    rate : float
        Largest rate of tension over its limit; exact, as tensions are linear in between.
    stroke_rate, stroke_acceleration, tip_acceleration : float
        Largest rate and acceleration of a stroke, and acceleration of the tip, over their limits,
        of the settled arm at 200 instants or more from each waypoint to the next.
    clearance : float
        What is kept of the clearance asked for, at waypoints and between them [m]; a lower bound,
        refined until it is 0 or more or close to the truth, below 0 where it is not kept, and
        -infinite where it cannot be verified. Infinite where nothing was asked. Proven without
        loads; under loads verified at steps, see model.clearance.strain_bounds.
    nearest : float
        When that is [s].
    step : float
        Under loads the largest of these steps: how far places of the arm go at the most between two
        shapes that were compared [m]; 0 where clearance is proven.
    tolerance : float
        What residuals are held to.
    contact : tuple of str
        What does not pass in the certificates of waypoints in contact, besides targets and limits:
        complementarity, stability, balance.
    jumps : tuple of int
        Waypoints, from 0 where the motion begins, on the way to which the arm jumps.
    problem : str
        Why the check could not be made, if so.
    """

    residuals: tuple[float, ...] = ()
    inequalities: tuple[float, ...] = ()
    bounds: float = np.inf
    rate: float = np.inf
    stroke_rate: float = 0.0
    stroke_acceleration: float = 0.0
    tip_acceleration: float = 0.0
    clearance: float = np.inf
    nearest: float = 0.0
    step: float = 0.0
    tolerance: float = 1e-6
    contact: tuple[str, ...] = ()
    jumps: tuple[int, ...] = ()
    problem: str = ""

    @property
    def reached(self) -> tuple[bool, ...]:
        """Which targets are met."""
        pairs = zip(self.residuals, self.inequalities, strict=True)
        return tuple(size <= self.tolerance and least >= -self.tolerance for size, least in pairs)

    @property
    def failures(self) -> tuple[str, ...]:
        """What did not pass, a sentence each."""
        if self.problem:
            return (self.problem,)
        missed = [i for i, met in enumerate(self.reached) if not met]
        sentences = [f"target {i} is off by {self.residuals[i]:.2g}" for i in missed[:3]]
        if self.bounds > 0:
            sentences.append(f"a tension limit is violated by {self.bounds:.2g} N")
        for name, _, words, allowed in _RATIOS:
            if getattr(self, name) > 1 + allowed:
                sentences.append(f"{words} is {getattr(self, name):.4g} times its limit")
        sentences += self.contact
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
    def rows(self) -> list[tuple[str, str]]:
        """What was checked, name with unit and value."""
        numbers = {
            "limits violated by [N]": self.bounds,
            **{label: getattr(self, name) for name, label, *_ in _RATIOS},
            "clearance less asked [mm]": 1e3 * self.clearance,
            "verified at steps of [mm]": 1e3 * self.step,
        }
        rows = [(name, f"{value:.3g}") for name, value in numbers.items()]
        return [("targets met", f"{sum(self.reached)} of {len(self.reached)}"), *rows]

    def _repr_html_(self) -> str:
        return in_notebook(self)

    def __str__(self) -> str:
        head = f"certificate: {'PASSED' if self.passed else 'FAILED'}"
        lines = [head, *(f"  {name:<30} {value:>9}" for name, value in self.rows)]
        return "\n".join(lines + [f"  failed: {failure}" for failure in self.failures])


def certify_motion(question: Question, way: Timed, met: tuple[int, ...]) -> MotionCertificate:
    """Check a motion whose targets are met at some of its waypoints."""
    low, high = np.array(question.limits.lower), np.array(question.limits.upper)
    tensions = way.tensions[1:]
    excess = max(float((low - tensions).max()), float((tensions - high).max()), 0.0)
    if question.limits.total is not None:
        over = float(tensions.sum(axis=1).max()) - question.limits.total * (1 + _ROUNDING)
        excess = max(excess, over)
    steps = np.abs(np.diff(way.tensions, axis=0)) / question.rates.tension
    pace = np.array([law.speeds.max() for law in way.laws])
    limits = MotionCertificate(bounds=excess, rate=float((steps.max(axis=1) * pace).max()))
    if contacts(question.scene):
        return _touching(question, way, met, limits)
    try:
        pairs = zip(question.targets, met, strict=True)
        measured = [_measured(question, targets, way.tensions[stop]) for targets, stop in pairs]
        stroke_rate, stroke_acceleration, tip = _paces(question, way)
    except OctoplanError as reason:
        return replace(limits, problem=str(reason))
    limits = replace(limits, stroke_rate=stroke_rate, stroke_acceleration=stroke_acceleration)
    if question.surroundings:
        kept = between(question.lines(), way, question.surroundings)
        k = int(np.argmin(kept.bound))
        limits = replace(
            limits,
            clearance=float(kept.bound[k]),
            nearest=float(kept.when[k]),
            step=kept.step if is_loaded(question.scene) else 0.0,
        )
    return replace(
        limits,
        residuals=tuple(largest for largest, _ in measured),
        inequalities=tuple(least for _, least in measured),
        tip_acceleration=tip,
        tolerance=question.accuracy,
    )


def _touching(
    question: Question, way: Timed, met: tuple[int, ...], limits: MotionCertificate
) -> MotionCertificate:
    """Return the certificate of a motion in contact, of which limits and rates are checked."""
    try:
        certificates, jumps = certified_touching(question, way.tensions, met)
    except OctoplanError as reason:
        return replace(limits, problem=str(reason))
    sizes = [[*one.equality.values(), *one.soft_residual.values()] for one in certificates]
    problem = next((one.problem for one in certificates if one.problem), "")
    return replace(
        limits,
        residuals=tuple(max(one, default=0.0) for one in sizes),
        inequalities=tuple(min(one.inequality.values(), default=0.0) for one in certificates),
        tolerance=question.accuracy,
        contact=tuple(
            f"at target {i} {why}" for i, one in enumerate(certificates) for why in _of_contact(one)
        ),
        jumps=jumps,
        problem=problem,
    )


def _of_contact(certificate: Certificate) -> tuple[str, ...]:
    """Return what fails at a waypoint besides its targets and limits of tensions."""
    kept = replace(certificate, equality={}, soft_residual={}, inequality={}, bounds=0.0)
    return () if certificate.problem else kept.failures


def _measured(question: Question, targets: tuple[Target, ...], T: Array) -> tuple[float, float]:
    """Return the largest residual and the least inequality of targets under tensions."""
    arm = question.arm
    fine = max(question.accuracy / 10, FINEST_ACCURACY)
    shape: Shape = settle(arm, T, question.scene, fine, compile=question.machine_code)
    poses = shape.poses(np.array(stations_of(arm, targets)))
    equality, soft_residual, inequality = measure(
        arm, targets, poses, compliances_along(arm, targets, shape)
    )
    sizes = [np.abs(v).max(initial=0.0) for v in (*equality.values(), *soft_residual.values())]
    least = [np.min(v) for v in inequality.values()]
    return float(max(sizes, default=0.0)), float(min(least, default=0.0))


def _paces(question: Question, way: Timed) -> tuple[float, float, float]:
    """Return the largest rate and acceleration of a stroke, and of the tip, over their limits."""
    rates = question.rates
    if not (rates.of_strokes or rates.at_rest):
        return 0.0, 0.0, 0.0
    over = way.largest / (rates.stroke, rates.acceleration, rates.tip_acceleration)
    return float(over[0]), float(over[1]), float(over[2])
