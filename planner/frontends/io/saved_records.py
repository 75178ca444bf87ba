"""Records of plans, calibrations and designs.

Plans and calibrations are loaded from the keys `question` and `answer`, or `fit`; other keys are
derived.
"""

from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import UNSET, Meta, UnsetType

from octoplan.model.arm import Arm
from octoplan.model.extensions.lengths.winches import WinchSettings
from octoplan.model.extensions.obstacles import Moving
from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.scene import Scene
from octoplan.planner.certificate import Certificate
from octoplan.planner.extensions.avoidance.rows import ClearanceConstraints, ClearanceRow, Place
from octoplan.planner.extensions.base_joints.joints import BaseJoints
from octoplan.planner.extensions.fit.fitted import Fitted, Start
from octoplan.planner.extensions.fit.measured import Measured
from octoplan.planner.extensions.fit.orders import Order
from octoplan.planner.extensions.fit.residuals import Residual
from octoplan.planner.extensions.fit.unknowns import Unknown
from octoplan.planner.frontends.io.codec import (
    READ,
    WRITE,
    arguments,
    attributes_of,
    choice,
    encode_exact,
    read_exact,
)
from octoplan.planner.frontends.io.files import to_json, write_named
from octoplan.planner.frontends.io.object_tables import TARGETS
from octoplan.planner.frontends.io.records import (
    Floats,
    Matrix,
    Record,
    Rows,
    Schema,
    about,
    derived,
    of_shape,
    record,
    records,
)
from octoplan.planner.frontends.io.tables import Number, exact, exact_choices, struct, type_in_file
from octoplan.planner.limits import TendonLimits
from octoplan.planner.solution import Solution

WRITE |= dict.fromkeys((ClearanceConstraints, ClearanceRow, Place))
ObstacleKind: Any = choice([*exact_choices(Obstacle), exact(Moving)])
TargetKind: Any = choice(map(exact, TARGETS))
ArmKind: Any = exact(Arm)
SceneKind: Any = exact(Scene)
BaseKind: Any = exact(BaseJoints, placed=True)
LimitsKind: Any = exact(TendonLimits, placed=True)
ShapeKind: Any = exact(Measured, placed=True)
UnknownKind: Any = exact(Unknown, placed=True)
WinchKind: Any = exact(WinchSettings, placed=True)


