"""A plan as a record: what people and machines read of it, and all that it takes to load it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from model.effects import PrintedStatics
from model.errors import OctoplanError
from model.time_limit import OutOfTime
from planner.files import versions
from planner.program.statement import Statement
from planner.records.values import Number, number, plain
from planner.tendon_lengths import length_error


class LimitsRecord(msgspec.Struct, kw_only=True):
    """Limits of the tensions [N], in tendon order."""

    upper: list[Number]
    lower: list[Number]
    total: float | None = None
    strokes: Annotated[
        tuple[list[Number], list[Number]] | None,
        Meta(description="least and most that winches take in [m]"),
    ] = None
    stroke_zero: Annotated[
        list[Number] | None,
        Meta(description="lengths of the tendons where winches are zeroed [m]; else at rest"),
    ] = None


class QuestionRecord(msgspec.Struct, kw_only=True):
    """What was asked; arm, scene and targets are tables with a kind and its fields."""

    arm: dict[str, Any]
    scene: dict[str, Any]
    targets: list[dict[str, Any]]
    limits: LimitsRecord
    accuracy: float
    obstacles: list[dict[str, Any]] = []
    clearance: float = 0.0
    self_clearance: bool = False


class StartRecord(msgspec.Struct, kw_only=True):
    """An initial guess and what became of it."""

    objective: Number
    met: bool
    iterations: Annotated[int, Meta(ge=0)]


class AnswerRecord(msgspec.Struct, kw_only=True):
    """What was found: how the question was stated in the end, tensions [N], multipliers."""

    statement: Statement
    tensions: list[Number]
    lam_x: list[Number]
    lam_g: list[Number]
    starts: list[StartRecord]
    stopped: Annotated[bool, Meta(description="whether the time limit ended the search")] = False
    jump: Annotated[
        float, Meta(ge=0, description="of the tensions where a branch that was followed was left")
    ] = 0.0
    lost: Annotated[
        float,
        Meta(ge=0, description="share of the effort by which a lost optimum was cheaper"),
    ] = 0.0
    in_the_way: Annotated[
        str, Meta(description="the obstacle that alone keeps the targets from being met")
    ] = ""
    avoidance: dict[str, Any] | None = None
    load_path: Annotated[
        list[list[Number]], Meta(description="tensions on the load path of an arm in contact [N]")
    ] = []


class CertificateRecord(msgspec.Struct, kw_only=True):
    """What the check by another integrator found; lengths over arm length, angles in rad."""

    passed: bool
    # Files keep the keys that they had.
    equality: dict[str, float | None] = msgspec.field(name="match")
    soft_residual: dict[str, float | None] = msgspec.field(name="approach")
    inequality: dict[str, float | None] = msgspec.field(name="margin")
    bounds: float | None
    strokes: float | None = 0.0
    kkt: float | None
    agreement: float | None
    error: float | None
    stability: float | None = None
    stability_margin: float | None = None
    load_factor: float | None = None
    complementarity: Annotated[
        float | None, Meta(description="by how much conditions of contact are missed; null without")
    ] = None
    scheme: str
    tolerance: float
    problem: str
    clearance: float | None = None
    gaps: dict[str, float | None] = {}
    least_gaps: dict[str, float] = {}
    nearest: str = ""
    units: Annotated[
        dict[str, str],
        Meta(description='of match, approach, margin: "L" is over arm length'),
    ] = {}


class PlanRecord(msgspec.Struct, kw_only=True):
    """A plan. `question` and `answer` are what it is loaded from, the rest is derived of them."""

    schema: Annotated[Literal["octoplan plan 1"], Meta(description="what this is")]
    versions: Annotated[dict[str, str], Meta(description="of what computed it")]
    outcome: Annotated[str, Meta(description="what happened, what holds it, what to try")]
    certified: bool
    mode: Literal["exact", "closest", "nearest"]
    tensions_N: Annotated[Any, Meta(description="a row a section, tip first, or flat")]
    tendons: Annotated[list[str], Meta(description="their names, in tendon order")]
    lengths_m: Annotated[Any, Meta(description="of the tendons, like tensions_N")] = None
    strokes_m: Annotated[Any, Meta(description="taken in from where winches are zeroed")] = None
    tip_error_per_length: Annotated[
        dict[str, float] | None, Meta(description="of taut tendons: m of the tip per m of a winch")
    ] = None
    effort_N: float
    tip_m: list[float] | None
    tip_frame: Annotated[list[list[float]] | None, Meta(description="columns t, n, b")]
    certificate: CertificateRecord
    question: QuestionRecord
    answer: AnswerRecord


def plan_record(plan: Any) -> PlanRecord:
    """Return the record of a Plan.

    Raises InputError where arm, scene or targets are of kinds that could not be read back.
    """
    (tip, tip_frame), winches = _tip(plan), _winches(plan)
    return PlanRecord(
        schema="octoplan plan 1",
        versions=versions(),
        outcome=plan.outcome,
        certified=plan.certificate.passed,
        mode=plan.mode,
        tensions_N=plan.tensions.tolist(),
        tendons=[plan.arm.tendon_name(j) for j in range(plan.arm.n_tendons)],
        effort_N=plan.effort,
        tip_m=tip,
        tip_frame=tip_frame,
        lengths_m=winches[0],
        strokes_m=winches[1],
        tip_error_per_length=winches[2],
        certificate=_certificate(plan.certificate),
        question=QuestionRecord(
            arm=plain(plan.arm),
            scene=plain(plan.scene),
            targets=[plain(target) for target in plan.targets],
            limits=_limits(plan.limits),
            accuracy=plan.accuracy,
            obstacles=[plain(obstacle) for obstacle in plan.surroundings.obstacles],
            clearance=plan.surroundings.clearance,
            self_clearance=plan.surroundings.of_itself,
        ),
        answer=AnswerRecord(
            statement=plan.statement,
            tensions=_numbers(np.ravel(plan.tensions)),
            lam_x=_numbers(plan.lam_x),
            lam_g=_numbers(plan.lam_g),
            starts=[_start(start) for start in plan.starts],
            stopped=plan.stopped,
            jump=plan.jump,
            lost=plan.lost,
            in_the_way=plan.in_the_way,
            avoidance=None if plan.avoidance is None else plain(plan.avoidance),
            load_path=[_numbers(T) for T in getattr(plan, "load_path", ())],
        ),
    )


def _tip(plan: Any) -> tuple[list[float] | None, list[list[float]] | None]:
    """Return where the tip is, and its frame; None where the tensions do not settle."""
    try:
        return plan.shape.tip.tolist(), plan.shape.tip_frame.tolist()
    except (OctoplanError, OutOfTime):
        return None, None


def _winches(plan: Any) -> tuple[Any, Any, dict[str, float] | None]:
    """Return lengths, strokes and what wrong lengths do; None where there are none."""
    if plan.scene.has(PrintedStatics):
        return None, None, None
    try:
        found = length_error(plan.shape)
        off = dict(zip(found.names, found.each.tolist(), strict=True))
        return plan.lengths.tolist(), plan.strokes.tolist(), off
    except (OctoplanError, OutOfTime):
        return None, None, None


def _certificate(certificate: Any) -> CertificateRecord:
    names = (name for name in CertificateRecord.__struct_fields__)
    return CertificateRecord(**{name: _finite(getattr(certificate, name)) for name in names})


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _finite(own) for name, own in value.items()}
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _limits(limits: Any) -> LimitsRecord:
    lower, ends = _numbers(limits.lower), limits.strokes
    strokes = None if ends is None else (_numbers(ends[0]), _numbers(ends[1]))
    upper = _numbers(limits.upper)
    zero = None if limits.stroke_zero is None else _numbers(limits.stroke_zero)
    return LimitsRecord(
        upper=upper, lower=lower, total=limits.total, strokes=strokes, stroke_zero=zero
    )


def _start(start: Any) -> StartRecord:
    return StartRecord(
        objective=number(start.objective), met=bool(start.met), iterations=start.iterations
    )


def _numbers(values: Any) -> list[Number]:
    return [number(value) for value in values]
