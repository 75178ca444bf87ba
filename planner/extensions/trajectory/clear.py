"""Motions that keep clear and within limits of strokes, by further waypoints where they do not.

Inequalities that keep clear are added where they are violated, at waypoints and, by further
waypoints without targets, between them; then the program over all is solved again. Limits of
strokes hold at all waypoints, and where they are passed between two there is a further one.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.polynomial import chebyshev

from octoplan.model.centreline import Counts
from octoplan.model.extensions.clearance.bisection import closest
from octoplan.model.extensions.clearance.nearest import BASE, ITSELF, OBSTACLES, around
from octoplan.model.extensions.obstacles import numbers_of
from octoplan.model.extensions.obstacles.base import Convex
from octoplan.model.paths import Array
from octoplan.model.support.errors import ConvergenceError, InputError
from octoplan.planner.extensions.avoidance.lines import Lines, Moving
from octoplan.planner.extensions.avoidance.rows import Place, avoiding
from octoplan.planner.extensions.avoidance.surroundings import Environment
from octoplan.planner.extensions.trajectory.question import Question, Waypoint
from octoplan.planner.extensions.trajectory.time_law import INSTANTS, Stretch, Timed
from octoplan.planner.extensions.trajectory.waypoints import Waypoints
from octoplan.planner.measure import taken_in
from octoplan.planner.solve.refine import CORRECTIONS

# Shares of the way where a further waypoint parts it.
_INSIDE = 0.02


def cleared(question: Question) -> list[Waypoint]:
    """Return the waypoints of the best motion that keeps clear, as far as that can be had.

    And within limits of strokes. Raises InputError where the arm is too near to something before it
    moves.
    """
    if not question.surroundings and question.limits.strokes is None:
        return Waypoints(question).waypoints
    lines = question.lines()
    line = lines(question.start) if question.surroundings else None
    nearest = "" if line is None else question.surroundings.at(0.0).in_the_way(line)
    if nearest:
        distance = 1e3 * question.surroundings.clearance
        kept = f"{distance:g} mm of clearance" if distance else "clear"
        allowed = f"a start or obstacles that leave the arm {kept} before it moves: {nearest}"
        raise InputError("start", [round(float(T), 6) for T in question.start], allowed)
    waypoints = Waypoints(question)
    for _ in range(CORRECTIONS):
        corrected = _corrected(question, waypoints.waypoints, lines)
        # Those that keep clear are the same objects.
        if corrected == waypoints.waypoints or not waypoints.solve(corrected):
            break
    return waypoints.waypoints


def _corrected(question: Question, before: list[Waypoint], lines: Lines) -> list[Waypoint]:
    """Return waypoints with inequalities where they, or the ways between, are too near.

    And with further ones where limits of strokes are passed between them.
    """
    way, waypoints = Timed.of(question, before), list[Waypoint]()
    (bound, when, _), starts = between(lines, way, question.surroundings), way.starts
    too_near, parted = bound < 0, bound < 0
    if question.limits.strokes is not None:
        left, then, _ = strokes_between(question, lines, way)
        parted, when = too_near | (left < 0), np.where(too_near, when, then)
    shares = (when - starts[:-1]) / np.diff(starts)
    inside = parted & (shares > _INSIDE) & (shares < 1 - _INSIDE)
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


def between(lines: Lines, way: Timed, surroundings: Environment) -> tuple[Array, Array, float]:
    """Return how clear an arm stays from each of N waypoints to the next.

    What is kept besides the clearance (N,) [m], a lower bound, see
    octoplan.model.extensions.clearance.bisection; when that is (N,) [s]; how far places of the arm
    go at the most between two shapes that were looked at [m]. Infinite where there is nothing to
    keep clear of.
    """
    if not surroundings:
        return np.full(way.starts.size - 1, np.inf), way.starts[:-1], 0.0
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


def strokes_between(
    question: Question, lines: Lines, way: Timed
) -> tuple[Array, Array, tuple[int, ...]]:
    """Return what is left of limits of strokes from each of N waypoints to the next.

    The least (N,) [m], below 0 where they are passed by more than strokes are met to, infinite
    without limits; when that is (N,) [s]; the waypoints on the way to which no arm stands or it
    jumps, under loads, or where limits are to be verified.
    """
    limits, within = question.limits, question.accuracy * question.arm.length
    left, when, jumps = np.full(way.starts.size - 1, np.inf), way.starts[:-1].copy(), list[int]()
    for k, ends in enumerate(pairwise(way.tensions)):
        try:
            stretch = Stretch.of(lines.lengths, *ends, within)
        except ConvergenceError:
            jumps.append(k + 1)
            continue
        if limits.strokes is not None:
            t = np.linspace(way.starts[k], way.starts[k + 1], INSTANTS + 1)
            lengths = chebyshev.chebval(2 * (way.progress(t) - k) - 1, stretch.coefficients).T
            taken = taken_in(question.arm, lengths, limits.stroke_zero)
            low, high = np.array(limits.strokes)
            least = np.minimum(taken - low, high - taken).min(axis=1) + within
            left[k], when[k] = least.min(), t[least.argmin()]
    return left, when, tuple(jumps)
