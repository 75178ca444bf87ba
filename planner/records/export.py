"""What was exported, as a record."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from model.shape import Shape
from planner.c_code.export import Exported
from planner.files import versions


class ExportRecord(msgspec.Struct, kw_only=True):
    """The files of an exported map or arm, and how large and how good it is."""

    schema: Annotated[Literal["octoplan export 1"], Meta(description="what this is")]
    versions: Annotated[dict[str, str], Meta(description="of what computed it")]
    files: list[str]
    nodes: Annotated[int, Meta(description="at which a map gives the pose, or of the shape's mesh")]
    error: Annotated[float, Meta(description="estimated tip error over arm length")]
    static_bytes: Annotated[int, Meta(description="of work arrays of C; 0 of other files")]


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


def shape_export_record(files: tuple[Path, ...], shape: Shape) -> ExportRecord:
    """Return the record of a settled arm that is written for other programs."""
    return ExportRecord(
        schema="octoplan export 1",
        versions=versions(),
        files=[str(file) for file in files],
        nodes=shape.s.size,
        error=shape.error,
        static_bytes=0,
    )
