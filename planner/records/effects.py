"""What each effect does to a scene and costs, as a record."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from planner.effect_ablation import Switch
from planner.files import versions
from planner.problem_size import ProblemSize


class EffectRecord(msgspec.Struct, kw_only=True):
    """One effect, and the scene with and without it; null where one of the two does not settle."""

    effect: Annotated[str, Meta(description="its name, with what had to be switched along")]
    enabled: Annotated[bool, Meta(description="whether the scene has it")]
    tip_change: Annotated[float | None, Meta(description="over arm length")]
    sizes: ProblemSize
    sizes_without: ProblemSize
    time_factor: Annotated[float | None, Meta(description="of a settle, with over without")]
    matters: bool
    problem: Annotated[str, Meta(description="why one does not settle, if so")]


class EffectsRecord(msgspec.Struct, kw_only=True):
    """What each effect does and costs: the scene's own, then others."""

    schema: Annotated[Literal["octoplan effects 1"], Meta(description="what this is")]
    versions: Annotated[dict[str, str], Meta(description="of what computed it")]
    accuracy: Annotated[float, Meta(description="tip change over arm length that matters")]
    effects: list[EffectRecord]


def effects_record(switches: tuple[Switch, ...], accuracy: float) -> EffectsRecord:
    """Return the record of a scene's switched effects."""
    rows = [_row(switch) for switch in switches]
    return EffectsRecord(
        schema="octoplan effects 1", versions=versions(), accuracy=accuracy, effects=rows
    )


def _row(switch: Switch) -> EffectRecord:
    settled = not switch.problem
    return EffectRecord(
        effect=switch.effect,
        enabled=switch.enabled,
        tip_change=switch.tip_change if settled else None,
        sizes=switch.sizes,
        sizes_without=switch.sizes_without,
        time_factor=switch.time_factor if settled else None,
        matters=bool(switch.matters),
        problem=switch.problem,
    )
