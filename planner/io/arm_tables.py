"""The arm of a scene file: one of the paper's, or one of your own."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from scipy.spatial.transform import Rotation

from model.anchorage import Anchorage, Material, RestCurvature
from model.arm import PAPER_ARMS, PAPER_FRAME, Arm
from model.errors import InputError
from model.quantities import Vector
from planner.io.annotations import arguments, hints_of, quantity, suffix, unit_of_type
from planner.io.codec import READ, Form, arguments_of, read, table_of
from planner.io.tables import TABLES, fields_of, struct, table, type_in_file

Frame = tuple[tuple[float, ...], ...]
Numbers = tuple[float, ...]
# Vectors of frames may be rounded to three digits.
_ROUNDED = 2e-3
VECTOR: Any = type_in_file(Vector)


@lru_cache(maxsize=64)
def frame(tangent: Numbers, normal: Numbers) -> Frame:
    """Return the frame (3, 3), columns t, n and t x n, row by row.

    Vectors may be rounded to three digits; InputError for what is not orthonormal then.
    """
    t, n = np.array(tangent), np.array(normal)
    for key, vector in (("tangent", t), ("normal", n)):
        if not abs(np.linalg.norm(vector) - 1) < _ROUNDED:
            raise InputError(key, vector.tolist(), "a vector of length 1")
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


def frame_form(tangent: str, normal: str, *default: Numbers) -> Form:
    """Return how a frame is written: by two of its columns (t, n, b), told what they are."""
    about = {"tangent": tangent, "normal": normal}
    keys: dict[str, Any] = {
        key: (Annotated[VECTOR, Meta(description=f"{item}, of length 1")], *default[i : i + 1])
        for i, (key, item) in enumerate(about.items())
    }
    return Form(keys, frame, columns_of)


_COLUMNS = frame_form("t, along the arm", "n, across the arm and towards tendon 1")
FrameTable: Any = struct(
    "FrameTable",
    [(key, *held) for key, held in _COLUMNS.keys.items()],
    "A frame by two of its columns (t, n, b); b is their cross product.",
)


def _base(value: Any, rotation_deg: Numbers) -> Frame:
    base: Frame = PAPER_FRAME if value is None else frame(value.tangent, value.normal)
    if not any(rotation_deg):
        return base
    rotated = np.array(base) @ Rotation.from_rotvec(np.radians(rotation_deg)).as_matrix()
    return tuple(tuple(row) for row in rotated.tolist())


_ROTATION = quantity("rotation vector about t, n, b by which the base is off base_frame", "deg")
_BASE = Form(
    {
        "base_frame": (
            Annotated[
                FrameTable | None, Meta(description="frame of the base; the paper's unless given")
            ],
            None,
        ),
        "base_rotation_deg": (Annotated[VECTOR, _ROTATION], (0.0, 0.0, 0.0)),
    },
    _base,
    lambda item: {"base_frame": columns_of(item)},
)


def _inline(kind: Any) -> Form:
    """Return how an argument is written whose own arguments are keys beside those of the others."""
    keys = {
        name + suffix(unit_of_type(type_)): (type_, default)
        for name, type_, default in fields_of(kind, {})
    }
    hints = [hints_of(kind)[name] for name in arguments(kind)]
    table(kind)
    return Form(keys, lambda *each: kind(*map(read, hints, each)), table_of)


Preset: Any = Literal[tuple(PAPER_ARMS)]
TABLES[RestCurvature], TABLES[Anchorage] = table(RestCurvature), table(Anchorage)
ArmTable: Any = table(
    Arm,
    more={
        "preset": (
            Annotated[
                Preset | None,
                Meta(
                    description="an arm of the paper, in place of length_mm, radius_mm and sections"
                ),
            ],
            None,
        )
    },
    material=_inline(Material),
    base_frame=_BASE,
)


def arm_of(argument: Any) -> Arm:
    """Return the arm of a table; raises InputError that names a key, or a field of Arm."""
    required = {key: getattr(argument, key) for key in ("length_mm", "radius_mm", "sections")}
    missing = [key for key, value in required.items() if not value]
    if argument.preset is not None and len(missing) < len(required):
        allowed = "either a preset, or length_mm, radius_mm and sections of an arm of your own"
        raise InputError("preset", argument.preset, allowed)
    if argument.preset is None and missing:
        allowed = f"a preset ({', '.join(PAPER_ARMS)}), or length_mm, radius_mm and sections"
        raise InputError("arm", f"no {', no '.join(missing)}", allowed)
    result = arguments_of(argument)
    if argument.preset is not None:
        like = Arm.from_paper(argument.preset)
        result |= {"length": like.length, "radius": like.radius, "sections": like.sections}
    return Arm(**result)


READ[ArmTable] = arm_of
