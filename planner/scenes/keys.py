"""What the keys of scene files may hold; ranges stand here, so that the schema tells them too."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Annotated, Any

import msgspec
import numpy as np
import scipy
from msgspec import Meta

from model import Linear, Sampled
from model.errors import InputError
from model.paths import Path
from model.units import warn_of_degrees

MM = 1e-3
G = 1e-3
_ROUNDED = 2e-3

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Accuracy = Annotated[float, Meta(ge=1e-12, le=0.1)]
Vector = tuple[float, float, float]
Tensions = list[list[float] | float]


class Table(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A table of a scene file; keys that it does not know are refused."""


class SamplesTable(Table, frozen=True):
    """A function of arc length by samples, at least four; a cubic spline passes through them."""

    s_mm: Annotated[list[float], Meta(min_length=4, description="arc lengths from the base [mm]")]
    values_mm: Annotated[list[float], Meta(min_length=4, description="the values there [mm]")]


class AngleSamplesTable(Table, frozen=True):
    """An angle as a function of arc length by samples, at least four; a cubic spline."""

    s_mm: Annotated[list[float], Meta(min_length=4, description="arc lengths from the base [mm]")]
    values_deg: Annotated[list[float], Meta(min_length=4, description="the angles there [deg]")]


class CurvatureSamplesTable(Table, frozen=True):
    """A curvature as a function of arc length by samples, at least four; a cubic spline."""

    s_mm: Annotated[list[float], Meta(min_length=4, description="arc lengths from the base [mm]")]
    values: Annotated[list[float], Meta(min_length=4, description="curvatures there [1/m]")]


PathKey = list[float] | SamplesTable
# Of all tendons of a section, or a list with one for each.
TendonPathsKey = list[float | list[float] | SamplesTable] | SamplesTable
TurnsKey = list[float | list[float] | AngleSamplesTable] | AngleSamplesTable
CurvatureKey = list[float] | CurvatureSamplesTable


class FrameTable(Table, frozen=True):
    """A frame by two of its columns (t, n, b); b is their cross product."""

    tangent: Annotated[Vector, Meta(description="t, along the arm")]
    normal: Annotated[Vector, Meta(description="n, across the arm; tendon 1 is on its side")]


def path(key: str, value: PathKey) -> Linear | Sampled:
    """Return the function of arc length of a key: [base, end], or samples."""
    if isinstance(value, SamplesTable):
        return Sampled(metres(value.s_mm), metres(value.values_mm))
    if not (isinstance(value, list) and len(value) == 2):
        raise InputError(key, value, "[base, end] or { s_mm = [...], values_mm = [...] }")
    return Linear(value[0] * MM, value[1] * MM)


def tendon_paths(key: str, value: TendonPathsKey) -> Path | tuple[Path, ...]:
    """Return the offset of all tendons of a section, or of each."""
    return _each(value, lambda own: path(key, own))


def turns(value: TurnsKey) -> Path | tuple[Path, ...]:
    """Return by what the angle of all tendons of a section turns, or that of each."""
    return _each(value, lambda own: turn("turn_deg", own))


def turn(key: str, value: list[float] | AngleSamplesTable) -> Linear | Sampled:
    """Return an angle as a function of arc length, given in degrees: [base, end], or samples."""
    if isinstance(value, AngleSamplesTable):
        return Sampled(metres(value.s_mm), tuple(map(radians, value.values_deg)))
    if not (isinstance(value, list) and len(value) == 2):
        raise InputError(key, value, "[base, end] or { s_mm = [...], values_deg = [...] }")
    return Linear(radians(value[0]), radians(value[1]))


def curvature(key: str, value: CurvatureKey) -> Linear | Sampled:
    """Return a curvature as a function of arc length: [base, tip], or samples."""
    if isinstance(value, CurvatureSamplesTable):
        return Sampled(metres(value.s_mm), tuple(value.values))
    if len(value) != 2:
        raise InputError(key, value, "[base, tip] or { s_mm = [...], values = [...] }")
    return Linear(value[0], value[1])


def _each(value: Any, one: Callable[[Any], Path]) -> Path | tuple[Path, ...]:
    """Return a path, or a tuple of them where a list holds lists or samples."""
    several = isinstance(value, list) and any(not isinstance(own, float | int) for own in value)
    return tuple(map(one, value)) if several else one(value)


@lru_cache(maxsize=64)
def frame(tangent: Vector, normal: Vector) -> tuple[tuple[float, ...], ...]:
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


def rotated(base: tuple[tuple[float, ...], ...], vector: Vector) -> tuple[tuple[float, ...], ...]:
    """Return a frame (3, 3) turned in itself by a rotation vector [deg]."""
    turn = scipy.spatial.transform.Rotation.from_rotvec(np.radians(vector)).as_matrix()
    return tuple(tuple(row) for row in (np.array(base) @ turn).tolist())


def metres(values: list[float] | Vector) -> tuple[float, ...]:
    """Return lengths in m, given in mm."""
    return tuple((np.array(values, dtype=float) * MM).tolist())


def mm(metres: Any) -> list[float]:
    """Return lengths in mm, given in m."""
    return [rounded(x / MM) for x in metres]


def rounded(value: float) -> float:
    """Return a number without what a change of units leaves in its last digit."""
    return float(f"{value:.15g}")


def radians(degrees: float) -> float:
    """Return an angle in rad, given in degrees; UnitWarning for what is likely in rad already."""
    warn_of_degrees(degrees)
    return float(np.radians(degrees))
