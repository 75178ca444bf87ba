"""Obstacle of any shape: a closed surface of triangles."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from octoplan.model.extensions.obstacles.base import ALONG_BASE, Obstacle, axes_with, rounded
from octoplan.model.extensions.obstacles.triangles import Triangles, check_closed, volume
from octoplan.model.paths import Array
from octoplan.model.support.checks import LARGEST, finite_array, orthonormal
from octoplan.model.support.errors import FileError, InputError, needed
from octoplan.model.support.units import WIDTH, warn_unusual
from octoplan.model.support.value import Corners, Vector, value

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}


@value(repr=False)
class Mesh(Obstacle):
    """A body with a closed surface of triangles; the body need not be convex.

    Intersections of triangles are not checked. libigl evaluates the distance (install the extra
    `mesh`). The distance is differentiable except at points with two nearest surface points.

    Attributes
    ----------
    vertices : (N, 3)
        In the base frame [m].
    faces : (M, 3)
        Indices of each triangle's vertices from 0, counter-clockwise seen from outside.
    """

    vertices: tuple[Vector, ...]
    faces: Annotated[tuple[Corners, ...], Meta(min_length=4)]

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices)
        faces = np.array(self.faces)
        if faces.min() < 0 or faces.max() >= len(vertices):
            worst = faces.flat[np.abs(faces - (len(vertices) - 1) / 2).argmax()]
            message = f"numbers of vertices, from 0 to {len(vertices) - 1}"
            raise InputError("Mesh.faces", int(worst), message)
        check_closed(vertices, faces)
        warn_unusual("the mesh", [float(np.ptp(vertices, axis=0).max())], WIDTH)

    @classmethod
    def read(
        cls, path: str | Path, unit: str, position: Any = (0, 0, 0), frame: Any = ALONG_BASE
    ) -> Mesh:
        """Read a mesh from a .stl, .obj, .ply or .off file, and merge equal vertices.

        Parameters
        ----------
        path : str or Path
        unit : "m", "cm", "mm" or "in"
            Unit of the coordinates; the files have no unit.
        position, frame : (3,), (3, 3)
            Origin of the file's coordinates in the base frame [m], and axes by columns.

        Raises
        ------
        FileError
            If the file cannot be read or is not a closed surface; MissingExtraError without the
            extra `mesh`.
        """
        if unit not in UNITS:
            raise InputError("unit", unit, f"one of {', '.join(UNITS)}: files of meshes have none")
        axes = np.array(orthonormal("frame", frame))
        trimesh = needed("trimesh", "mesh")
        try:
            result: Any = trimesh.load(path, force="mesh")
            result.merge_vertices(merge_tex=True, merge_norm=True)
            result.update_faces(result.nondegenerate_faces(height=0))
            vertices = np.array(result.vertices, float)
            faces = np.array(result.faces, np.int64)
        except Exception as reason:  # the readers raise many types of errors
            raise FileError(str(path), "", f"cannot be read as a mesh: {reason}") from None
        if not len(faces):
            raise FileError(str(path), "", "there are no triangles in it")
        faces = faces[:, ::-1] if volume(vertices, faces) < 0 else faces
        try:
            place = finite_array("position", position, (3,))
            return cls(UNITS[unit] * vertices @ axes.T + place, faces)  # type: ignore[arg-type]
        except InputError as reason:
            raise FileError.of(reason, str(path), "") from None

    def __hash__(self) -> int:
        """Hash some of the vertices and faces, because a mesh may have many."""
        return hash((len(self.faces), self.vertices[:8], self.faces[-8:]))

    def __repr__(self) -> str:
        points = np.array(self.vertices)
        low, high = (np.round(f(points, axis=0), 4).tolist() for f in (np.min, np.max))
        return f"Mesh({len(self.faces)} triangles, from {low} to {high} m)"

    @property
    def is_convex(self) -> bool:
        """See Obstacle.is_convex."""
        return _triangles(self).is_convex

    def at(self, points: Array) -> tuple[Array, Array]:
        """See Obstacle.at."""
        return _triangles(self).nearest(points)[:2]

    def nearest_part(self, point: Array) -> Array:
        """See Obstacle.nearest_part: the half-space behind the tangent plane at the nearest point.

        For a point inside a convex mesh, the box around the mesh.
        """
        surface = _triangles(self)
        d, gradient, _, place = surface.nearest(point[None])
        if d[0] <= 0 and self.is_convex:
            return rounded(*surface.box)
        sizes = np.array([0.0, LARGEST, LARGEST])
        return rounded(place[0], axes_with(gradient[0]), sizes, is_open=True)

    def translated(self, by: tuple[float, ...]) -> Obstacle:
        """See Obstacle.translated."""
        return TranslatedMesh(self, by)


@value
class TranslatedMesh(Obstacle):
    """A mesh after a translation (3,) [m], which shares the search tree of the mesh."""

    mesh: Mesh
    by: tuple[float, ...]

    @property
    def is_convex(self) -> bool:
        """See Obstacle.is_convex."""
        return self.mesh.is_convex

    def at(self, points: Array) -> tuple[Array, Array]:
        """See Obstacle.at."""
        return self.mesh.at(points - np.array(self.by))

    def nearest_part(self, point: Array) -> Array:
        """See Obstacle.nearest_part."""
        result = self.mesh.nearest_part(point - np.array(self.by))
        result[:3] += self.by
        return result

    def translated(self, by: tuple[float, ...]) -> Obstacle:
        """See Obstacle.translated."""
        return TranslatedMesh(self.mesh, tuple(np.add(self.by, by).tolist()))


@lru_cache(maxsize=16)
def _triangles(mesh: Mesh) -> Triangles:
    return Triangles(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64))
