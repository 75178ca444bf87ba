"""The obstacles of a scene file, one table each, told apart by their type."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Union

import msgspec
import numpy as np
from msgspec import Meta, structs

import model.obstacles
from model.effects import Contact
from model.errors import InputError
from model.obstacles import Box, Capsule, HalfSpace, Mesh, Moving, Obstacle, Sphere
from model.obstacles.base import Convex
from planner.io.arm_tables import FRAME, frame
from planner.io.codec import (
    Join,
    NotNegative,
    Positive,
    Table,
    Vector,
    check_all_written,
    kind_of,
    quantity,
    si,
    table_of,
    value_of,
    written,
    written_as,
    written_by,
)

Place = Annotated[Vector, quantity("in the base frame", "mm")]
Size = Annotated[Positive, quantity("", "mm")]


@written_as(Sphere)
class SphereTable(Table, tag="sphere", frozen=True):
    """See Sphere."""

    center_mm: Place
    radius_mm: Size


@written_as(Capsule)
class CapsuleTable(Table, tag="capsule", frozen=True):
    """See Capsule."""

    start_mm: Place
    end_mm: Place
    radius_mm: Size


@written_as(Box, frame=FRAME)
class BoxTable(Table, tag="box", frozen=True):
    """See Box; tangent, normal and their cross product are the directions of its edges."""

    center_mm: Place
    size_mm: Annotated[tuple[Positive, Positive, Positive], quantity("lengths of its edges", "mm")]
    tangent: Annotated[Vector, Meta(description="along its first edge, of length 1")] = (1, 0, 0)
    normal: Annotated[Vector, Meta(description="along its second edge, of length 1")] = (0, 1, 0)


@written_as(HalfSpace)
class HalfSpaceTable(Table, tag="half-space", frozen=True):
    """See HalfSpace."""

    point_mm: Place
    normal: Annotated[Vector, Meta(description="out of the body, of any length but 0")]


_PLACED = ("vertices_mm", "position_mm", "tangent", "normal")


def _vertices(given: list[Vector] | None, position: Vector, t: Vector, n: Vector) -> Any:
    axes, origin = np.array(frame(t, n)), np.array(si(position, "mm"))
    places = np.array(si(given or [], "mm")).reshape(-1, 3)
    return tuple(map(tuple, (places @ axes.T + origin).tolist()))


@written_as(
    Mesh,
    beside=("file", "unit"),
    vertices=Join(_PLACED, _vertices, lambda own: {"vertices_mm": written(own, "mm")}),
)
class MeshTable(Table, tag="mesh", frozen=True):
    """See Mesh; by a file, or by numbers. Its own axes are (tangent, normal, their product)."""

    file: Annotated[
        str | None, Meta(description=".stl, .obj, .ply or .off, from where the scene file is")
    ] = None
    unit: Annotated[Literal["mm", "cm", "m", "in"], Meta(description="of the file")] = "mm"
    position_mm: Annotated[Vector, quantity("of its own origin", "mm")] = (0, 0, 0)
    tangent: Annotated[Vector, Meta(description="its own x axis, of length 1")] = (1, 0, 0)
    normal: Annotated[Vector, Meta(description="its own y axis, of length 1")] = (0, 1, 0)
    vertices_mm: Annotated[list[Vector] | None, quantity("along its own axes", "mm")] = None
    faces: Annotated[
        list[tuple[int, int, int]] | None,
        Meta(description="corners of triangles, counter-clockwise from outside, from 0"),
    ] = None


def inlined(table: Table, folder: Path) -> Table:
    """Return the table of an obstacle with the numbers of its file, looked for from a folder.

    Raises InputError for both or neither of them, FileError for a file that cannot be read.
    """
    if not isinstance(table, MeshTable):
        return table
    numbers = (table.vertices_mm is not None, table.faces is not None)
    if numbers != ((table.file is None,) * 2):
        given = [key for key in ("file", "vertices_mm", "faces") if getattr(table, key) is not None]
        raise InputError("file", given, "a file, or vertices_mm and faces in its place")
    if table.file is None:
        return table
    found = Mesh.read(folder / table.file, table.unit)
    corners = [tuple(own) for own in written(found.vertices, "mm")]
    faces = [(a, b, c) for a, b, c in found.faces]
    return structs.replace(table, file=None, vertices_mm=corners, faces=faces)


_SHAPES: tuple[type[Table], ...] = (SphereTable, CapsuleTable, BoxTable, HalfSpaceTable, MeshTable)


def _with_key(table: type[Table], prefix: str, key: str, kind: Any, default: Any) -> type[Table]:
    """Return the table of an obstacle that has one key more."""
    made: Any = msgspec.defstruct(
        f"{prefix}{table.__name__}",
        [(key, kind, default)],
        bases=(table,),
        namespace={"__doc__": table.__doc__},
        module=__name__,
        tag=table.__struct_config__.tag,
        kw_only=True,
        frozen=True,
        forbid_unknown_fields=True,
    )
    found: type[Table] = made
    return found


_PATH_KEY = Annotated[
    tuple[tuple[float, float, float, float], ...] | None,
    Meta(description="time [s] and how far it has moved by then along x, y, z [mm], row by row"),
]
_FRICTION_KEY = Annotated[
    NotNegative, Meta(description="Coulomb's coefficient between arm and obstacle")
]


def _union(tables: list[type[Table]]) -> Any:
    return Union[tuple(tables)]  # noqa: UP007  (of types that are made here)


_CONVEX = [own for own in _SHAPES if issubclass(kind_of(own) or object, Convex)]
# What is wrapped round or held; what is kept clear of, and may move in motions; what is leant on.
ConvexTable: Any = _union(_CONVEX)
ObstacleTable: Any = _union(
    [_with_key(t, "Avoided", "path_s_mm", _PATH_KEY, None) for t in _SHAPES]
)
ContactTable: Any = _union(
    [_with_key(t, "Contact", "friction", _FRICTION_KEY, 0.0) for t in _CONVEX]
)


def obstacle_of(table: Any) -> Obstacle | Moving:
    """Return what is kept clear of, which may move; InputError that names a key, or a field."""
    obstacle: Obstacle = value_of(table)
    if table.path_s_mm is None:
        return obstacle
    times = tuple(row[0] for row in table.path_s_mm)
    return Moving(obstacle, times, tuple(si(row[1:], "mm") for row in table.path_s_mm))


def _moving(own: Moving) -> dict[str, Any]:
    rows = zip(own.times, written(own.path, "mm"), strict=True)
    return {**table_of(own.obstacle), "path_s_mm": [[t, *x] for t, x in rows]}


def contact_of(table: Any) -> Contact:
    """Return what the arm may lean on; InputError that names a key, or a field."""
    return Contact(value_of(table), table.friction)


def _contact(own: Contact) -> dict[str, Any]:
    return {**table_of(own.obstacle), "friction": own.friction}


written_by(Moving, _moving, "obstacle", "times", "path")
written_by(Contact, _contact, "obstacle", "friction")
_PUBLIC = (getattr(model.obstacles, name) for name in model.obstacles.__all__)
check_all_written(
    [own for own in _PUBLIC if isinstance(own, type) and own is not Obstacle], "obstacles"
)
