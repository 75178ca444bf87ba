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
from model.obstacles.base import Convex
from model.paths import Array
from planner.avoidance.places import near_places, updated, watched_places
from planner.avoidance.rows import Avoidance, Place
from planner.avoidance.surroundings import Surroundings
from planner.trajectory.program import Waypoint
from planner.trajectory.question import Question
from planner.trajectory.timed import Timed
from planner.trajectory.waypoints import Waypoints

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
        corrected = _corrected(question, waypoints, lines)
        if corrected is None or not waypoints.solve(corrected):
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
    fractions = (instants - timed.starts[:-1]) / np.diff(timed.starts)
    waypoints, changed = list[Waypoint](), False
    for k, waypoint in enumerate(before.waypoints):
        if bounds[k] < 0 and _INSIDE < fractions[k] < 1 - _INSIDE:
            T = timed.at(instants[k : k + 1])[0]
            line, surroundings = lines(T), question.wider.at(float(instants[k]))
            if line is not None:
                rows = updated(None, watched_places(line, surroundings), line, surroundings)
                waypoints.append(Waypoint((), T, rows, fractions[k] * waypoint.fraction))
                left = (1 - fractions[k]) * waypoint.fraction
                waypoint, changed = replace(waypoint, fraction=left), True
        if unverified[k]:
            line = lines(waypoint.tensions)
            surroundings = question.wider.at(float(timed.starts[k + 1]))
            if line is not None and not surroundings.keeps(line):
                kept = waypoint.avoidance
                if question.wider.moving:
                    kept = _still(kept, surroundings)
                near = near_places(line, surroundings)
                rows = updated(kept, near, line, surroundings)
                waypoint, changed = replace(waypoint, avoidance=rows), True
        waypoints.append(waypoint)
    return waypoints if changed else None


def _still(avoidance: Avoidance | None, surroundings: Surroundings) -> Avoidance | None:
    """Return inequalities without those of obstacles that have moved on."""
    if avoidance is None:
        return None
    convex = [obstacle for obstacle in surroundings.obstacles if isinstance(obstacle, Convex)]
    numbers = {tuple(obstacle.tolist()) for obstacle in numbers_of(convex)}
    rows = (row for row in avoidance.rows if isinstance(row.other, Place) or row.other in numbers)
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


def between(lines: Lines, way: Timed, surroundings: Surroundings) -> Between:
    """Return how clear an arm stays from each waypoint to the next."""
    which, low, high = _parts(way, surroundings)
    durations = np.diff(way.starts)

    def tensions(part: Counts, fraction: Array) -> Array:
        k, u = which[part], low[part] + fraction * (high - low)[part]
        if surroundings.moving:
            return way.at(way.starts[k] + u * durations[k])
        return np.asarray(way.tensions[k] + u[:, None] * np.diff(way.tensions, axis=0)[k])

    moving, all_parts = Moving(lines, tensions), np.arange(which.size)
    kinds = list(surroundings.least)
    bodies = [*surroundings.obstacles, *(one.obstacle for one in surroundings.moving)]
    ends = way.starts[which, None] + durations[which, None] * np.stack([low, high], axis=1)
    shift = np.zeros((which.size, 2, len(bodies), 3))
    for i, one in enumerate(surroundings.moving, start=len(surroundings.obstacles)):
        shift[:, :, i] = one.displacement(ends)
    uneven = _uneven(tensions, all_parts) if surroundings.moving else None
    kinds = [*[OBSTACLES] * bool(bodies), *(one for one in kinds if one != OBSTACLES)]
    nearest = []
    for kind in kinds:
        near = around(lines.arm, kind, bodies, surroundings.clearance)
        if kind == OBSTACLES:
            near = replace(near, moved=shift, uneven=uneven)
        nearest.append(closest(moving, which.size, near))
    bounds = np.array([one.bound for one in nearest])
    least = bounds.argmin(axis=0), all_parts
    bound, seen = bounds[least], np.array([one.share for one in nearest])[least]
    first = np.lexsort((bound, which))[np.searchsorted(which, np.arange(durations.size))]
    fraction = low[first] + seen[first] * (high - low)[first]
    when = fraction * durations
    if not surroundings.moving:
        each = zip(fraction, way.laws, strict=True)
        when = np.array([np.interp(u, law.shares, law.times) for u, law in each])
    step = max(float(one.step.max()) for one in nearest)
    return Between(bound[first], way.starts[:-1] + when, step)


def _uneven(tensions: Tensions, parts: Counts) -> Array:
    """Return how far the share of tensions is at the most from the share of time, by part (P,).

    It is a parabola, which is farthest from the line between its ends halfway.
    """
    start, half, end = (tensions(parts, np.full(parts.size, u)) for u in (0.0, 0.5, 1.0))
    length = np.linalg.norm(end - start, axis=1)
    off = np.linalg.norm(half - (start + end) / 2, axis=1)
    return np.asarray(off / np.maximum(length, 1e-300))


def _parts(way: Timed, surroundings: Surroundings) -> tuple[Counts, Array, Array]:
    """Return parts of stretches on which obstacles and arm move steadily: which, shares (P,).

    Shares are those of the time. Where nothing but the arm moves, its pace does not matter.
    """
    breaks = np.array(sorted({t for one in surroundings.moving for t in one.times}))
    which, low, high = [], [], []
    for k, (start, end) in enumerate(pairwise(way.starts)):
        law, inside = way.laws[k], breaks[(breaks > start) & (breaks < end)]
        knots = law.times[1:-1] / law.times[-1] if surroundings.moving else []
        cuts = [(inside - start) / (end - start), knots, [0.0, 1.0]]
        parts = np.unique(np.concatenate(cuts))
        which += [k] * (parts.size - 1)
        low.append(parts[:-1])
        high.append(parts[1:])
    return np.array(which), np.concatenate(low), np.concatenate(high)
