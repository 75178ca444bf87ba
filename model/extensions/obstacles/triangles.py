"""Closed surface of triangles: validity and signed distance.

libigl finds the nearest point exactly, with a tree of bounding boxes. The sign follows from the
winding number of the surface around a point, 1 inside and 0 outside. Source: Barill, Dickson,
Schmidt, Levin, Jacobson, "Fast winding numbers for soups and clouds", ACM Transactions on Graphics
37 (2018).
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from octoplan.model.paths import SAME, Array
from octoplan.model.support.errors import InputError, needed

Faces = NDArray[np.int64]
# Relative size that counts as 0.
_TINY = 1e-12


def check_closed(vertices: Array, faces: Faces) -> None:
    """Raise InputError unless triangles (M, 3) are a closed surface with outward orientation."""
    size = float(np.ptp(vertices, axis=0).max(initial=0.0))
    areas = np.linalg.norm(_normals(vertices, faces), axis=1) / 2
    for i in np.flatnonzero(areas <= (_TINY * size) ** 2)[:1]:
        message = f"triangles that have an area; {np.sum(areas <= (_TINY * size) ** 2)} have none"
        raise InputError(f"Mesh.faces[{i}]", faces[i].tolist(), message)
    edges = np.vstack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    key = edges @ [len(vertices), 1]
    back = edges @ [1, len(vertices)]
    _, counts = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    open_edges = int((counts != 2).sum())
    round_corners = "counter-clockwise, seen from outside"
    refused = (
        (
            open_edges > 0,
            f"{open_edges} of {counts.size} edges with one triangle, or three",
            "a closed (watertight) surface, two triangles at each edge: fill its holes",
        ),
        (
            not np.array_equal(np.sort(key), np.sort(back)),
            "some turned over",
            f"triangles whose corners all go round {round_corners}",
        ),
        (
            volume(vertices, faces) <= 0,
            "turned inwards",
            f"triangles turned outwards: corners {round_corners}",
        ),
    )
    for is_refused, value, allowed in refused:
        if is_refused:
            raise InputError("Mesh.faces", value, allowed)


def volume(vertices: Array, faces: Faces) -> float:
    """Return the volume [m3] of a closed surface, negative for inward orientation."""
    a, b, c = (vertices[faces[:, i]] - vertices.mean(axis=0) for i in range(3))
    return float(np.einsum("ki,ki->", a, np.cross(b, c)) / 6)


class Triangles:
    """A closed surface with a search tree for nearest points."""

    def __init__(self, vertices: Array, faces: Faces) -> None:
        igl = needed("igl", "mesh")
        self.vertices = vertices
        self.faces = faces
        self._tree: Any = igl.AABB()
        self._tree.init(vertices, faces)
        crossed = _normals(vertices, faces)
        self.normals = crossed / np.linalg.norm(crossed, axis=1, keepdims=True)
        self._winding: Any = igl.FastWindingNumberBVH()
        self._winding.init(vertices, faces)

    def nearest(self, points: Array) -> tuple[Array, Array, Faces, Array]:
        """Return signed distances (N,) [m], gradients (N, 3), triangles (N,), places (N, 3)."""
        if not len(points):
            return np.zeros(0), np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros((0, 3))
        value = np.ascontiguousarray(points)
        _, face, place = self._tree.squared_distance(self.vertices, self.faces, value)
        way = points - place
        sign = np.where(self._winding.winding_number(value) > 0.5, -1.0, 1.0)
        size = np.linalg.norm(way, axis=1)
        on = size <= _TINY * np.abs(self.vertices).max()
        away = (sign / np.where(on, 1.0, size))[:, None] * way
        gradient = np.where(on[:, None], self.normals[face], away)
        return sign * size, gradient, face, place

    @cached_property
    def is_convex(self) -> bool:
        """Whether the body is convex: its volume is the volume of its hull, up to rounding."""
        hull = scipy.spatial.ConvexHull(self.vertices)
        return volume(self.vertices, self.faces) >= (1 - SAME) * float(hull.volume)

    @property
    def box(self) -> tuple[Array, Array, Array]:
        """Bounding box along the principal axes: center, axes (3, 3), half sizes."""
        axes = np.linalg.svd(self.vertices - self.vertices.mean(axis=0), full_matrices=False)[2].T
        low, high = (each(self.vertices @ axes, axis=0) for each in (np.min, np.max))
        return axes @ (low + high) / 2, axes, (high - low) / 2


def _normals(vertices: Array, faces: Faces) -> Array:
    """Return the normals (M, 3) of triangles, with lengths of twice the areas."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a)
