"""The surfaces of a settled arm and of obstacles as triangles, and tendons as paths."""

from __future__ import annotations

from functools import singledispatch
from itertools import product
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from octoplan.model.arm import Arm
from octoplan.model.extensions.obstacles import HalfSpace, Mesh
from octoplan.model.extensions.obstacles.base import Convex, axes_with
from octoplan.model.extensions.obstacles.mesh import TranslatedMesh
from octoplan.model.mesh import stations, tendon_offsets
from octoplan.model.paths import Array
from octoplan.model.rotations import matrices
from octoplan.model.shape import Shape

# Points of an obstacle's outline along half a circle.
_STEPS = 12
# Half the side of the square that represents a plane [m].
_SHOWN = 0.15


def surface(
    arm: Arm, s: Array, poses: Array, around: int, swelling: Array | None = None
) -> tuple[Array, NDArray[np.int64]]:
    """Return the closed surface of the body; normals of triangles point outwards.

    The surface consists of rings about the midline and flat ends.

    Parameters
    ----------
    s, poses : (along,), (along, 7)
        Arc lengths of the rings from base to tip [m], and poses of the midline.
    around : int
        Points in each ring.
    swelling : (along,)
        Factors of the cross-sections; 1 by default.

    Returns
    -------
    vertices : (along * around + 2, 3)
        Rings from base to tip, then centres of base and tip [m].
    faces : (2 * along * around, 3)
        Indices of the vertices of each triangle.
    """
    points = outlines(arm, s, around)
    if swelling is not None:
        points = points * swelling[:, None, None]
    skin = rings(poses, points).reshape(-1, 3)
    return np.vstack([skin, poses[[0, -1], 4:]]), _faces(s.size, around)


def outlines(arm: Arm, s: Array, around: int) -> Array:
    """Return points (N, around, 2) of the outlines of cross-sections along n and b [m]."""
    radius = np.array(arm.radius.evaluate(s, arm.length)[:2])
    return arm.profile.outline(radius, s, arm.length, around)


def rings(poses: Array, points: Array) -> Array:
    """Return rings (N, around, 3) [m] about poses (N, 7) of points (N, around, 2) along n and b."""
    across = matrices(poses[:, :4])[:, :, 1:]
    return np.asarray(poses[:, None, 4:] + points @ np.swapaxes(across, 1, 2))


def tendon_lines(arm: Arm, s: Array, poses: Array) -> list[Array]:
    """Return the tendons (N_j, 3) [m], u + y d of eqs. (5), (6), for poses of the midline.

    Points are at those arc lengths of `s` (along,) [m] that are not beyond the anchorage. Guides
    must be among `s`; see `along`.
    """
    across = matrices(poses[:, :4])[:, :, 1:]
    lines = poses[:, 4:] + np.einsum("nij,tnj->tni", across, offsets(arm, s))
    for line, guides in zip(lines, arm.guides, strict=True):
        if guides is not None:
            points = line[np.searchsorted(s, guides)]
            line[:] = np.column_stack([np.interp(s, guides, x) for x in points.T])
    ends = [arm.sections[i].at for i, _ in arm.tendons]
    return [line[s <= end] for line, end in zip(lines, ends, strict=True)]


def along(arm: Arm, count: int) -> Array:
    """Return evenly spaced arc lengths [m] from base to tip, with anchorages and guides added."""
    added = [section.at for section in arm.sections]
    added += [s for guides in arm.guides if guides is not None for s in guides]
    return np.union1d(np.linspace(0.0, arm.length, count), added)


