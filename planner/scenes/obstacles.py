"""The obstacles of a scene file, one table each, told apart by their type."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, structs

from model.errors import InputError
from model.obstacles import Box, Capsule, HalfSpace, Mesh, Moving, Obstacle, Sphere
from model.obstacles.base import Convex
from planner.scenes.keys import Positive, Table, Vector, frame, metres, mm

Place = Annotated[Vector, Meta(description="in the base frame [mm]")]
Size = Annotated[Positive, Meta(description="[mm]")]


class Moved(Table, frozen=True, kw_only=True):
    """An obstacle that may move, in motions."""

    path_s_mm: Annotated[
        tuple[tuple[float, float, float, float], ...] | None,
        Meta(
            description="time [s] and how far it has moved by then along x, y, z [mm], row by row"
        ),
    ] = None


class SphereTable(Moved, tag="sphere", frozen=True):
    """See Sphere."""

    center_mm: Place
    radius_mm: Size


class CapsuleTable(Moved, tag="capsule", frozen=True):
    """See Capsule."""

    start_mm: Place
    end_mm: Place
    radius_mm: Size


class BoxTable(Moved, tag="box", frozen=True):
    """See Box; tangent, normal and their cross product are the directions of its edges."""

    center_mm: Place
    size_mm: Annotated[tuple[Size, Size, Size], Meta(description="lengths of its edges [mm]")]
    tangent: Annotated[Vector, Meta(description="along its first edge, of length 1")] = (1, 0, 0)
    normal: Annotated[Vector, Meta(description="along its second edge, of length 1")] = (0, 1, 0)


class HalfSpaceTable(Moved, tag="half-space", frozen=True):
    """See HalfSpace."""

    point_mm: Place
    normal: Annotated[Vector, Meta(description="out of the body, of any length but 0")]


class MeshTable(Moved, tag="mesh", frozen=True):
    """See Mesh; by a file, or by numbers. The file's axes are (tangent, normal, their product)."""

    file: Annotated[
        str | None, Meta(description=".stl, .obj, .ply or .off, from where the scene file is")
    ] = None
    unit: Annotated[Literal["mm", "cm", "m", "in"], Meta(description="of the file")] = "mm"
    position_mm: Annotated[Vector, Meta(description="of the file's origin [mm]")] = (0, 0, 0)
    tangent: Annotated[Vector, Meta(description="the file's x axis, of length 1")] = (1, 0, 0)
    normal: Annotated[Vector, Meta(description="the file's y axis, of length 1")] = (0, 1, 0)
    vertices_mm: Annotated[list[Vector] | None, Meta(description="in the base frame [mm]")] = None
    faces: Annotated[
        list[tuple[int, int, int]] | None,
        Meta(description="corners of triangles, counter-clockwise from outside, from 0"),
    ] = None


ObstacleTable = SphereTable | CapsuleTable | BoxTable | HalfSpaceTable | MeshTable


def in_time(table: ObstacleTable, folder: Path) -> Obstacle | Moving:
    """Return the obstacle of a table, which may move; raises InputError, see obstacle_of.

    Files of meshes are looked for from a folder.
    """
    rests = structs.replace(table, path_s_mm=None)
    obstacle: Obstacle = (
        _mesh(rests, folder) if isinstance(rests, MeshTable) else obstacle_of(rests)
    )
    if table.path_s_mm is None:
        return obstacle
    times = tuple(row[0] for row in table.path_s_mm)
    return Moving(obstacle, times, tuple(metres(row[1:]) for row in table.path_s_mm))


def obstacle_of(table: ObstacleTable) -> Convex:
    """Return the convex obstacle of a table; raises InputError that names a key, or a field."""
    if table.path_s_mm is not None:
        raise InputError("path_s_mm", table.path_s_mm, "none here: what is leant on rests")
    match table:
        case SphereTable():
            return Sphere(metres(table.center_mm), *metres([table.radius_mm]))
        case CapsuleTable():
            ends = (metres(table.start_mm), metres(table.end_mm))
            return Capsule(*ends, *metres([table.radius_mm]))
        case BoxTable():
            edges = frame(table.tangent, table.normal)
            return Box(metres(table.center_mm), metres(table.size_mm), edges)
        case HalfSpaceTable():
            return HalfSpace(metres(table.point_mm), table.normal)
        case MeshTable():
            raise InputError("type", "mesh", "a convex obstacle here: the others")


def _mesh(table: MeshTable, folder: Path) -> Mesh:
    if (table.file is None) == (table.vertices_mm is None) or (
        (table.vertices_mm is None) != (table.faces is None)
    ):
        given = [key for key in ("file", "vertices_mm", "faces") if getattr(table, key) is not None]
        raise InputError("file", given, "a file, or vertices_mm and faces in its place")
    if table.file is not None:
        at = metres(table.position_mm), frame(table.tangent, table.normal)
        return Mesh.read(folder / table.file, table.unit, *at)
    corners = tuple(metres(own) for own in table.vertices_mm or ())
    return Mesh(corners, tuple(table.faces or ()))


def obstacle_table(obstacle: Obstacle | Moving) -> dict[str, Any]:
    """Return the table that is read as an obstacle; InputError for a kind without keys."""
    match obstacle:
        case Moving():
            rows = [[t, *mm(x)] for t, x in zip(obstacle.times, obstacle.path, strict=True)]
            return {**obstacle_table(obstacle.obstacle), "path_s_mm": rows}
        case Sphere():
            return {"type": "sphere", "center_mm": mm(obstacle.center), **_radius(obstacle)}
        case Capsule():
            ends = {"start_mm": mm(obstacle.start), "end_mm": mm(obstacle.end)}
            return {"type": "capsule", **ends, **_radius(obstacle)}
        case Box():
            sizes = {"center_mm": mm(obstacle.center), "size_mm": mm(obstacle.size)}
            t, n, _ = np.array(obstacle.frame).T.tolist()
            return {"type": "box", **sizes, "tangent": t, "normal": n}
        case HalfSpace():
            normal = list(obstacle.normal)
            return {"type": "half-space", "point_mm": mm(obstacle.point), "normal": normal}
        case Mesh():
            corners = [mm(own) for own in obstacle.vertices]
            return {
                "type": "mesh",
                "vertices_mm": corners,
                "faces": list(map(list, obstacle.faces)),
            }
    raise InputError("obstacle", obstacle, "one of model.obstacles: others have no keys")


def _radius(obstacle: Sphere | Capsule) -> dict[str, float]:
    return {"radius_mm": mm([obstacle.radius])[0]}
