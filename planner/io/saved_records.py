"""Records of plans, calibrations and designs: plans and calibrations are loaded from theirs.

Of these `question` and `answer`, or `fit`, are what is read; all else is derived of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, get_type_hints

import msgspec
import numpy as np
from msgspec import Meta

from model.effects import PrintedStatics
from model.errors import OctoplanError
from model.time_limit import OutOfTime
from planner.certificate import Certificate
from planner.io.codec import arguments
from planner.io.plain import Number, exact, plain
from planner.io.records import Floats, Matrix, Record, Rows, Schema, record_of, simple
from planner.program.statement import Statement
from planner.solve.search_result import SearchResult, Trial
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
    lam_x: list[Number] = []
    lam_g: list[Number] = []
    starts: list[StartRecord] = []
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


# Certificates keep the keys that their files had; what is worked out on request is told as well.
_RENAMED = {"equality": "match", "soft_residual": "approach", "inequality": "margin"}
_LEFT_OUT = {"on_request", "gaps_asked"}
_WORKED_OUT: dict[str, Any] = {
    "passed": bool,
    "clearance": float | None,
    "gaps": dict[str, float | None],
    "nearest": str,
    "load_factor": float | None,
}


def _certificate_keys() -> dict[str, Any]:
    """Return the keys of certificates in files and their types: the fields of Certificate."""
    hints = get_type_hints(Certificate)
    fields = [name for name in arguments(Certificate) if name not in _LEFT_OUT]
    numbers = {float: float | None, Mapping[str, float]: dict[str, float | None]}
    told = {_RENAMED.get(name, name): numbers.get(hints[name], hints[name]) for name in fields}
    return {**told, **_WORKED_OUT}


CertificateRecord: Any = msgspec.defstruct(
    "CertificateRecord",
    list(_certificate_keys().items()),
    namespace={"__doc__": "What the check found; lengths over the arm's length, angles in rad."},
    module=__name__,
    kw_only=True,
)


class PlanRecord(Record, kw_only=True):
    """A plan. `question` and `answer` are what it is loaded from, the rest is derived of them."""

    schema: Annotated[Literal["octoplan plan 1"], Schema]
    outcome: Annotated[str, Meta(description="what happened, what holds it, what to try")]
    certified: bool
    mode: Literal["exact", "closest", "nearest"]
    tensions_N: Rows
    tendons: Annotated[list[str], Meta(description="their names, in tendon order")]
    lengths_m: Annotated[Any, Meta(description="of the tendons, like tensions_N")] = None
    strokes_m: Annotated[Any, Meta(description="taken in from where winches are zeroed")] = None
    tip_error_per_length: Annotated[
        dict[str, float] | None, Meta(description="of taut tendons: m of the tip per m of a winch")
    ] = None
    effort_N: float
    tip_m: Floats | None
    tip_frame: Annotated[Matrix | None, Meta(description="columns t, n, b")]
    certificate: CertificateRecord
    question: QuestionRecord
    answer: AnswerRecord


def plan_record(plan: Any) -> PlanRecord:
    """Return the record of a Plan.

    Raises InputError where arm, scene or targets are of kinds that could not be read back.
    """
    certificate, back = plan.certificate, {new: old for old, new in _RENAMED.items()}
    told = {key: simple(getattr(certificate, back.get(key, key))) for key in _certificate_keys()}
    return record_of(
        PlanRecord,
        plan,
        certified=certificate.passed,
        tendons=[plan.arm.tendon_name(j) for j in range(plan.arm.n_tendons)],
        **_shape_of(plan),
        certificate=CertificateRecord(**told),
        question=QuestionRecord(
            **{name: plain(getattr(plan, name)) for name in ("arm", "scene", "targets")},
            limits=_limits(plan.limits),
            accuracy=plan.accuracy,
            obstacles=plain(plan.surroundings.obstacles),
            clearance=plan.surroundings.clearance,
            self_clearance=plan.surroundings.of_itself,
        ),
        answer=_answer(plan),
    )


def _shape_of(plan: Any) -> dict[str, Any]:
    """Return what depends on the shape: None where the tensions do not settle.

    Lengths are None where there are none: as printed.
    """
    keys = ("tip_m", "tip_frame", "lengths_m", "strokes_m", "tip_error_per_length")
    found: dict[str, Any] = dict.fromkeys(keys)
    try:
        found |= {"tip_m": plan.shape.tip, "tip_frame": plan.shape.tip_frame}
        if not plan.scene.has(PrintedStatics):
            error = length_error(plan.shape)
            per_length = dict(zip(error.names, error.each.tolist(), strict=True))
            lengths = {"lengths_m": plan.lengths, "strokes_m": plan.strokes}
            found |= {**lengths, "tip_error_per_length": per_length}
    except (OctoplanError, OutOfTime):
        pass
    return found


def _limits(limits: Any) -> LimitsRecord:
    names = LimitsRecord.__struct_fields__
    return LimitsRecord(**{name: exact(getattr(limits, name)) for name in names})


def _answer(plan: Any) -> AnswerRecord:
    starts = [StartRecord(**{name: exact(getattr(own, name)) for name in arguments(Trial)})
              for own in plan.starts]  # fmt: skip
    numbers = ("lam_x", "lam_g", "stopped", "jump", "lost", "in_the_way")
    return AnswerRecord(
        statement=plan.statement,
        tensions=exact(np.ravel(plan.tensions)),
        starts=starts,
        avoidance=None if plan.avoidance is None else plain(plan.avoidance),
        load_path=exact(getattr(plan, "load_path", ())),
        **{name: exact(getattr(plan, name)) for name in numbers},
    )


# A field of what a search finds that no key holds is an error when this is imported.
for _own, _record, _more in (
    (SearchResult, AnswerRecord, {"avoidance"}),
    (Trial, StartRecord, set[str]()),
):
    if set(arguments(_own)) | _more != set(_record.__struct_fields__):
        raise TypeError(f"{_record.__name__} does not have the fields of {_own.__name__}")


# Calibrations and designs


class ValueRecord(msgspec.Struct, kw_only=True):
    """An unknown's value and standard error, in the unit of its key; "inf" if nothing tells it."""

    name: str
    value: float
    std: Number
    unit: str