class QuestionRecord(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """The planning problem; arm, scene and targets are tables with a kind and fields."""

    arm: Annotated[ArmKind, about(of=lambda plan: encode_exact(plan.arm))]
    scene: Annotated[SceneKind, about(of=lambda plan: encode_exact(plan.scene))]
    targets: Annotated[list[TargetKind], about(of=lambda plan: encode_exact(plan.targets))]
    limits: Annotated[LimitsKind, about(of=lambda plan: encode_exact(plan.problem.limits))]
    accuracy: Annotated[float, about(of=attrgetter("problem.accuracy"))]
    obstacles: Annotated[
        list[ObstacleKind], about(of=lambda plan: encode_exact(plan.problem.environment.obstacles))
    ] = []
    clearance: Annotated[float, about(of=attrgetter("problem.environment.clearance"))] = 0.0
    self_clearance: Annotated[bool, about(of=attrgetter("problem.environment.of_itself"))] = False
    base: Annotated[
        BaseKind | None,
        about(
            "joints of the base", lambda plan: encode_exact(plan.problem.base_keywords.get("base"))
        ),
    ] = None


_SOLUTION = tuple(name for name in arguments(Solution) if name != "optimum")
_AVOIDANCE: Any = type_in_file(ClearanceConstraints | None, None)
AnswerRecord: Any = struct(
    "AnswerRecord",
    [("avoidance", _AVOIDANCE | UnsetType, UNSET)],
    base=exact(
        Solution, placed=True, names=tuple(name for name in _SOLUTION if name != "avoidance")
    ),
)
READ[AnswerRecord] = lambda table: read_exact(Solution, table)

CertificateRecord: Any = derived(
    Certificate,
    "clearances",
    "load_factor",
    "gaps_asked",
    "checks",
    passed=bool,
    clearance=float | None,
    complementarity=float | None,
    gaps=dict[str, float | None],
    nearest=str,
    load_factor=float | None,
)


def _answer(plan: Any) -> dict[str, Any]:
    result = attributes_of(plan.solution, _SOLUTION)
    return result | {"tensions": encode_exact(np.ravel(plan.tensions))}


class PlanRecord(Record, kw_only=True):
    """A plan, loaded from `question` and `answer`; other keys are derived."""

    schema: Annotated[Literal["octoplan plan 1"], Schema]
    outcome: Annotated[str, about("the result, the active limits, and a remedy if it failed")]
    certified: Annotated[bool, about(of=lambda plan: plan.certificate.passed)]
    mode: Literal["exact", "closest", "nearest"]
    tensions_N: Rows
    base: Annotated[
        dict[str, float] | None,
        about(
            "joint values of the base: insertion [m] and rotation [rad]",
            lambda plan: None if plan.base is None else plan.base._asdict(),
        ),
    ] = None
    tendons: Annotated[
        list[str], about("names, in tendon order", lambda plan: plan.arm.tendon_names)
    ]
    lengths_m: Annotated[Any, about("of the tendons, like tensions_N")] = None
    strokes_m: Annotated[Any, about("taken in from the zero of the winches")] = None
    tip_error_per_length: Annotated[
        dict[str, float] | None, about("taut tendons: displacement of the tip per winch stroke")
    ] = None
    effort_N: float
    tip_m: Floats | None
    tip_frame: Annotated[Matrix | None, about("columns t, n, b")]
    certificate: Annotated[
        CertificateRecord, about(of=lambda plan: record(CertificateRecord, plan.certificate))
    ]
    question: Annotated[QuestionRecord, about(of=lambda plan: record(QuestionRecord, plan))]
    answer: Annotated[AnswerRecord, about(of=_answer)]


def save_plan(plan: Any, path: str | Path) -> Path:
    """Write the record of a Plan to a .json file; see Plan.save."""
    return write_named(path, ".json", to_json(plan_record(plan)))


def plan_record(plan: Any) -> PlanRecord:
    """Return the record of a Plan.

    Raises InputError if arm, scene or targets have types that cannot be loaded.
    """
    shape = {key: item for key, item in of_shape(plan).items() if key != "slack"}
    return record(PlanRecord, plan, **shape)


# Calibrations and designs


class ValueRecord(msgspec.Struct, kw_only=True):
    """Value and standard error of an unknown, in the unit of the key; "inf" if undetermined."""

    name: str
    value: float
    std: Number
    unit: str


def _values(fit: Any) -> list[ValueRecord]:
    rows = zip(fit.unknowns, fit.values, fit.std.tolist(), strict=True)
    return [
        ValueRecord(name=item.name, value=x, std=encode_exact(std), unit=fit.parameters.unit(item))
        for item, x, std in rows
    ]


_MISS = about("prediction minus measurement [m] or [rad]; null for unmeasured coordinates")
ResidualRecord: Any = derived(Residual, "miss", miss=Annotated[tuple[float | None, ...], _MISS])


class CalibrationQuestion(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """The calibration problem: arm and scene as given, measurements and unknowns."""

    arm: Annotated[ArmKind, about(of=lambda fit: encode_exact(fit.given_arm))]
    scene: Annotated[SceneKind, about(of=lambda fit: encode_exact(fit.given_scene))]
    measured: Annotated[list[ShapeKind], about(of=lambda fit: encode_exact(fit.measured))]
    unknowns: Annotated[list[UnknownKind], about(of=lambda fit: encode_exact(fit.unknowns))]
    winches: Annotated[
        WinchKind | UnsetType, about(of=lambda fit: encode_exact(fit.given_winches))
    ] = UNSET


_ASKED = ("given_arm", "given_scene", "measured", "unknowns", "given_winches")
_NOT_KEPT = (*_ASKED, "machine_code", "known")
_FIT = tuple(name for name in arguments(Fitted) if name not in _NOT_KEPT)
# Settings and results of the fit; calibrations are loaded from this record.
FitRecord: Any = struct(
    "FitRecord",
    [
        ("starts", list[exact(Start, placed=True)]),  # type: ignore[misc]
        ("orders", list[exact(Order, placed=True)] | UnsetType, UNSET),  # type: ignore[misc]
    ],
    base=exact(
        Fitted,
        placed=True,
        names=tuple(name for name in _FIT if name not in ("starts", "orders")),
    ),
)


def _scene_of(fit: Any) -> dict[str, Any]:
    table = fit.parameters.setting(fit.array).table
    return {key: table[key] for key in ("arm", "effects")}


def _winches_of(fit: Any) -> dict[str, Any]:
    return dict(fit.parameters.setting(fit.array).table["winches"])


_SCENE = Meta(description="arm and effects as in a scene file")


class CalibrationRecord(Record, kw_only=True):
    """A calibration, loaded from `question` and `fit`; other keys are derived."""

    schema: Annotated[Literal["octoplan calibration 1"], Schema]
    outcome: Annotated[str, about("the result, and how well the data determine the unknowns")]
    values: Annotated[list[ValueRecord], about(of=_values)]
    unidentified: Annotated[list[str], about(of=lambda fit: list(map(str, fit.unidentified)))]
    mean_error_m: float | None
    residuals: Annotated[
        list[ResidualRecord], about(of=lambda fit: records(ResidualRecord, fit.residuals))
    ]
    scene: Annotated[dict[str, Any], _SCENE, about(of=_scene_of)]
    winches: Annotated[dict[str, Any], about("zeros and stretch of the tendons", of=_winches_of)]
    question: Annotated[CalibrationQuestion, about(of=lambda fit: record(CalibrationQuestion, fit))]
    fit: Annotated[FitRecord, about(of=lambda fit: attributes_of(fit, _FIT))]


class DesignedRecord(msgspec.Struct):
    """Value of an unknown, in the unit of the key."""

    name: str
    value: float
    before: float


class DesignRecord(Record, kw_only=True):
    """A designed arm and the plans."""

    schema: Annotated[Literal["octoplan design 1"], Schema]
    outcome: str
    feasible: Annotated[bool, about("whether every plan is certified")]
    effort_N: Annotated[float, about("root of the sum of squared efforts")]
    objective: Annotated[
        str,
        about(
            "effort, Stiffest, Softest or Reach",
            lambda d: d.objective if d.objective == "effort" else type(d.objective).__name__,
        ),
    ]
    value: Annotated[float, about("of the objective: [N], [N/m] or [m]")]
    value_before: Annotated[float, about("of the objective for the given arm")]
    gain: Annotated[
        float | None, about("relative decrease of effort, or increase of stiffness or reach")
    ]
    values: Annotated[
        list[DesignedRecord],
        about(
            of=lambda d: [
                DesignedRecord(item.name, x, old)
                for item, x, old in zip(d.unknowns, d.values, d.parameters.start, strict=True)
            ]
        ),
    ]
    scene: Annotated[dict[str, Any], _SCENE, about(of=_scene_of)]
    plans: Annotated[
        list[PlanRecord], about(of=lambda design: list(map(plan_record, design.plans)))
    ]


def save_calibration(fit: Any, path: str | Path) -> Path:
    """Write the record of a Calibration to a .json file; see Calibration.save."""
    return write_named(path, ".json", to_json(record(CalibrationRecord, fit)))
