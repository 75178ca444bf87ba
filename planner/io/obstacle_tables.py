"""The obstacles of a scene file, one table each, told apart by their type."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, structs

import model.obstacles
from model.effects import Contact
from model.errors import InputError
from model.obstacles import Box, Mesh, Moving, Obstacle
from model.obstacles.base import Convex
from planner.io.annotations import choice, quantity
from planner.io.arm_tables import VECTOR, Numbers, frame, frame_form
from planner.io.codec import (
    READ,
    TABLES,
    WRITE,
    Form,
    Table,
    fields_of,
    in_si,
    struct,
    table,
    table_of,
    written,
)


def public(module: Any, kind: Any = object) -> list[Any]:
    """Return the classes that a package exports, of a kind but not that itself."""
    found = (getattr(module, name) for name in module.__all__)
    return [
        own for own in found if isinstance(own, type) and issubclass(own, kind) and own is not kind
    ]


def tag_of(kind: type) -> str:
    """Return by which type the tables of a class are told: tip-position of TipPosition."""
    return re.sub(r"(?<!^)(?=[A-Z])", "-", kind.__name__).lower()


def _vertices(given: list[Numbers] | None, position: Numbers, t: Numbers, n: Numbers) -> Any:
    axes, origin = np.array(frame(t, n)), np.array(in_si(position, "mm"))
    places = np.array(in_si(given or [], "mm")).reshape(-1, 3)
    return tuple(map(tuple, (places @ axes.T + origin).tolist()))


_EDGES = frame_form("along its first edge", "along its second edge", (1, 0, 0), (0, 1, 0))
_AXES = frame_form("its own x axis", "its own y axis", (1, 0, 0), (0, 1, 0))
_OWN_PLACES = quantity("along its own axes", "mm")
_VERTICES = Form(
    {
        "vertices_mm": (Annotated[list[VECTOR] | None, _OWN_PLACES], None),
        "position_mm": (Annotated[VECTOR, quantity("of its own origin", "mm")], (0, 0, 0)),
        **_AXES.keys,
    },
    _vertices,
    lambda own: {"vertices_mm": written(own, "mm")},
)
_FILE: dict[str, tuple[Any, Any]] = {
    "file": (
        Annotated[
            str | None,
            Meta(description=".stl, .obj, .ply or .off, from where the scene file is"),
        ],
        None,
    ),
    "unit": (Annotated[Literal["mm", "cm", "m", "in"], Meta(description="of the file")], "mm"),
}
_FORMS: dict[Any, dict[str, Any]] = {
    Box: {"frame": _EDGES},
    Mesh: {"vertices": _VERTICES, "more": _FILE},
}
_KINDS = public(model.obstacles, Obstacle)
_SHAPES = {kind: table(kind, tag=tag_of(kind), **_FORMS.get(kind, {})) for kind in _KINDS}


def inlined(given: Any, folder: Path) -> Any:
    """Return the table of an obstacle with the numbers of its file, looked for from a folder.

    Raises InputError for both or neither of them, FileError for a file that cannot be read.
    """
    if not isinstance(given, _SHAPES[Mesh]):
        return given
    mesh: Any = given
    numbers = (mesh.vertices_mm is not None, mesh.faces is not None)
    if numbers != ((mesh.file is None,) * 2):
        there = [key for key in ("file", "vertices_mm", "faces") if getattr(mesh, key) is not None]
        raise InputError("file", there, "a file, or vertices_mm and faces in its place")
    if mesh.file is None:
        return mesh
    found = Mesh.read(folder / mesh.file, mesh.unit)
    corners = [tuple(own) for own in written(found.vertices, "mm")]
    faces = [(a, b, c) for a, b, c in found.faces]
    return structs.replace(mesh, file=None, vertices_mm=corners, faces=faces)


def _with_key(
    shape: type[Table], prefix: str, key: str, held: tuple[Any, Any], read: Any
) -> type[Table]:
    """Return the table of an obstacle that has one key more, and how that is read with it."""
    name, tag = f"{prefix}{shape.__name__}", str(shape.__struct_config__.tag)
    made: type[Table] = struct(name, [(key, *held)], shape.__doc__, tag, shape)
    READ[made] = lambda given: read(READ[shape](given), getattr(given, key))
    return made


def _avoided(obstacle: Obstacle, rows: Any) -> Obstacle | Moving:
    if rows is None:
        return obstacle
    return Moving(obstacle, tuple(row[0] for row in rows), in_si([row[1:] for row in rows], "mm"))


_ROWS = "time [s] and how far it has moved by then along x, y, z [mm], row by row"
_PATH = (
    Annotated[tuple[tuple[float, float, float, float], ...] | None, Meta(description=_ROWS)],
    None,
)
_FRICTION = next(own[1:] for own in fields_of(Contact, {"obstacle"}))
_CONVEX = [_SHAPES[kind] for kind in _KINDS if issubclass(kind, Convex)]
# What is wrapped round or held; what is kept clear of, and may move in motions; what is leant on.
TABLES[Convex] = choice(_CONVEX)
ObstacleTable: Any = choice(
    [_with_key(own, "Avoided", "path_s_mm", _PATH, _avoided) for own in _SHAPES.values()]
)
TABLES[Contact] = choice(
    [_with_key(own, "Contact", "friction", _FRICTION, Contact) for own in _CONVEX]
)


def _moving(own: Moving) -> dict[str, Any]:
    rows = zip(own.times, written(own.path, "mm"), strict=True)
    return {**table_of(own.obstacle), "path_s_mm": [[t, *x] for t, x in rows]}


WRITE[Moving] = _moving
WRITE[Contact] = lambda own: {**table_of(own.obstacle), "friction": own.friction}
