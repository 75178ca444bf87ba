"""A calibration as a record: what people and machines read of it, and all that loads it."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from planner.files import versions
from planner.records.values import Number, number, plain


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
    miss: list[float]


class FitRecord(msgspec.Struct, kw_only=True):
    """How residuals were counted and what was found; the values are loaded from here."""

    values: list[float]
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


class CalibrationRecord(msgspec.Struct, kw_only=True):
    """A calibration; `question` and `fit` are what it is loaded from, the rest is derived."""

    schema: Annotated[Literal["octoplan calibration 1"], Meta(description="what this is")]
    versions: Annotated[dict[str, str], Meta(description="of what computed it")]
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
    stds = of.std.tolist()
    rows = zip(of.unknowns, of.values, stds, strict=True)
    table = of.parameters.table_at(of.array, "")
    return CalibrationRecord(
        schema="octoplan calibration 1",
        versions=versions(),
        outcome=of.outcome,
        values=[
            ValueRecord(name=own.name, value=value, std=number(std), unit=of.parameters.unit(own))
            for own, value, std in rows
        ],
        unidentified=[str(own) for own in of.unidentified],
        mean_error_m=of.mean_error if of.mean_error == of.mean_error else None,
        residuals=[
            ResidualRecord(shape=own.shape, what=own.what, miss=list(own.miss))
            for own in of.residuals
        ],
        scene={key: table[key] for key in ("arm", "effects")},
        question={
            "arm": plain(of.given_arm),
            "scene": plain(of.given_scene),
            "measured": [asdict(shape) for shape in of.measured],
            "unknowns": [asdict(own) for own in of.unknowns],
        },
        fit=FitRecord(
            values=list(of.values),
            noise=of.noise,
            loss=of.weights.loss,
            absolute_std=of.weights.absolute,
            refinement=of.refinement,
            stages=of.stages,
            left_out=[list(row) for row in of.left_out],
            stopped=of.stopped,
            error=of.error,
            starts=[{**start._asdict(), "misfit": number(start.misfit)} for start in of.starts],
            astray=list(of.astray),
        ),
    )
