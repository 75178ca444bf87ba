"""The arm of a scene file: one of the paper's, or one of your own."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Any, Literal, get_args

import msgspec
import numpy as np
from msgspec import Meta
from scipy.spatial.transform import Rotation

from model.anchorage import Anchorage
from model.arm import PAPER_FRAME, Arm
from model.errors import InputError
from model.material import Material
from model.presets import PAPER_ARMS
from model.rest_curvature import RestCurvature
from planner.io.codec import (
    AngleSamples,
    CurvatureSamples,
    Join,
    LengthSamples,
    Positive,
    Table,
    Vector,
    arguments_of,
    number_in,
    quantity,
    si,
    value_of,
    written_as,
)

Frame = tuple[tuple[float, ...], ...]
# Vectors of frames may be rounded to three digits.
_ROUNDED = 2e-3
Preset = Literal["table-2", "table-4", "section-5.1", "section-5.2"]
PathKey = list[float] | LengthSamples
# Of all tendons of a section, or a list with one for each.
_OffsetKey = list[float | list[float] | LengthSamples] | LengthSamples
_TurnKey = list[float | list[float] | AngleSamples] | AngleSamples
_CurvatureKey = list[float] | CurvatureSamples


class FrameTable(Table, frozen=True):
    """A frame by two of its columns (t, n, b); b is their cross product."""

    tangent: Annotated[Vector, Meta(description="t, along the arm")]
    normal: Annotated[Vector, Meta(description="n, across the arm; tendon 1 is on its side")]


@lru_cache(maxsize=64)
def frame(tangent: Vector, normal: Vector) -> Frame:
    """Return the frame (3, 3), columns t, n and t x n, row by row.

    Vectors may be rounded to three digits; InputError for what is not orthonormal then.
    """
    t, n = np.array(tangent), np.array(normal)
    for key, given in (("tangent", t), ("normal", n)):
        if not abs(np.linalg.norm(given) - 1) < _ROUNDED:
            raise InputError(key, given.tolist(), "a vector of length 1")
    if not abs(t @ n) < _ROUNDED:
        raise InputError("normal", n.tolist(), f"a vector at right angles to {t.tolist()}, tangent")
    t = t / np.linalg.norm(t)
    n = n - (t @ n) * t
    n = n / np.linalg.norm(n)
    columns = np.column_stack([t, n, np.cross(t, n)])
    return tuple(tuple(row) for row in columns.tolist())


def columns_of(matrix: Frame) -> dict[str, Any]:
    """Return the keys of a frame: its first two columns."""
    t, n, _ = np.array(matrix).T.tolist()
    return {"tangent": t, "normal": n}


FRAME = Join(("tangent", "normal"), frame, columns_of)


@written_as(RestCurvature)
class RestCurvatureTable(Table, frozen=True):
    """The curvature of the arm without tensions and loads; see model.RestCurvature."""

    n: Annotated[
        _CurvatureKey,
        quantity("about n: [base, tip], or samples; bends towards -b", "1/m", path=True),
    ] = msgspec.field(default_factory=lambda: [0.0, 0.0])
    b: Annotated[
        _CurvatureKey,
        quantity("about b: [base, tip], or samples; bends towards n", "1/m", path=True),
    ] = msgspec.field(default_factory=lambda: [0.0, 0.0])


@written_as(Anchorage)
class SectionTable(Table, frozen=True):
    """An anchorage section, where tendons end; from the tip to the base."""

    at_mm: Annotated[Positive, quantity("arc length of the section from the base", "mm")]
    offset_mm: Annotated[
        _OffsetKey,
        quantity(
            "distance of the tendons from the midline: [base, anchorage], samples, or a list of "
            "such with one for each tendon",
            "mm",
            path=True,
        ),
    ]
    angles_deg: Annotated[
        tuple[float, ...],
        quantity("a tendon each: its side, from n towards b", "deg", min_length=1),
    ] = (0.0, 90.0, 180.0, 270.0)
    turn_deg: Annotated[
        _TurnKey | None,
        quantity(
            "what is added to the angles along the arm: [base, anchorage], samples, or a list of "
            "such with one for each tendon; with loads only",
            "deg",
            path=True,
        ),
    ] = None


def _material(E_kPa: float, nu: float, density: float) -> Material:
    return Material(si(E_kPa, "kPa"), nu, density)


def _material_keys(own: Material) -> dict[str, Any]:
    return {"E_kPa": number_in(own.E, "kPa"), "nu": own.nu, "density": own.density}


def _base(given: FrameTable | None, rotation_deg: Vector) -> Frame:
    base: Frame = PAPER_FRAME if given is None else frame(given.tangent, given.normal)
    if not any(rotation_deg):
        return base
    rotated = np.array(base) @ Rotation.from_rotvec(np.radians(rotation_deg)).as_matrix()
    return tuple(tuple(row) for row in rotated.tolist())


@written_as(
    Arm,
    beside=("preset",),
    material=Join(("E_kPa", "nu", "density"), _material, _material_keys),
    base_frame=Join(
        ("base_frame", "base_rotation_deg"), _base, lambda own: {"base_frame": columns_of(own)}
    ),
)
class ArmTable(Table, frozen=True):
    """An arm: a preset, or length_mm, radius_mm and sections; the other keys go with either."""

    preset: Annotated[Preset | None, Meta(description="an arm of the paper")] = None
    length_mm: Annotated[Positive | None, quantity("length", "mm")] = None
    radius_mm: Annotated[
        PathKey | None,
        quantity("radius of the body: [base, tip], or samples", "mm", path=True),
    ] = None
    sections: Annotated[tuple[SectionTable, ...], Meta(description="from the tip to the base")] = ()
    E_kPa: Annotated[Positive, quantity("Young's modulus", "kPa")] = 110.0
    nu: Annotated[float, quantity("Poisson's ratio", gt=-1, le=0.5)] = 0.5
    density: Annotated[Positive, quantity("of the body", "kg/m3")] = 1080.0
    base_frame: Annotated[
        FrameTable | None, Meta(description="frame of the base; the paper's unless given")
    ] = None
    base_rotation_deg: Annotated[
        Vector,
        quantity("rotation vector about t, n, b by which the base is off base_frame", "deg"),
    ] = (0.0, 0.0, 0.0)
    base_position_mm: Annotated[Vector, quantity("of the base", "mm")] = (0.0, 0.0, 0.0)
    hull_mm: Annotated[
        PathKey | None,
        quantity(
            "radius within which tendons run, where discs hold them off the body", "mm", path=True
        ),
    ] = None
    rest_curvature: RestCurvatureTable | None = None


def arm_of(table: ArmTable) -> Arm:
    """Return the arm of a table; raises InputError that names a key, or a field of Arm."""
    own = ("length_mm", "radius_mm", "sections")
    if table.preset is None:
        lacking = [key for key in own if not getattr(table, key)]
        if lacking:
            allowed = f"a preset ({', '.join(get_args(Preset))}), or length_mm, radius_mm and "
            raise InputError("arm", f"no {', no '.join(lacking)}", f"{allowed}sections")
        arm: Arm = value_of(table)
        return arm
    if any(getattr(table, key) for key in own):
        allowed = "either a preset, or length_mm, radius_mm and sections of an arm of your own"
        raise InputError("preset", table.preset, allowed)
    like = Arm.from_paper(table.preset)
    given = {"length": like.length, "radius": like.radius, "sections": like.sections}
    return Arm(**arguments_of(table) | given)


if set(get_args(Preset)) != set(PAPER_ARMS):
    raise TypeError(
        f"presets of scene files are not the arms of the paper: {', '.join(PAPER_ARMS)}"
    )
