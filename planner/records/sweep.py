"""What became of a sweep, as a record; the numbers are in its Dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from planner.files import versions


class SweepRecord(msgspec.Struct, kw_only=True):
    """A sweep that is finished."""

    schema: Annotated[Literal["octoplan sweep 1"], Meta(description="what this is")]
    versions: Annotated[dict[str, str], Meta(description="of what computed it")]
    file: Annotated[str, Meta(description="where the Dataset is")]
    compute: Literal["settle", "plan", "stiffness"]
    dims: Annotated[dict[str, int], Meta(description="what points lie along, and how many there")]
    points: int
    met: Annotated[int, Meta(description="points that settled, or whose targets are reached")]
    failures: Annotated[dict[str, int], Meta(description="outcomes of the other points, counted")]


def sweep_record(data: Any, file: Path) -> SweepRecord:
    """Return the record of a sweep's Dataset; the most frequent failures first."""
    met = data["reached" if "reached" in data else "settled"].values.ravel()
    counts: dict[str, int] = {}
    for told in data["outcome"].values.ravel()[~met].tolist():
        counts[told] = counts.get(told, 0) + 1
    return SweepRecord(
        schema="octoplan sweep 1",
        versions=versions(),
        file=str(file),
        compute=data.attrs["compute"],
        dims={str(dim): data.sizes[dim] for dim in data["outcome"].dims},
        points=int(met.size),
        met=int(met.sum()),
        failures=dict(sorted(counts.items(), key=lambda item: -item[1])),
    )
