"""What became of a sweep, as a record; the numbers are in its Dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from planner.files import versions
from planner.sweeps.definition import Sweep
from planner.sweeps.sweep import Written


class SweepRecord(msgspec.Struct, kw_only=True):
    """A sweep that is finished."""

    schema: Annotated[Literal["octoplan sweep 1"], Meta(description="what this is")]
    versions: Annotated[dict[str, str], Meta(description="of what computed it")]
    file: Annotated[str, Meta(description="where the Dataset is")]
    compute: Literal["settle", "plan", "stiffness"]
    dims: Annotated[dict[str, int], Meta(description="what points lie along, and how many there")]
    points: int
    met: Annotated[int, Meta(description="points that settled, or whose targets are reached")]
    failures: Annotated[
        dict[str, int],
        Meta(description="outcomes of the others: one of each kind, that differ by numbers alone"),
    ]
    earlier: Annotated[bool, Meta(description="whether an earlier run had found it all")] = False


def sweep_record(asked: Sweep, found: Written, file: Path) -> SweepRecord:
    """Return the record of a sweep that is written to a file."""
    return SweepRecord(
        schema="octoplan sweep 1",
        versions=versions(),
        file=str(file),
        compute=asked.compute,
        dims=asked.dims,
        points=asked.size,
        met=found.met,
        failures=found.failures,
        earlier=found.earlier,
    )
