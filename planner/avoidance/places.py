"""Where an arm comes nearest to what it is to keep clear of: local minima along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from model.arm import Arm
from model.centreline import Centreline
from model.clearance.nearest import base_plane
from model.obstacles.base import Convex
from model.obstacles.bodies import Bodies
from model.paths import Array
from model.rotations import matrices
from planner.avoidance.rows import Apart, Avoidance, Place, cubic, element_of, grid
from planner.avoidance.surroundings import Surroundings

# Points that are looked at first; those around a minimum, and how often they close in on it.
_POINTS, _AROUND, _ROUNDS = 64, 9, 3
# What is nearer than so much more than asked for gets an inequality beforehand, over L; the same
# of arms that touch nothing, to stay on the side where they are.
_NEAR, _WATCHED = 0.02, 0.15
# Rows of one body so near to each other, over the distance of stations, are one.
_SAME = 0.05
# Rows between two stations beyond which older ones of parts of meshes are let go.
_PARTS = 8


@dataclass(frozen=True, eq=False)
class Near:
    """A local minimum of distance.

    Attributes
    ----------
    s : float
        Arc length [m].
    other : float or (17,)
        Another arc length [m], or the numbers of a convex body, or of the part that is nearest.
    gap : float
        Between the surfaces [m].
    is_part : bool
        Whether the body is a part of a mesh.
    """

    s: float
    other: float | Array
    gap: float
    is_part: bool = False


def watched_places(line: Centreline, surroundings: Surroundings) -> list[Near]:
    """Return the places where an arm is near; also those not so near, of one that is clear."""
    far = near_places(line, surroundings, _WATCHED)
    touches = any(place.gap < surroundings.clearance for place in far)
    return near_places(line, surroundings) if touches else far


def near_places(line: Centreline, surroundings: Surroundings, within: float = _NEAR) -> list[Near]:
    """Return the places where an arm is about as near as is allowed, or nearer."""
    each = max(1, -(-_POINTS // (line.s.size - 1)))
    s = np.interp(np.arange((line.s.size - 1) * each + 1) / each, np.arange(line.s.size), line.s)
    sampled = _Sampled(s, *line.at(s), line.turned(s))
    most = surroundings.clearance + within * line.arm.length
    near = _of_bodies(line, sampled, Bodies(surroundings.obstacles), 0.0, most)
    if surroundings.of_itself:
        near += _of_bodies(line, sampled, Bodies([base_plane(line.arm)]), np.pi / 2, most)
        near += _of_pairs(line, sampled, most)
    return near


class _Sampled(NamedTuple):
    """An arm at arc lengths (K,): points (K, 3), radii (K,), how far its tangents have turned."""

    s: Array
    points: Array
    radius: Array
    turned: Array


def _of_bodies(
    line: Centreline, sampled: _Sampled, bodies: Bodies, turn: float, most: float
) -> list[Near]:
    all_s, points, radius, turned = sampled
    gaps = bodies.at(points[:, None])[0] - radius[:, None]
    gaps[turned < turn] = np.inf
    gaps[0] = np.inf  # the base stays where it is
    padded = np.pad(gaps, ((1, 1), (0, 0)), constant_values=np.inf)
    at, body = np.nonzero((gaps <= padded[:-2]) & (gaps <= padded[2:]) & (gaps < most))
    if not at.size:
        return []
    low, high = all_s[at - 1], all_s[np.minimum(at + 1, all_s.size - 1)]
    rows = np.arange(at.size)
    for _ in range(_ROUNDS):
        s = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, _AROUND)
        points, radius = line.at(s.ravel())
        gap = (bodies.of(np.repeat(body, _AROUND), points) - radius).reshape(s.shape)
        k = gap.argmin(axis=1)
        best, least = s[rows, k], gap[rows, k]
        low, high = s[rows, np.maximum(k - 1, 0)], s[rows, np.minimum(k + 1, _AROUND - 1)]
    obstacles = [bodies.obstacles[b] for b in body]
    return [
        Near(float(s), obstacle.nearest_part(x), float(gap), not isinstance(obstacle, Convex))
        for s, obstacle, x, gap in zip(best, obstacles, line.at(best)[0], least, strict=True)
    ]


def _of_pairs(line: Centreline, sampled: _Sampled, most: float) -> list[Near]:
    s, nodes, radius, turned = sampled
    apart = np.linalg.norm(nodes[:, None] - nodes[None], axis=2)
    gaps = apart - radius[:, None] - radius[None]
    gaps[turned[None, :] - turned[:, None] < np.pi] = np.inf
    padded = np.pad(gaps, 1, constant_values=np.inf)
    n = len(gaps)
    around = [padded[a : a + n, b : b + n] for a in range(3) for b in range(3)]
    results = []
    for i, j in np.argwhere((gaps < most) & (gaps <= np.min(around, axis=0))):
        one, other, step = s[i], s[j], line.arm.length / n
        for _ in range(_ROUNDS):
            offsets = np.linspace(-step, step, _AROUND)
            a, b = (np.clip(at + offsets, 0, line.arm.length) for at in (one, other))
            points, radii = line.at(np.concatenate([a, b]))
            gap = np.linalg.norm(points[:_AROUND, None] - points[None, _AROUND:], axis=2)
            gap = gap - radii[:_AROUND, None] - radii[None, _AROUND:]
            k, m = np.unravel_index(int(np.argmin(gap)), gap.shape)
            one, other, step = a[k], b[m], 2 * step / (_AROUND - 1)
        results.append(Near(float(one), float(other), float(gap[k, m])))
    return results


def updated(
    before: Avoidance | None, near: Sequence[Near], line: Centreline, surroundings: Surroundings
) -> Avoidance:
    """Return inequalities at places that are near, and those from before where these are not.

    Of parts of meshes not more than some between two stations.
    """
    margin = surroundings.clearance + surroundings.spare(line.arm)
    rows = [_row(line, each.s, each.other, margin, each.is_part) for each in near]
    for row in before.rows if before else ():
        k = element_of(line.arm, row.place.s)
        beside = sum(element_of(line.arm, each.place.s) == k for each in rows) if row.is_part else 0
        is_new = not any(_alike(line.arm, row, each) for each in rows)
        if row.is_lasting and beside < _PARTS and is_new:
            other = row.other.s if isinstance(row.other, Place) else np.array(row.other)
            rows.append(_row(line, row.place.s, other, margin, row.is_part))
    return Avoidance(tuple(rows))


def _alike(arm: Arm, row: Apart, other: Apart) -> bool:
    """Return whether two rows keep the same apart at about the same place."""
    pairs = [(row.place, other.place)]
    if isinstance(row.other, Place) and isinstance(other.other, Place):
        pairs.append((row.other, other.other))
    elif row.other != other.other:
        return False
    nodes = grid(arm)
    for a, b in pairs:
        k = element_of(arm, a.s)
        if k != element_of(arm, b.s) or abs(a.s - b.s) > _SAME * (nodes[k + 1] - nodes[k]):
            return False
    return True


def _row(line: Centreline, s: float, other: float | Array, margin: float, is_part: bool) -> Apart:
    """Return the inequality of a place and a body, or of two places."""
    place, radius = _place(line, s)
    if isinstance(other, float):
        second, other_radius = _place(line, other)
        return Apart(place, second, radius + other_radius + margin)
    return Apart(place, tuple(other.tolist()), radius + margin, is_part)


def _place(line: Centreline, s: float) -> tuple[Place, float]:
    """Return a place of an arm, and its radius there [m]."""
    nodes, k = grid(line.arm), element_of(line.arm, s)
    length = line.length(nodes[k], nodes[k + 1])
    at = [int(np.argmin(np.abs(line.s - nodes[i]))) for i in (k, k + 1)]
    w = cubic(line.arm, s, length)
    poses = line.poses[at]
    ends = np.stack([poses[:, 4:], matrices(poses[:, :4])[:, :, 0]], axis=1).reshape(-1, 3)
    point, radius = line.at(np.array([s]))
    return Place(float(s), length, tuple((point[0] - w @ ends).tolist())), float(radius[0])