def sketched_poses(shape: Shape, s: Array) -> Array:
    """Return poses (N, 7) at arc lengths s (N,) [m], interpolated between the nodes of the mesh.

    Rotations have constant speed between nodes; positions are cubic in the lengths of arcs. On a
    coarse mesh the error is below 1e-3 L, and the time a tenth of that of Shape.poses, which
    integrates.
    """
    turned = Rotation.from_quat(shape.states[:, :4], scalar_first=True)
    place = shape.states[:, 4:7]
    half = (turned[:-1].inv() * turned[1:]).magnitude() / 2
    chords = np.linalg.norm(np.diff(place, axis=0), axis=1)
    arcs = np.append(0.0, np.cumsum(chords / np.sinc(half / np.pi)))
    midline = CubicHermiteSpline(arcs, place, turned.as_matrix()[:, :, 0])
    quaternions = Slerp(shape.s, turned)(s).as_quat(scalar_first=True)
    return np.hstack([quaternions, midline(np.interp(s, shape.s, arcs))])


def _faces(along: int, around: int) -> NDArray[np.int64]:
    here = np.arange((along - 1) * around).reshape(-1, around)
    beside = np.roll(here, -1, axis=1)
    first = np.arange(around)
    base = np.full(around, along * around)
    last = first + (along - 1) * around
    tip = base + 1
    triangles = [
        (here, beside, here + around),
        (beside, beside + around, here + around),
        (np.roll(first, -1), first, base),
        (last, np.roll(last, -1), tip),
    ]
    return np.vstack([np.stack(corners, axis=-1).reshape(-1, 3) for corners in triangles])


def offsets(arm: Arm, s: Array) -> Array:
    """Return Y = y d of the tendons along n and b (n_tendons, N, 2) [m] at arc lengths s (N,).

    Offsets are extended beyond the anchorages.
    """
    crossed = np.full(s.size, len(arm.sections))
    return np.asarray(tendon_offsets(arm, stations(arm, s, crossed))[0].transpose(2, 1, 0))


@singledispatch
def outline(obstacle: Any) -> tuple[Array, NDArray[np.int64]]:
    """Return points (N, 3) [m] and triangles (M, 3) of an obstacle's surface, for figures."""
    raise TypeError(f"obstacles of type {type(obstacle).__name__} have no outline")


@outline.register
def _of_convex(body: Convex) -> tuple[Array, NDArray[np.int64]]:
    """Return the hull of balls, with the radius of the layer, about the corners of the box."""
    center, axes, half, layer, _ = np.split(body.parameters, [3, 12, 15, 16])
    corners = np.array(list(product((-1, 1), repeat=3))) * half
    angles = np.pi / _STEPS * np.arange(2 * _STEPS)
    theta, phi = (each.ravel() for each in np.meshgrid(angles[: _STEPS + 1], angles))
    across = np.sin(theta) * np.array([np.cos(phi), np.sin(phi)])
    ball = layer * np.array([np.cos(theta), *across]).T
    points = np.unique((corners[:, None] + ball).reshape(-1, 3), axis=0) @ axes.reshape(3, 3)
    hull = scipy.spatial.ConvexHull(points)
    a, b, c = points[hull.simplices.T]
    outwards = np.einsum("ki,ki->k", np.cross(b - a, c - a), hull.equations[:, :3]) > 0
    turned = np.where(outwards[:, None], hull.simplices, hull.simplices[:, ::-1])
    kept, triangles = np.unique(turned, return_inverse=True)
    return center + points[kept], np.reshape(triangles, (-1, 3))


@outline.register
def _of_half_space(body: HalfSpace) -> tuple[Array, NDArray[np.int64]]:
    """Return a square of the plane."""
    axes = axes_with(np.array(body.normal))
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * _SHOWN
    return np.array(body.point) + corners @ axes[:, 1:].T, np.array([(0, 1, 2), (0, 2, 3)])


@outline.register
def _of_mesh(body: Mesh) -> tuple[Array, NDArray[np.int64]]:
    return np.array(body.vertices), np.array(body.faces)


@outline.register
def _of_translated_mesh(body: TranslatedMesh) -> tuple[Array, NDArray[np.int64]]:
    points, triangles = outline(body.mesh)
    return points + np.array(body.by), triangles
