"""Motions that keep clear: how clear they are between waypoints, and more of these where not.

Inequalities that keep clear are added where they are violated, at waypoints and, by further
waypoints without targets, between them; then the program over all is solved again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.centreline import Counts
from model.clearance.bisection import Found, closest
from model.clearance.lines import Lines
from model.clearance.nearest import BASE, ITSELF, OBSTACLES, around
from model.clearance.way import Moving, Tensions
from model.obstacles import numbers_of
from model.obstacles.base import Convex
from model.paths import Array
from planner.avoidance.places import EXCHANGED, avoiding
from planner.avoidance.rows import Avoidance, Place
from planner.avoidance.surroundings import Surroundings
from planner.trajectory.question import Question
from planner.trajectory.time_law import Timed
from planner.trajectory.waypoints import Waypoint, Waypoints

# Shares of the way where a further waypoint parts it.
_INSIDE = 0.02


def cleared(question: Question) -> Waypoints:
    """Return the waypoints of the best motion that keeps clear, as far as that can be had."""
    waypoints = Waypoints(question)
    if not question.surroundings:
        return waypoints
    lines = question.lines()
    for _ in range(EXCHANGED):
        corrected = _corrected(question, waypoints, lines)
        if corrected is None or not waypoints.solve(corrected):
            break
    return waypoints


def _corrected(question: Question, before: Waypoints, lines: Lines) -> list[Waypoint] | None:
    """Return waypoints with inequalities where they, or the ways between, are too near."""
    timed = Timed.of(question, before.tensions, before.met_at)
    way_there = between(lines, timed, question.surroundings)
    too_near, starts = way_there.bound < 0, timed.starts
    fractions = (way_there.when - starts[:-1]) / np.diff(starts)
    inside = too_near & (fractions > _INSIDE) & (fractions < 1 - _INSIDE)
    beside = too_near | np.append(too_near[1:], False)
    waypoints, changed = list[Waypoint](), bool(inside.any())
    for k, waypoint in enumerate(before.waypoints):
        if inside[k]:
            T = timed.at(way_there.when[k : k + 1])[0]
            rows = _updated(question, lines, T, float(way_there.when[k]), Avoidance(()))
            waypoints.append(Waypoint((), T, rows, fractions[k] * waypoint.fraction))
            waypoint = replace(waypoint, fraction=(1 - fractions[k]) * waypoint.fraction)
        if beside[k]:
            end = waypoint.tensions, float(starts[k + 1])
            rows = _updated(question, lines, *end, waypoint.avoidance)
            changed |= rows is not waypoint.avoidance
            waypoint = replace(waypoint, avoidance=rows)
        waypoints.append(waypoint)
    return waypoints if changed else None


def _updated(
    question: Question, lines: Lines, T: Array, t: float, before: Avoidance | None
) -> Avoidance | None:
    """Return the inequalities of a waypoint at a time [s], with others where it is too near.

    Without those of obstacles that have moved on. Where there are none yet but are to be, `before`
    has no rows.
    """
    line, surroundings, is_new = lines(T), question.wider.at(t), before == Avoidance(())
    if line is None or (not is_new and surroundings.keeps(line)):
        return before
    if before is not None and question.wider.moving:
        convex = [one for one in surroundings.obstacles if isinstance(one, Convex)]
        numbers = {tuple(obstacle.tolist()) for obstacle in numbers_of(convex)}
        kept = (r for r in before.rows if isinstance(r.other, Place) or r.other in numbers)
        before = replace(before, rows=tuple(kept))
    return avoiding(line, surroundings, before)[0]


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
    """Return how clear an arm stays from each waypoint to the next.

    Where nothing but the arm moves, its pace does not matter, and is taken to be steady.
    """
    paced = way if surroundings.moving else way.steady
    breaks = [t for one in surroundings.moving for t in one.times if 0 < t < paced.starts[-1]]
    # Parts on which obstacles and arm move steadily.
    times = np.unique(np.concatenate([paced.knots, breaks]))
    low, length = times[:-1], np.diff(times)
    which = np.searchsorted(paced.starts[1:], low, side="right")

    def tensions(part: Counts, fraction: Array) -> Array:
        return paced.at(low[part] + fraction * length[part])

    moving, nearest = Moving(lines, tensions), list[Found]()
    bodies = [*surroundings.obstacles, *(one.obstacle for one in surroundings.moving)]
    for kind in [*[OBSTACLES] * bool(bodies), *[BASE, ITSELF] * surroundings.of_itself]:
        near = around(lines.arm, kind, bodies, surroundings.clearance)
        if kind == OBSTACLES:
            moved = np.zeros((low.size, 2, len(bodies), 3))
            for i, one in enumerate(surroundings.moving, start=len(surroundings.obstacles)):
                moved[:, :, i] = one.displacement(np.stack([low, low + length], axis=1))
            near = replace(near, moved=moved, uneven=_uneven(tensions, low.size))
        nearest.append(closest(moving, low.size, near))
    bounds = np.array([one.bound for one in nearest])
    least = bounds.argmin(axis=0), np.arange(low.size)
    bound, share = bounds[least], np.array([one.share for one in nearest])[least]
    first = np.lexsort((bound, which))[np.searchsorted(which, np.arange(way.starts.size - 1))]
    when = (low + share * length)[first]
    if not surroundings.moving:
        when = np.array([way.reaches(k, t - k) for k, t in enumerate(when)])
    return Between(bound[first], when, max(float(one.step.max()) for one in nearest))


def _uneven(tensions: Tensions, count: int) -> Array:
    """Return how far the share of tensions is at the most from the share of time, by part (P,).

    It is a parabola, which is farthest from the line between its ends halfway.
    """
    parts = np.arange(count)
    start, half, end = (tensions(parts, np.full(count, u)) for u in (0.0, 0.5, 1.0))
    length = np.linalg.norm(end - start, axis=1)
    off = np.linalg.norm(half - (start + end) / 2, axis=1)
    return np.asarray(off / np.maximum(length, 1e-300))