class ResidualRecord(msgspec.Struct, kw_only=True):
    """What is predicted less what was measured [m], of frames [rad]."""

    shape: str
    what: str
    miss: Floats


class FitRecord(msgspec.Struct, kw_only=True):
    """How residuals were counted and what was found; the values are loaded from here."""

    values: Floats
    noise: float
    loss: str
    absolute_std: bool
    refinement: int
    error: float
    starts: list[dict[str, Any]]
    astray: list[str]
    stages: int
    left_out: list[list[str]] = []
    stopped: bool = False


class CalibrationRecord(Record, kw_only=True):
    """A calibration; `question` and `fit` are what it is loaded from, the rest is derived."""

    schema: Annotated[Literal["octoplan calibration 1"], Schema]
    outcome: Annotated[str, Meta(description="what was found, and how well it is known")]
    values: list[ValueRecord]
    unidentified: list[str]
    mean_error_m: float | None
    residuals: list[ResidualRecord]
    scene: Annotated[dict[str, Any], Meta(description="arm and effects as a scene file has them")]
    question: Annotated[dict[str, Any], Meta(description="arm, scene, measured, unknowns")]
    fit: FitRecord


def calibration_record(of: Any) -> CalibrationRecord:
    """Return the record of a Calibration."""
    rows = zip(of.unknowns, of.values, of.std.tolist(), strict=True)
    fit = {"loss": of.weights.loss, "absolute_std": of.weights.absolute}
    named = ("values", "noise", "refinement", "stages", "error", "astray", "left_out", "stopped")
    fit |= {name: simple(getattr(of, name)) for name in named}
    return record_of(
        CalibrationRecord,
        of,
        values=[
            ValueRecord(name=own.name, value=x, std=exact(std), unit=of.parameters.unit(own))
            for own, x, std in rows
        ],
        unidentified=list(map(str, of.unidentified)),
        residuals=[
            ResidualRecord(shape=own.shape, what=own.what, miss=list(own.miss))
            for own in of.residuals
        ],
        scene=_scene_of(of),
        question={
            "arm": plain(of.given_arm),
            "scene": plain(of.given_scene),
            "measured": [_fields(own) for own in of.measured],
            "unknowns": [_fields(own) for own in of.unknowns],
        },
        fit=FitRecord(**fit, starts=[_fields(own) for own in of.starts]),
    )


def _fields(of: Any) -> dict[str, Any]:
    return {name: exact(getattr(of, name)) for name in arguments(type(of))}


def _scene_of(of: Any) -> dict[str, Any]:
    table = of.parameters.table_at(of.array, "")
    return {key: table[key] for key in ("arm", "effects")}


class DesignedRecord(msgspec.Struct, kw_only=True):
    """An unknown's value, in the unit of its key."""

    name: str
    value: float
    before: float


class DesignRecord(Record, kw_only=True):
    """A designed arm and its plans."""

    schema: Annotated[Literal["octoplan design 1"], Schema]
    outcome: str
    feasible: Annotated[bool, Meta(description="whether every plan is certified")]
    effort_N: Annotated[float, Meta(description="root of the sum of the squared efforts")]
    objective: Annotated[str, Meta(description="effort, Stiffest, Softest or Reach")]
    value: Annotated[float, Meta(description="of the objective: [N], [N/m] or [m]")]
    value_before: Annotated[float, Meta(description="the same of the given arm")]
    gain: Annotated[
        float | None, Meta(description="share of effort saved, or by which stiffness or reach grow")
    ]
    values: list[DesignedRecord]
    scene: Annotated[dict[str, Any], Meta(description="arm and effects as a scene file has them")]
    plans: list[PlanRecord]


def design_record(of: Any) -> DesignRecord:
    """Return the record of a Design."""
    rows = zip(of.unknowns, of.values, of.parameters.start.tolist(), strict=True)
    return record_of(
        DesignRecord,
        of,
        objective="effort" if of.objective == "effort" else type(of.objective).__name__,
        values=[DesignedRecord(name=own.name, value=x, before=old) for own, x, old in rows],
        scene=_scene_of(of),
        plans=[plan_record(own) for own in of.plans],
    )
