"""How a settled shape answers to forces, as a record."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from model.stiffness import Stiffness
from planner.files import versions

_POINTS = 21


class StiffnessRecord(msgspec.Struct, kw_only=True):
    """The compliance of a settled shape at a point, and the stiffness of its sections."""

    schema: Annotated[Literal["octoplan stiffness 1"], Meta(description="what this is")]
    versions: Annotated[dict[str, str], Meta(description="of what computed it")]
    tensions_N: Annotated[Any, Meta(description="a row a section, tip first, or flat")]
    tendon_lengths_m: Annotated[list[float], Meta(description="in tendon order")]
    tip_m: list[float]
    hold: Annotated[Literal["tension", "length"], Meta(description="what holds the tendons")]
    at_m: Annotated[float, Meta(description="arc length of the point")]
    position_m: Annotated[list[float], Meta(description="of the point, base frame")]
    compliance: Annotated[
        list[list[float]],
        Meta(description="[displacement m; rotation rad] per [force N; moment N m], base frame"),
    ]
    half_axes_m_per_N: Annotated[list[float], Meta(description="of displacements, softest first")]
    directions: Annotated[list[list[float]], Meta(description="of the half axes, as columns")]
    tension_response: Annotated[
        list[list[float]], Meta(description="of each tendon per force and moment")
    ]
    locked: Annotated[list[str], Meta(description="tendons whose length is held")]
    slack: Annotated[list[str], Meta(description="tendons without tension")]
    stable: Annotated[bool, Meta(description="at held tensions")]
    error: Annotated[float, Meta(description="estimated relative error of the compliance")]
    s_m: list[float]
    section_N_m2: Annotated[
        list[list[float]], Meta(description="flexural stiffness about n and b at s_m")
    ]


def stiffness_record(k: Stiffness) -> StiffnessRecord:
    """Return the record of a stiffness."""
    shape, arm = k.shape, k.shape.arm
    s = np.linspace(0.0, arm.length, _POINTS)
    axes, directions = k.ellipsoid()
    return StiffnessRecord(
        schema="octoplan stiffness 1",
        versions=versions(),
        tensions_N=arm.by_section(shape.tensions).tolist(),
        tendon_lengths_m=shape.tendon_lengths.tolist(),
        tip_m=shape.tip.tolist(),
        hold=k.hold,
        at_m=float(k.at),
        position_m=shape.position(k.at).tolist(),
        compliance=k.compliance.tolist(),
        half_axes_m_per_N=axes.tolist(),
        directions=directions.tolist(),
        tension_response=k.tension_response.tolist(),
        locked=[arm.tendon_name(j) for j in k.locked],
        slack=list(k.slack),
        stable=bool(k.stable),
        error=float(k.error),
        s_m=s.tolist(),
        section_N_m2=k.section(s).tolist(),
    )
