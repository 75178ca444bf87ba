"""Motions that keep clear: how clear they are between waypoints, and more of these where not.

Inequalities that keep clear are added where they are violated, at waypoints and, by further
waypoints without targets, between them; then the program over all is solved again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.centreline import Counts
from model.clearance.bisection import closest
from model.clearance.nearest import BASE, ITSELF, OBSTACLES, around
from model.errors import InputError
from model.obstacles import numbers_of
from model.obstacles.base import Convex
from model.paths import Array
from planner.avoidance.lines import Lines, Moving
from planner.avoidance.places import EXCHANGED, avoiding
from planner.avoidance.rows import Place
from planner.avoidance.surroundings import Surroundings
from planner.trajectory.question import Question, Waypoint
from planner.trajectory.time_law import Timed
from planner.trajectory.waypoints import Waypoints

# Shares of the way where a further waypoint parts it.
_INSIDE = 0.02


def cleared(question: Question) -> list[Waypoint]:
    """Return the waypoints of the best motion that keeps clear, as far as that can be had.

    Raises InputError where the arm is too near to something before it moves.
    """
    if not question.surroundings:
        return Waypoints(question).waypoints
    lines = question.lines()
    line = lines(question.start)
    nearest = "" if line is None else question.surroundings.at(0.0).in_the_way(line)
    if nearest:
        distance = 1e3 * question.surroundings.clearance
        kept = f"{distance:g} mm of clearance" if distance else "clear"
        allowed = f"a start or obstacles that leave the arm {kept} before it moves: {nearest}"
        raise InputError("start", [round(float(T), 6) for T in question.start], allowed)
    waypoints = Waypoints(question)
    for _ in range(EXCHANGED):
        corrected = _corrected(question, waypoints.waypoints, lines)
        # Those that keep clear are the same objects.
        if corrected == waypoints.waypoints or not waypoints.solve(corrected):
            break
    return waypoints.waypoints


def _corrected(question: Question, before: list[Waypoint], lines: Lines) -> list[Waypoint]:
    """Return waypoints with inequalities where they, or the ways between, are too near."""
    way, waypoints = Timed.of(question, before), list[Waypoint]()
    (bound, when, _), starts = between(lines, way, question.surroundings), way.starts
    shares, too_near = (when - starts[:-1]) / np.diff(starts), bound < 0
    inside = too_near & (shares > _INSIDE) & (shares < 1 - _INSIDE)
    beside = too_near | np.append(too_near[1:], False)
    for k, waypoint in enumerate(before):
        if inside[k]:
            T, whole = way.at(when[k : k + 1])[0], waypoint.fraction
            parting = Waypoint((), T, fraction=shares[k] * whole)
            waypoints.append(_updated(question, lines, parting, float(when[k])))
            waypoint = replace(waypoint, fraction=(1 - shares[k]) * whole)
        if beside[k]:
            waypoint = _updated(question, lines, waypoint, float(starts[k + 1]))
        waypoints.append(waypoint)
    return waypoints


def _updated(question: Question, lines: Lines, waypoint: Waypoint, t: float) -> Waypoint:
    """Return a waypoint with further inequalities where it is too near at a time [s], or is new.

    Without those of obstacles that have moved on.
    """
    line, surroundings, before = lines(waypoint.tensions), question.wider.at(t), waypoint.avoidance
    if line is None or (waypoint.stated and not surroundings.in_the_way(line)):
        return waypoint
    if before is not None and question.wider.moving:
        convex = [one for one in surroundings.obstacles if isinstance(one, Convex)]
        numbers = {tuple(obstacle.tolist()) for obstacle in numbers_of(convex)}
        kept = (r for r in before.rows if isinstance(r.other, Place) or r.other in numbers)
        before = replace(before, rows=tuple(kept))
    return replace(waypoint, avoidance=avoiding(line, surroundings, before)[0])


def between(lines: Lines, way: Timed, surroundings: Surroundings) -> tuple[Array, Array, float]:
    """Return how clear an arm stays from each of N waypoints to the next.

    What is kept besides the clearance (N,) [m], a lower bound, see model.clearance.bisection; when
    that is (N,) [s]; how far places of the arm go at the most between two shapes that were looked
    at [m].
    """
    times, moving = way.starts, surroundings.moving
    if moving:
        # Parts on which obstacles move steadily, and the share of the way is a parabola.
        breaks = np.concatenate([way.progress.x, *(one.times for one in moving)])
        times = np.unique(breaks[(breaks >= 0) & (breaks <= way.starts[-1])])
    low, length = times[:-1], np.diff(times)
    parts = np.arange(low.size)

    def tensions(part: Counts, fraction: Array) -> Array:
        return way.at(low[part] + fraction * length[part])

    path, nearest = Moving(lines, tensions), []
    bodies = [*surroundings.obstacles, *(one.obstacle for one in moving)]
    for kind in [*[OBSTACLES] * bool(bodies), *[BASE, ITSELF] * surroundings.of_itself]:
        near = around(lines.arm, kind, bodies, surroundings.clearance)
        if kind == OBSTACLES and moving:
            ends, count = np.column_stack([low, times[1:]]), len(surroundings.obstacles)
            moved = [np.zeros((*ends.shape, 3))] * count
            moved += [one.displacement(ends) for one in moving]
            # A parabola is farthest from the line between its ends halfway.
            start, half, end = (tensions(parts, np.full(low.size, u)) for u in (0.0, 0.5, 1.0))
            off = np.linalg.norm(half - (start + end) / 2, axis=1)
            change = np.maximum(np.linalg.norm(end - start, axis=1), 1e-300)
            near = replace(near, moved=np.stack(moved, axis=2), uneven=off / change)
        nearest.append(closest(path, low.size, near))
    bounds = np.array([one.bound for one in nearest])
    least = bounds.argmin(axis=0), parts
    bound, when = bounds[least], low + np.array([one.share for one in nearest])[least] * length
    # The first of the least of each stretch.
    which = np.searchsorted(way.starts[1:], low, side="right")
    first = np.lexsort((bound, which))[np.searchsorted(which, np.arange(way.starts.size - 1))]
    return bound[first], when[first], max(float(one.step.max()) for one in nearest)
