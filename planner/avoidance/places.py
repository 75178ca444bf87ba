"""Where an arm comes nearest to what it is to keep clear of: local minima along it, as rows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import minimum_filter

from model.centreline import Centreline
from model.clearance.nearest import base_plane
from model.obstacles.base import Convex, distances_from
from model.paths import Array
from model.rotations import matrices
from planner.avoidance.rows import Apart, Avoidance, Place, cubic, element_of, grid
from planner.avoidance.surroundings import Surroundings

# How often places are exchanged for those of the arm that keeps clear of them.
EXCHANGED = 16
# Even points that are looked at: the parabola through three is off by a few thousandths of a
# millimetre where an arm of half a metre passes a body of 5 mm. Rows of one body that are nearer to
# each other than two of them are one.
_POINTS = 257
# What is nearer than so much more than asked for gets an inequality beforehand, over L; the same
# of arms that touch nothing, to stay on the side where they are.
_NEAR, _WATCHED = 0.02, 0.15
# A place [m], another or the numbers of a body, and whether that is a part of a mesh.
Pair = tuple[float, float | tuple[float, ...], bool]


def avoiding(
    line: Centreline, surroundings: Surroundings, before: Avoidance | None
) -> tuple[Avoidance, float]:
    """Return inequalities where an arm is near, and those from before elsewhere; the least gap [m].

    At first also where an arm that touches nothing is not so near.
    """
    minima = list(_minima(line, surroundings))
    least = min((gap for gap, _ in minima), default=np.inf)
    near = _NEAR if before or least < surroundings.clearance else _WATCHED
    most = surroundings.clearance + near * line.arm.length
    pairs = [pair for gap, pair in minima if gap < most]
    for row in before.rows if before else ():
        other = row.other.s if isinstance(row.other, Place) else row.other
        pair = row.place.s, other, row.is_part
        if not row.is_part and not any(_is_same(line, pair, another) for another in pairs):
            pairs.append(pair)
    return Avoidance(tuple(_row(line, surroundings, *pair) for pair in pairs)), least


def _minima(line: Centreline, surroundings: Surroundings) -> Iterator[tuple[float, Pair]]:
    """Yield gaps [m] where an arm is nearest to something not far off, and what is there."""
    s, bodies = np.linspace(0.0, line.arm.length, _POINTS), list(surroundings.obstacles)
    (points, radius), turned = line.at(s), line.turned(s)
    bodies += [base_plane(line.arm)] * surroundings.of_itself
    gaps = distances_from(bodies, points[:, None])[0] - radius[:, None]
    gaps[0] = np.inf  # the base stays where it is
    gaps[turned < np.pi / 2, len(surroundings.obstacles) :] = np.inf
    most = surroundings.clearance + _WATCHED * line.arm.length
    for i, k in np.argwhere((gaps <= minimum_filter(gaps, (3, 1))) & (gaps < most)):
        at, gap = _parabola_minimum(s, gaps[:, k], i)
        numbers = bodies[k].nearest_part(line.at(np.array([at]))[0][0])
        yield gap, (at, tuple(numbers.tolist()), not isinstance(bodies[k], Convex))
    if surroundings.of_itself:
        gaps = np.linalg.norm(points[:, None] - points, axis=2) - radius[:, None] - radius
        gaps[turned - turned[:, None] < np.pi] = np.inf
        # Side by side even points of two parts of the arm are near to each other by turns.
        window = 1 + 2 * round(_NEAR * _POINTS)
        for i, k in np.argwhere((gaps <= minimum_filter(gaps, window)) & (gaps < most)):
            (one, gap), (other, _) = (
                _parabola_minimum(s, gaps[:, k], i),
                _parabola_minimum(s, gaps[i], k),
            )
            yield gap, (one, other, False)


def _parabola_minimum(s: Array, gaps: Array, i: int) -> tuple[float, float]:
    """Return where the parabola through three samples (K,) is least, about the i-th, and it."""
    if 0 < i < s.size - 1:
        before, at, after = gaps[i - 1 : i + 2]
        bend, slope = before - 2 * at + after, (after - before) / 2
        if 0 < bend < np.inf:
            return float(s[i] - s[1] * slope / bend), float(at - slope**2 / (2 * bend))
    return float(s[i]), float(gaps[i])


def _is_same(line: Centreline, one: Pair, two: Pair) -> bool:
    """Return whether two pairs are the same at about the same place."""
    near, (s, other, _), (at, another, _) = line.arm.length / _POINTS, one, two
    if isinstance(other, float) and isinstance(another, float):
        return max(abs(other - another), abs(s - at)) <= near
    return other == another and abs(s - at) <= near


def _row(
    line: Centreline,
    surroundings: Surroundings,
    s: float,
    other: float | tuple[float, ...],
    is_part: bool,
) -> Apart:
    """Return the inequality of a place and a body, or of two places."""
    place, radius = _place(line, s)
    keep = radius + surroundings.clearance + surroundings.spare(line.arm)
    if isinstance(other, tuple):
        return Apart(place, other, keep, is_part)
    second, other_radius = _place(line, other)
    return Apart(place, second, keep + other_radius)


def _place(line: Centreline, s: float) -> tuple[Place, float]:
    """Return a place of an arm, and its radius there [m]."""
    nodes, k = grid(line.arm), element_of(line.arm, s)
    ends = nodes[k : k + 2]
    poses = line.poses[np.abs(line.s - ends[:, None]).argmin(axis=1)]
    known = np.stack([poses[:, 4:], matrices(poses[:, :4])[:, :, 0]], axis=1).reshape(-1, 3)
    length, (point, radius) = line.length(*ends), line.at(np.array([s]))
    shift = point[0] - cubic(line.arm, s, length) @ known
    return Place(s, length, tuple(shift.tolist())), float(radius[0])
