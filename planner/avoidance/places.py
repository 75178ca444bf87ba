"""Where an arm comes nearest to what it is to keep clear of: local minima along it, as rows."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import minimum_filter

from model.centreline import Centreline
from model.clearance.nearest import base_plane
from model.obstacles.base import Convex
from model.obstacles.bodies import Bodies
from model.paths import Array
from model.rotations import matrices
from planner.avoidance.rows import Apart, Avoidance, Place, cubic, element_of, grid
from planner.avoidance.surroundings import Surroundings

# How often places are exchanged for those of the arm that keeps clear of them.
EXCHANGED = 16
# Even points that are looked at: the parabola through three is off by a few thousandths of a
# millimetre where an arm of half a metre passes a body of 5 mm.
_POINTS = 257
# What is nearer than so much more than asked for gets an inequality beforehand, over L; the same
# of arms that touch nothing, to stay on the side where they are.
_NEAR, _WATCHED = 0.02, 0.15
# Rows of one body so near to each other, over L, are one.
_SAME = 5e-3


def avoiding(line: Centreline, surroundings: Surroundings, before: Avoidance | None) -> Avoidance:
    """Return inequalities where an arm is near, and those from before elsewhere.

    At first also where an arm that touches nothing is not so near.
    """
    first = before is None and surroundings.keeps(line)
    rows = _near(line, surroundings, _WATCHED if first else _NEAR)
    for row in before.rows if before else ():
        if row.is_lasting and not any(_is_same(line, row, other) for other in rows):
            other = row.other.s if isinstance(row.other, Place) else np.array(row.other)
            rows.append(_row(line, surroundings, row.place.s, other, row.is_part))
    return Avoidance(tuple(rows))


def _near(line: Centreline, surroundings: Surroundings, within: float) -> list[Apart]:
    """Return rows where an arm is about as near as is allowed, or nearer."""
    s = np.linspace(0.0, line.arm.length, _POINTS)
    points, radius = line.at(s)
    turned, most = line.turned(s), surroundings.clearance + within * line.arm.length
    plane = [base_plane(line.arm)] * surroundings.of_itself
    bodies = Bodies([*surroundings.obstacles, *plane])
    gaps = bodies.at(points[:, None])[0] - radius[:, None]
    gaps[0] = np.inf  # the base stays where it is
    gaps[turned < np.pi / 2, len(surroundings.obstacles) :] = np.inf
    rows = list[Apart]()
    for i, k in np.argwhere((gaps <= minimum_filter(gaps, (3, 1))) & (gaps < most)):
        at, body = _least(s, gaps[:, k], i), bodies.obstacles[k]
        numbers = body.nearest_part(line.at(np.array([at]))[0][0])
        rows.append(_row(line, surroundings, at, numbers, not isinstance(body, Convex)))
    if surroundings.of_itself:
        gaps = np.linalg.norm(points[:, None] - points, axis=2) - radius[:, None] - radius
        gaps[turned - turned[:, None] < np.pi] = np.inf
        for i, k in np.argwhere((gaps <= minimum_filter(gaps, 3)) & (gaps < most)):
            one, other = _least(s, gaps[:, k], i), _least(s, gaps[i], k)
            rows.append(_row(line, surroundings, one, other))
    return rows


def _least(s: Array, gaps: Array, i: int) -> float:
    """Return where the parabola through three samples (K,) is least, about the i-th."""
    if 0 < i < s.size - 1:
        before, at, after = gaps[i - 1 : i + 2]
        bend = before - 2 * at + after
        if 0 < bend < np.inf:
            return float(s[i] + s[1] * (before - after) / (2 * bend))
    return float(s[i])


def _is_same(line: Centreline, row: Apart, other: Apart) -> bool:
    """Return whether two rows keep the same apart at about the same place."""
    pairs = [(row.place, other.place)]
    if isinstance(row.other, Place) and isinstance(other.other, Place):
        pairs.append((row.other, other.other))
    elif row.other != other.other:
        return False
    return all(abs(a.s - b.s) <= _SAME * line.arm.length for a, b in pairs)


def _row(
    line: Centreline,
    surroundings: Surroundings,
    s: float,
    other: float | Array,
    is_part: bool = False,
) -> Apart:
    """Return the inequality of a place and a body, or of two places."""
    place, radius = _place(line, s)
    keep = radius + surroundings.clearance + surroundings.spare(line.arm)
    if isinstance(other, float):
        second, other_radius = _place(line, other)
        return Apart(place, second, keep + other_radius)
    return Apart(place, tuple(other.tolist()), keep, is_part)


def _place(line: Centreline, s: float) -> tuple[Place, float]:
    """Return a place of an arm, and its radius there [m]."""
    nodes, k = grid(line.arm), element_of(line.arm, s)
    length = line.length(nodes[k], nodes[k + 1])
    at = [int(np.argmin(np.abs(line.s - nodes[i]))) for i in (k, k + 1)]
    poses = line.poses[at]
    ends = np.stack([poses[:, 4:], matrices(poses[:, :4])[:, :, 0]], axis=1).reshape(-1, 3)
    point, radius = line.at(np.array([s]))
    shift = point[0] - cubic(line.arm, s, length) @ ends
    return Place(s, length, tuple(shift.tolist())), float(radius[0])
