"""Motions that keep clear: how clear they are between waypoints, and more of these where not.

Inequalities that keep clear are added where they are violated, at waypoints and, by further
waypoints without targets, between them; then the program over all is solved again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from model.centreline import Counts
from model.clearance.bisection import closest
from model.clearance.lines import Lines
from model.clearance.nearest import OBSTACLES, around
from model.clearance.way import Moving, Tensions
from model.obstacles import numbers_of
from model.obstacles.base import Convex, Translated
from model.obstacles.mesh import TranslatedMesh
from model.paths import Array
from planner.avoidance.asked import Surroundings
from planner.avoidance.places import near_places, updated, watched_places
from planner.avoidance.rows import Avoidance, Place
from planner.trajectory.question import Question
from planner.trajectory.timed import Timed
from planner.trajectory.waypoints import Waypoint, Waypoints

_ROUNDS = 20
# Shares of the way where a further waypoint parts it.
_INSIDE = 0.02


def cleared(question: Question) -> Waypoints:
    """Return the waypoints of the best motion that keeps clear, as far as that can be had."""
    waypoints = Waypoints(question)
    if not question.surroundings:
        return waypoints
    lines = question.lines()
    for _ in range(_ROUNDS):
        ways = _corrected(question, waypoints, lines)
        if ways is None or not waypoints.solve(ways):
            break
    return waypoints


def _corrected(question: Question, before: Waypoints, lines: Lines) -> list[Waypoint] | None:
    """Return waypoints with inequalities where they, or the ways between, are too near."""
    timed = Timed.of(question, before.tensions, before.met_at)
    unverified = between(lines, timed, question.wider).bound < 0
    unverified |= np.append(unverified[1:], False)
    if not unverified.any():
        return None
    way_there = between(lines, timed, question.surroundings)
    bounds, instants = way_there.bound, way_there.when
    shares = (instants - timed.starts[:-1]) / np.diff(timed.starts)
    ways, changed = list[Waypoint](), False
    for k, way in enumerate(before.ways):
        if bounds[k] < 0 and _INSIDE < shares[k] < 1 - _INSIDE:
            T = timed.at(instants[k : k + 1])[0]
            line, asked = lines(T), question.wider.at(float(instants[k]))
            if line is not None:
                rows = updated(None, watched_places(line, asked), line, asked)
                ways.append(Waypoint((), T, rows, shares[k] * way.share))
                way, changed = replace(way, share=(1 - shares[k]) * way.share), True
        if unverified[k]:
            line, asked = lines(way.tensions), question.wider.at(float(timed.starts[k + 1]))
            if line is not None and not asked.keeps(line):
                rows = updated(_still(way.avoidance, asked), near_places(line, asked), line, asked)
                way, changed = replace(way, avoidance=rows), True
        ways.append(way)
    return ways if changed else None


def _still(avoidance: Avoidance | None, asked: Surroundings) -> Avoidance | None:
    """Return inequalities without those of obstacles that have moved on."""
    if avoidance is None or not isinstance(
        (*asked.obstacles, None)[-1], Translated | TranslatedMesh
    ):
        return avoidance
    convex = [own for own in asked.obstacles if isinstance(own, Convex)]
    there = {tuple(own.tolist()) for own in numbers_of(convex)}
    rows = (row for row in avoidance.rows if isinstance(row.other, Place) or row.other in there)
    return replace(avoidance, rows=tuple(rows))


@dataclass(frozen=True, eq=False)
class Between:
    """How clear an arm stays from each waypoint to the next.

    Attributes
    ----------
    bound : (N,)
        What is kept besides the clearance [m]; a lower bound, see model.clearance.bisection.
    when : (N,)
        When that is [s].
    step : float
        How far places of the arm go at the most between two shapes that were looked at [m].
    """

    bound: Array
    when: Array
    step: float


def between(lines: Lines, way: Timed, asked: Surroundings) -> Between:
    """Return how clear an arm stays from each waypoint to the next."""
    which, low, high = _parts(way, asked)
    durations = np.diff(way.starts)

    def tensions(part: Counts, share: Array) -> Array:
        k, u = which[part], low[part] + share * (high - low)[part]
        if asked.moving:
            return way.at(way.starts[k] + u * durations[k])
        return np.asarray(way.tensions[k] + u[:, None] * np.diff(way.tensions, axis=0)[k])

    moving, all_parts = Moving(lines, tensions), np.arange(which.size)
    kinds, bodies = list(asked.least), [*asked.obstacles, *(own.obstacle for own in asked.moving)]
    ends = way.starts[which, None] + durations[which, None] * np.stack([low, high], axis=1)
    shift = np.zeros((which.size, 2, len(bodies), 3))
    for i, own in enumerate(asked.moving, start=len(asked.obstacles)):
        shift[:, :, i] = own.moved(ends)
    uneven = _uneven(tensions, all_parts) if asked.moving else None
    kinds = [*[OBSTACLES] * bool(bodies), *(own for own in kinds if own != OBSTACLES)]
    found = []
    for kind in kinds:
        near = around(lines.arm, kind, bodies, asked.clearance)
        if kind == OBSTACLES:
            near = replace(near, moved=shift, uneven=uneven)
        found.append(closest(moving, which.size, near))
    bounds = np.array([own.bound for own in found])
    least = bounds.argmin(axis=0), all_parts
    bound, seen = bounds[least], np.array([own.share for own in found])[least]
    first = np.lexsort((bound, which))[np.searchsorted(which, np.arange(durations.size))]
    share = low[first] + seen[first] * (high - low)[first]
    when = share * durations
    if not asked.moving:
        each = zip(share, way.laws, strict=True)
        when = np.array([np.interp(u, law.shares, law.times) for u, law in each])
    step = max(float(own.step.max()) for own in found)
    return Between(bound[first], way.starts[:-1] + when, step)


def _uneven(tensions: Tensions, parts: Counts) -> Array:
    """Return how far the share of tensions is at the most from the share of time, by part (P,).

    It is a parabola, which is farthest from the line between its ends halfway.
    """
    start, half, end = (tensions(parts, np.full(parts.size, u)) for u in (0.0, 0.5, 1.0))
    way = np.linalg.norm(end - start, axis=1)
    off = np.linalg.norm(half - (start + end) / 2, axis=1)
    return np.asarray(off / np.maximum(way, 1e-300))


def _parts(way: Timed, asked: Surroundings) -> tuple[Counts, Array, Array]:
    """Return parts of stretches on which obstacles and arm move steadily: which, shares (P,).

    Shares are those of the time. Where nothing but the arm moves, its pace does not matter.
    """
    breaks = np.array(sorted({t for own in asked.moving for t in own.times}))
    which, low, high = [], [], []
    for k, (start, end) in enumerate(pairwise(way.starts)):
        law, inside = way.laws[k], breaks[(breaks > start) & (breaks < end)]
        own = law.times[1:-1] / law.times[-1] if asked.moving else []
        cuts = [(inside - start) / (end - start), own, [0.0, 1.0]]
        parts = np.unique(np.concatenate(cuts))
        which += [k] * (parts.size - 1)
        low.append(parts[:-1])
        high.append(parts[1:])
    return np.array(which), np.concatenate(low), np.concatenate(high)
