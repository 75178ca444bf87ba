"""The arm of a scene file: one of the paper's, or one of your own."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

import msgspec
from msgspec import Meta

from model import Anchorage, Arm, InputError, Material, RestCurvature
from model.arm import PAPER_FRAME
from model.paths import Path
from planner.scenes.keys import (
    MM,
    CurvatureKey,
    FrameTable,
    PathKey,
    Positive,
    Table,
    TendonPathsKey,
    TurnsKey,
    Vector,
    curvature,
    frame,
    metres,
    path,
    radians,
    rotated,
    tendon_paths,
    turns,
)

Preset = Literal["table-2", "table-4", "section-5.1", "section-5.2"]


class SectionTable(Table, frozen=True):
    """An anchorage section, where tendons end; from the tip to the base."""

    at_mm: Annotated[Positive, Meta(description="arc length of the section from the base [mm]")]
    offset_mm: Annotated[
        TendonPathsKey,
        Meta(
            description="distance of the tendons from the midline [mm]: [base, anchorage], samples,"
            " or a list of such with one for each tendon"
        ),
    ]
    angles_deg: Annotated[
        tuple[float, ...],
        Meta(min_length=1, description="a tendon each: its side, from n towards b [deg]"),
    ] = (0.0, 90.0, 180.0, 270.0)
    turn_deg: Annotated[
        TurnsKey | None,
        Meta(
            description="what is added to the angles along the arm [deg]: [base, anchorage],"
            " samples, or a list of such with one for each tendon; with loads only"
        ),
    ] = None


class RestCurvatureTable(Table, frozen=True):
    """The curvature of the arm without tensions and loads; see model.RestCurvature."""

    n: Annotated[
        CurvatureKey, Meta(description="about n [1/m]: [base, tip], or samples; bends towards -b")
    ] = msgspec.field(default_factory=lambda: [0.0, 0.0])
    b: Annotated[
        CurvatureKey, Meta(description="about b [1/m]: [base, tip], or samples; bends towards n")
    ] = msgspec.field(default_factory=lambda: [0.0, 0.0])


class ArmTable(Table, frozen=True):
    """An arm: a preset, or length_mm, radius_mm and sections; the other keys go with either."""

    preset: Annotated[Preset | None, Meta(description="an arm of the paper")] = None
    length_mm: Annotated[Positive | None, Meta(description="length [mm]")] = None
    radius_mm: Annotated[
        PathKey | None, Meta(description="radius of the body [mm]: [base, tip], or samples")
    ] = None
    sections: Annotated[tuple[SectionTable, ...], Meta(description="from the tip to the base")] = ()
    E_kPa: Annotated[Positive, Meta(description="Young's modulus [kPa]")] = 110.0
    nu: Annotated[float, Meta(gt=-1, le=0.5, description="Poisson's ratio")] = 0.5
    density: Annotated[Positive, Meta(description="of the body [kg/m3]")] = 1080.0
    base_frame: Annotated[
        FrameTable | None, Meta(description="frame of the base; the paper's unless given")
    ] = None
    base_rotation_deg: Annotated[
        Vector,
        Meta(description="rotation vector about t, n, b by which the base is off base_frame [deg]"),
    ] = (0.0, 0.0, 0.0)
    base_position_mm: Annotated[Vector, Meta(description="of the base [mm]")] = (0.0, 0.0, 0.0)
    hull_mm: Annotated[
        PathKey | None,
        Meta(
            description="radius within which tendons run [mm], where discs hold them off the body"
        ),
    ] = None
    rest_curvature: RestCurvatureTable | None = None


def arm_of(table: ArmTable) -> Arm:
    """Return the arm of a table; raises InputError that names a key, or a field of Arm."""
    base: tuple[tuple[float, ...], ...] = PAPER_FRAME
    if table.base_frame is not None:
        base = frame(table.base_frame.tangent, table.base_frame.normal)
    if any(table.base_rotation_deg):
        base = rotated(base, table.base_rotation_deg)
    return Arm(
        *_shape(table),
        material=Material(table.E_kPa * 1e3, table.nu, table.density),
        base_frame=base,
        base_position=metres(table.base_position_mm),
        hull=None if table.hull_mm is None else path("hull_mm", table.hull_mm),
        rest_curvature=_rest(table.rest_curvature),
    )


def _rest(table: RestCurvatureTable | None) -> RestCurvature | None:
    if table is None:
        return None
    named = ((f"rest_curvature.{name}", getattr(table, name)) for name in ("n", "b"))
    return RestCurvature(*(curvature(name, own) for name, own in named))


def _shape(table: ArmTable) -> tuple[float, Path, tuple[Anchorage, ...]]:
    """Return length, radius and sections, of a preset or the table's own."""
    if table.preset is not None:
        if table.length_mm or table.radius_mm or table.sections:
            allowed = "either a preset, or length_mm, radius_mm and sections of an arm of your own"
            raise InputError("preset", table.preset, allowed)
        arm = Arm.from_paper(table.preset)
        return arm.length, arm.radius, arm.sections
    lacking = [key for key in ("length_mm", "radius_mm", "sections") if not getattr(table, key)]
    if table.length_mm is None or table.radius_mm is None or lacking:
        presets = ", ".join(get_args(Preset))
        allowed = f"a preset ({presets}), or length_mm, radius_mm and sections"
        raise InputError("arm", f"no {', no '.join(lacking)}", allowed)
    sections = tuple(
        Anchorage(
            s.at_mm * MM,
            tendon_paths("offset_mm", s.offset_mm),
            tuple(map(radians, s.angles_deg)),
            None if s.turn_deg is None else turns(s.turn_deg),
        )
        for s in table.sections
    )
    return table.length_mm * MM, path("radius_mm", table.radius_mm), sections
