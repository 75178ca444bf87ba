"""A motion as a record."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from planner.files import versions
from planner.trajectory.result import Trajectory


class TrajectoryRecord(msgspec.Struct, kw_only=True):
    """Tensions over time, and what the check of them found."""

    schema: Annotated[Literal["octoplan trajectory 1"], Meta(description="what this is")]
    versions: Annotated[dict[str, str], Meta(description="of what computed it")]
    outcome: Annotated[str, Meta(description="what happened and what to try")]
    certified: bool
    duration_s: float
    times_s: Annotated[list[float], Meta(description="between which tensions change linearly")]
    tensions_N: Annotated[list[list[float]], Meta(description="at each time, in tendon order")]
    lengths_m: Annotated[list[list[float]], Meta(description="of the tendons, at each time")]
    tendons: Annotated[list[str], Meta(description="their names, in tendon order")]
    stops: Annotated[list[int], Meta(description="at which of the times each target is met")]
    reached: list[bool]
    certificate: dict[str, Any]


def trajectory_record(found: Trajectory) -> TrajectoryRecord:
    """Return the record of a motion."""
    certificate = {
        key: None if isinstance(own, float) and not np.isfinite(own) else own
        for key, own in asdict(found.certificate).items()
    }
    return TrajectoryRecord(
        schema="octoplan trajectory 1",
        versions=versions(),
        outcome=found.outcome,
        certified=found.certificate.passed,
        duration_s=found.duration,
        times_s=found.times.tolist(),
        tensions_N=found.flat.tolist(),
        lengths_m=found.lengths.tolist(),
        tendons=[found.arm.tendon_name(j) for j in range(found.arm.n_tendons)],
        stops=list(found.stops),
        reached=list(found.reached),
        certificate=certificate,
    )
