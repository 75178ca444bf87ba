"""The part of space that is not classified yet: the next targets, and empty balls.

A tip is reachable by its tensions. The nearest tip found to a target leaves a ball around the
target without tips. Known tips and empty balls classify space; the next targets are the points
outside of all balls that are farthest from the tips.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, KDTree

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.planner.frontends.workspaces.sampling import sobol

# Number of candidates for targets in a region, by dimensions: distances between candidates are
# small against the gaps.
_CANDIDATES = {1: 1000, 2: 4000, 3: 16000}
# Margin of a region around the tips, over the arm's length [-].
MARGIN = 0.2
# Number of data that the estimate of the boundary averages.
_NEIGHBOURS = 16
# Number of boundary tips whose tangent planes bound the depth of a tip.
_PLANES = 6
# Relative extent of the tips across a plane or a line that counts as none [-].
_FLAT = 1e-6


@dataclass(frozen=True, eq=False)
class Region:
    """A box in space or in a plane.

    Attributes
    ----------
    name : str
        Of the axes, such as "xz".
    origin : (3,)
        [m].
    axes : (k, 3)
        Orthonormal axes of the box; k = 3 in space, 2 in a plane.
    low, high : (k,)
        Corners of the box along the axes, from the origin [m].
    """

    name: str
    origin: Array
    axes: Array
    low: Array
    high: Array

    @property
    def is_plane(self) -> bool:
        """Whether the region is part of a plane."""
        return len(self.axes) < 3

    def around(self, tips: Array, margin: float) -> Region:
        """Return the region enlarged to contain tips (m, 3) with a margin [m]."""
        local = (tips - self.origin) @ self.axes.T
        low = np.minimum(self.low, local.min(0) - margin)
        return replace(self, low=low, high=np.maximum(self.high, local.max(0) + margin))

    def candidates(self, seed: int) -> Array:
        """Return points (m, 3) spread over the box [m]."""
        dimensions = len(self.axes)
        points = sobol(_CANDIDATES[dimensions], dimensions, seed)
        return np.asarray(self.origin + (self.low + points * (self.high - self.low)) @ self.axes)


@dataclass(frozen=True, eq=False)
class Classified:
    """Known tips and empty balls.

    Attributes
    ----------
    tips : (m, 3)
        Tips of settled shapes [m].
    centres : (k, 3)
        Targets of plans that end at a nearest tip [m].
    radii : (k,)
        Distances of the nearest known tips [m].
    """

    tips: Array
    centres: Array
    radii: Array

    def emptiness(self, points: Array) -> Array:
        """Return how deep points (..., 3) are in empty balls [m]; negative outside of all."""
        flat = points.reshape(-1, 3)
        depth = np.full(len(flat), -np.inf)
        for centre, radius in zip(self.centres, self.radii, strict=True):
            np.maximum(depth, radius - np.linalg.norm(flat - centre, axis=1), out=depth)
        return np.asarray(depth.reshape(points.shape[:-1]))

    def signed_distance(self, points: Array) -> Array:
        """Return an estimate of the distance (...) of points (..., 3) from the boundary [m].

        The estimate is negative inside, and a weighted mean [Shepard1968] of the nearest data. A
        nearest tip contributes the distance from the tangent plane there, another tip and a target
        out of reach contribute a distance each. Points in empty balls, and points outside of the
        convex hull of the tips, are outside.
        """
        flat = points.reshape(-1, 3)
        if not len(self.centres):
            return np.full(points.shape[:-1], -np.inf)
        nearest = KDTree(self.tips)
        gaps, which = nearest.query(self.centres)
        touching = self.tips[which]
        normals = (self.centres - touching) / gaps[:, None]
        inside = -self._depths(touching, normals)
        places = np.vstack([touching, self.centres, self.tips[inside < 0]])
        values = np.concatenate([np.zeros(len(gaps)), gaps, inside[inside < 0]])
        slopes = np.vstack([normals, np.zeros((len(places) - len(normals), 3))])
        near, at = KDTree(places).query(flat, min(_NEIGHBOURS, len(places)))
        weights = 1 / (near + 1e-6 * near.max() + 1e-300) ** 4
        weights /= weights.sum(axis=1, keepdims=True)
        offsets = np.einsum("nkx,nkx->nk", flat[:, None] - places[at], slopes[at])
        mean = (weights * (values[at] + offsets)).sum(axis=1).reshape(points.shape[:-1])
        hull = _beyond_hull(flat, self.tips)
        hull = np.where(np.isfinite(hull), hull, -np.inf).reshape(mean.shape)
        beyond = np.maximum(self.emptiness(points), hull)
        return np.asarray(np.where(beyond > 0, np.maximum(mean, beyond), mean))

    def _depths(self, touching: Array, normals: Array) -> Array:
        """Return the depths (m,) of the tips below the nearest tangent plane of boundary tips [m].

        The planes are those of nearby boundary tips (k, 3), with normals (k, 3), that have the tip
        on the inner side.
        """
        near, which = KDTree(touching).query(self.tips, min(_PLANES, len(touching)))
        near, which = near.reshape(len(self.tips), -1), which.reshape(len(self.tips), -1)
        beside = touching[which] - self.tips[:, None]
        depths = np.einsum("nkx,nkx->nk", beside, normals[which])
        depths = np.where(depths > 0, depths, np.inf)
        return np.asarray(np.minimum(depths.min(axis=1), near[:, 0]))

    def next_targets(self, region: Region, count: int, seed: int) -> Array:
        """Return targets (n, 3) in a region, n <= count.

        Each target is outside of the empty balls, and farthest from tips and other targets. Targets
        beside an empty ball refine the boundary.
        """
        points = region.candidates(seed)
        points = points[self.emptiness(points) < 0]
        gaps = KDTree(self.tips).query(points)[0]
        targets = list[Array]()
        while len(targets) < count and gaps.max(initial=0.0) > 0:
            targets.append(points[int(np.argmax(gaps))])
            gaps = np.minimum(gaps, np.linalg.norm(points - targets[-1], axis=1))
        return np.array(targets).reshape(-1, 3)

    def largest_gap(self, region: Region, seed: int) -> float:
        """Return the radius of the largest ball [m] without known tips and outside of empty balls.

        The centre is in the region.
        """
        points = region.candidates(seed)
        gaps = np.minimum(KDTree(self.tips).query(points)[0], -self.emptiness(points))
        return float(gaps.max(initial=0.0))


def is_in_hull(points: Array, tips: Array) -> NDArray[np.bool_]:
    """Return which points (m, 3) are in the convex hull of tips; none if tips are on a line."""
    return np.asarray(_beyond_hull(points, tips) <= 0)


def _beyond_hull(points: Array, tips: Array) -> Array:
    """Return the distances (m,) of points (m, 3) from the nearest facet plane of the hull of tips.

    Distances [m] are positive outside, and infinite for tips on a line. The hull of tips in a plane
    is flat.
    """
    centre = tips.mean(axis=0)
    _, extents, axes = np.linalg.svd(tips - centre, full_matrices=False)
    axes = axes[extents > _FLAT * extents[0]]
    if len(axes) < 2 or len(tips) <= len(axes):
        return np.full(len(points), np.inf)
    facets = ConvexHull((tips - centre) @ axes.T).equations
    local = (points - centre) @ axes.T
    beyond = np.full(len(points), -np.inf)
    for facet in facets:
        np.maximum(beyond, local @ facet[:-1] + facet[-1], out=beyond)
    return beyond


def regions_of(arm: Arm, tips: Array) -> tuple[Region, ...]:
    """Return the regions around tips (m, 3): space and three slices, or the plane of the arm.

    Two slices contain the axis of the base; the third is perpendicular, through the tip farthest
    from the axis. Axes are x, y and z for a base parallel to the coordinate axes, otherwise t, n
    and b. The plane of a planar arm in another direction has the axes t and r.
    """
    axes, names = _base_axes(arm)
    base = np.array(arm.base_position)
    along_axes = (tips - base) @ axes.T
    lateral = along_axes[:, 1:]
    _, _, directions = np.linalg.svd(lateral, full_matrices=True)
    if np.abs(lateral @ directions[1]).max() <= _FLAT * arm.length:
        i = 1 + int(np.argmax(np.abs(directions[0])))
        chosen = axes[[0, i]]
        if abs(directions[0, i - 1]) < 1 - _FLAT:
            chosen = np.vstack([axes[0], directions[0] @ axes[1:]])
            names[i] = "r"
        return (_region(arm, tips, base, chosen, [names[0], names[i]]),)
    widest = base + along_axes[np.argmax(np.linalg.norm(lateral, axis=1)), 0] * axes[0]
    slices = ((base, [0, 1, 2]), (base, [0, 1]), (base, [0, 2]), (widest, [1, 2]))
    return tuple(
        _region(arm, tips, origin, axes[which], [names[i] for i in which])
        for origin, which in slices
    )


def _base_axes(arm: Arm) -> tuple[Array, list[str]]:
    """Return axes (3, 3), the first along the base's tangent, and their names."""
    frame = np.array(arm.base_frame)
    order = np.abs(frame).argmax(axis=0)
    if np.allclose(np.abs(frame), np.eye(3)[:, order], atol=_FLAT):
        return np.eye(3)[order], ["xyz"[i] for i in order]
    return frame.T, list("tnb")


def _region(arm: Arm, tips: Array, origin: Array, axes: Array, names: list[str]) -> Region:
    """Return the region around tips and base; sort axes that are x, y or z."""
    if set(names) <= set("xyz"):
        order = np.argsort(names)
        axes = axes[order]
        names = [names[i] for i in order]
    local = (np.array(arm.base_position) - origin) @ axes.T
    region = Region("".join(names), origin, axes, local, local)
    return region.around(np.vstack([tips, arm.base_position]), MARGIN * arm.length)
