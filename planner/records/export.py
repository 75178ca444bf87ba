"""What was exported as C, as a record."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from planner.c_code.export import Exported
from planner.files import versions


class ExportRecord(msgspec.Struct, kw_only=True):
    """The files of an exported map, and how large and how good it is."""

    schema: Annotated[Literal["octoplan export 1"], Meta(description="what this is")]
    versions: Annotated[dict[str, str], Meta(description="of what computed it")]
    files: list[str]
    nodes: Annotated[int, Meta(description="at which the map gives the pose")]
    error: Annotated[float, Meta(description="estimated tip error over arm length")]
    static_bytes: Annotated[int, Meta(description="of work arrays")]


def export_record(found: Exported) -> ExportRecord:
    """Return the record of an export."""
    return ExportRecord(
        schema="octoplan export 1",
        versions=versions(),
        files=[str(file) for file in found.files],
        nodes=found.shape.s.size,
        error=found.shape.error,
        static_bytes=found.static_bytes,
    )
