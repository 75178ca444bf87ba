"""A design as a record."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from planner.files import versions
from planner.records.plan import PlanRecord, plan_record


class DesignedRecord(msgspec.Struct, kw_only=True):
    """An unknown's value, in the unit of its key."""

    name: str
    value: float
    before: float


class DesignRecord(msgspec.Struct, kw_only=True):
    """A designed arm and its plans."""

    schema: Annotated[Literal["octoplan design 1"], Meta(description="what this is")]
    versions: Annotated[dict[str, str], Meta(description="of what computed it")]
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
    table = of.parameters.table_at(of.array, "")
    rows = zip(of.unknowns, of.values, of.parameters.start.tolist(), strict=True)
    return DesignRecord(
        schema="octoplan design 1",
        versions=versions(),
        outcome=of.outcome,
        feasible=of.feasible,
        effort_N=of.effort,
        objective="effort" if of.objective == "effort" else type(of.objective).__name__,
        value=of.value,
        value_before=of.value_before,
        gain=of.gain if of.gain == of.gain else None,
        values=[DesignedRecord(name=own.name, value=x, before=old) for own, x, old in rows],
        scene={key: table[key] for key in ("arm", "effects")},
        plans=[plan_record(own) for own in of.plans],
    )
