"""What the keys of scene files may hold; ranges stand here, so that the schema tells them too."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta
from scipy.spatial.transform import Rotation

from model import Linear, Sampled
from model.errors import InputError

MM = 1e-3
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


PathKey = list[float] | SamplesTable


class FrameTable(Table, frozen=True):
    """A frame by two of its columns (t, n, b); b is their cross product."""

    tangent: Annotated[Vector, Meta(description="t, along the arm")]
    normal: Annotated[Vector, Meta(description="n, across the arm; tendon 1 is on its side")]


def path(key: str, value: PathKey) -> Linear | Sampled:
    """Return the function of arc length of a key: [base, end], or samples."""
    if isinstance(value, SamplesTable):
        return Sampled(metres(value.s_mm), metres(value.values_mm))
    if len(value) != 2:
        raise InputError(key, value, "[base, end] or { s_mm = [...], values_mm = [...] }")
    return Linear(value[0] * MM, value[1] * MM)


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
    turn = Rotation.from_rotvec(np.radians(vector)).as_matrix()
    return tuple(tuple(row) for row in (np.array(base) @ turn).tolist())


def metres(values: list[float] | Vector) -> tuple[float, ...]:
    """Return lengths in m, given in mm."""
    return tuple((np.array(values, dtype=float) * MM).tolist())


def radians(degrees: float) -> float:
    """Return an angle in rad, given in degrees."""
    return float(np.radians(degrees))
