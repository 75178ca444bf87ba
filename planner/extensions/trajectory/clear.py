"""Motions with clearance and stroke limits, which hold between waypoints too.

The program over all waypoints is solved repeatedly. Violated clearance inequalities are added at
waypoints. If the arm violates clearance or a stroke limit between two waypoints, a waypoint without
targets is inserted there. Stroke limits apply at all waypoints.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.polynomial import chebyshev

from octoplan.model.centreline import Counts
from octoplan.model.extensions.clearance.bisection import closest
from octoplan.model.extensions.clearance.nearest import BASE, ITSELF, OBSTACLES, clearance_query
from octoplan.model.extensions.obstacles.base import Convex, convex_parameters
from octoplan.model.paths import Array
from octoplan.model.support.errors import ConvergenceError, InputError
from octoplan.model.tendons import taken_in
from octoplan.planner.extensions.avoidance.lines import Lines, Moving
from octoplan.planner.extensions.avoidance.rows import ClearanceConstraints, Place, avoiding
from octoplan.planner.extensions.avoidance.surroundings import in_the_way
from octoplan.planner.extensions.trajectory.question import Question, Waypoint
from octoplan.planner.extensions.trajectory.time_law import INSTANTS, Stretch, Timed
from octoplan.planner.extensions.trajectory.waypoints import Waypoints
from octoplan.planner.planning_problem import Environment
from octoplan.planner.solve.refine import CORRECTIONS

# Smallest distance of an inserted waypoint from a neighbour, over the distance of the neighbours.
_INSIDE = 0.02


def cleared(question: Question) -> list[Waypoint]:
    """Return the waypoints of the best motion that satisfies clearance and stroke limits.

    If the corrections do not converge, some clearance may be violated, which the certificate
    detects. Raises InputError if the arm is too close to something before it moves.
    """
    if not question.surroundings and question.limits.strokes is None:
        return Waypoints(question).waypoints
    lines = question.lines()
    line = lines(question.start) if question.surroundings else None
    nearest = "" if line is None else in_the_way(question.surroundings.at(0.0), line)
    if nearest:
        distance = 1e3 * question.surroundings.clearance
        kept = f"{distance:g} mm of clearance" if distance else "clear"
        allowed = f"a start or obstacles that leave the arm {kept} before it moves: {nearest}"
        raise InputError("start", [round(float(T), 6) for T in question.start], allowed)
    waypoints = Waypoints(question)
    for _ in range(CORRECTIONS):
        corrected = _corrected(question, waypoints.waypoints, lines)
        # Unchanged waypoints are the same objects, so that this detects convergence.
        if corrected == waypoints.waypoints or not waypoints.solve(corrected):
            break
    return waypoints.waypoints


def _corrected(question: Question, before: list[Waypoint], lines: Lines) -> list[Waypoint]:
    """Return the waypoints, with clearance inequalities and inserted waypoints at violations."""
    way = Timed.of(question, before)
    waypoints = list[Waypoint]()
    bound, when, _ = between(lines, way, question.surroundings)
    starts = way.starts
    too_near = bound < 0
    violated = too_near
    if question.limits.strokes is not None:
        slack, stroke_when, _ = strokes_between(question, lines, way)
        violated = too_near | (slack < 0)
        when = np.where(too_near, when, stroke_when)
    shares = (when - starts[:-1]) / np.diff(starts)
    inside = violated & (shares > _INSIDE) & (shares < 1 - _INSIDE)
    beside = too_near | np.append(too_near[1:], False)
    for k, waypoint in enumerate(before):
        if inside[k]:
            T = way.at(when[k : k + 1])[0]
            whole = waypoint.fraction
            inserted = Waypoint((), T, fraction=shares[k] * whole)
            waypoints.append(_updated(question, lines, inserted, float(when[k])))
            waypoint = replace(waypoint, fraction=(1 - shares[k]) * whole)
        if beside[k]:
            waypoint = _updated(question, lines, waypoint, float(starts[k + 1]))
        waypoints.append(waypoint)
    return waypoints


def _updated(question: Question, lines: Lines, waypoint: Waypoint, t: float) -> Waypoint:
    """Return a waypoint with clearance inequalities for a time [s], if it is too close or new.

    Inequalities of obstacles that have moved since are removed.
    """
    line = lines(waypoint.tensions)
    surroundings = question.wider.at(t)
    before = waypoint.avoidance
    assert before is None or isinstance(before, ClearanceConstraints)
    is_stated = bool(waypoint.targets or waypoint.avoidance)
    if line is None or (is_stated and not in_the_way(surroundings, line)):
        return waypoint
    if before is not None and question.wider.moving:
        convex = [one for one in surroundings.obstacles if isinstance(one, Convex)]
        present = {tuple(obstacle.tolist()) for obstacle in convex_parameters(convex)}
        kept = (r for r in before.rows if isinstance(r.other, Place) or r.other in present)
        before = replace(before, rows=tuple(kept))
    return replace(waypoint, avoidance=avoiding(line, surroundings, before)[0])


def between(lines: Lines, way: Timed, surroundings: Environment) -> tuple[Array, Array, float]:
    """Return the smallest clearance of the arm from each of N waypoints to the next.

    The results are a lower bound of the distance minus the required clearance (N,) [m], see
    octoplan.model.extensions.clearance.bisection; its time (N,) [s]; and the largest displacement
    of a point of the arm between two evaluated shapes [m]. The bound is inf without surroundings.
    """
    if not surroundings:
        return np.full(way.starts.size - 1, np.inf), way.starts[:-1], 0.0
    times = way.starts
    moving = surroundings.moving
    if moving:
        # Intervals on which obstacles have constant velocity, and the progress is a parabola.
        breaks = np.concatenate([way.progress.x, *(one.times for one in moving)])
        times = np.unique(breaks[(breaks >= 0) & (breaks <= way.starts[-1])])
    low = times[:-1]
    length = np.diff(times)
    parts = np.arange(low.size)

    def tensions(part: Counts, fraction: Array) -> Array:
        return way.at(low[part] + fraction * length[part])

    path = Moving(lines, tensions)
    nearest = []
    bodies = [*surroundings.obstacles, *(one.obstacle for one in moving)]
    for kind in [*[OBSTACLES] * bool(bodies), *[BASE, ITSELF] * surroundings.of_itself]:
        near = clearance_query(lines.arm, kind, bodies, surroundings.clearance)
        if kind == OBSTACLES and moving:
            ends = np.column_stack([low, times[1:]])
            count = len(surroundings.obstacles)
            moved = [np.zeros((*ends.shape, 3))] * count
            moved += [one.displacement(ends) for one in moving]
            # A parabola deviates most from the chord in the middle.
            start, half, end = (tensions(parts, np.full(low.size, u)) for u in (0.0, 0.5, 1.0))
            off = np.linalg.norm(half - (start + end) / 2, axis=1)
            change = np.maximum(np.linalg.norm(end - start, axis=1), 1e-300)
            near = replace(near, moved=np.stack(moved, axis=2), uneven=off / change)
        nearest.append(closest(path, low.size, near))
    bounds = np.array([one.bound for one in nearest])
    least = bounds.argmin(axis=0), parts
    bound = bounds[least]
    when = low + np.array([one.share for one in nearest])[least] * length
    # Sort the parts by stretch and bound: the first part of each stretch has the smallest bound.
    which = np.searchsorted(way.starts[1:], low, side="right")
    first = np.lexsort((bound, which))[np.searchsorted(which, np.arange(way.starts.size - 1))]
    return bound[first], when[first], max(float(one.step.max()) for one in nearest)


def strokes_between(
    question: Question, lines: Lines, way: Timed
) -> tuple[Array, Array, tuple[int, ...]]:
    """Return the margins of stroke limits from each of N waypoints to the next.

    The results are the smallest margin plus the accuracy of strokes (N,) [m], inf without limits;
    the time of the smallest margin (N,) [s]; and the waypoints before which the arm jumps or has no
    equilibrium.
    """
    limits = question.limits
    within = question.accuracy * question.arm.length
    margins = np.full(way.starts.size - 1, np.inf)
    when = way.starts[:-1].copy()
    jumps = list[int]()
    for k, ends in enumerate(pairwise(way.controls)):
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
            smallest = np.minimum(taken - low, high - taken).min(axis=1) + within
            margins[k] = smallest.min()
            when[k] = t[smallest.argmin()]
    return margins, when, tuple(jumps)
