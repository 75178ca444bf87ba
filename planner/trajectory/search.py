"""From tensions at the waypoints to a motion: the program over all, and the way between them.

Inequalities that keep clear are added where they are violated, at waypoints and, by further
waypoints without targets, between them; then it is solved again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.arm import Arm
from model.clearance.lines import Lines
from model.paths import Array
from planner.avoidance.places import updated, watched_places
from planner.program.problem import units
from planner.program.statement import Statement
from planner.trajectory.between import between
from planner.trajectory.coupled import Way, solved
from planner.trajectory.coupling import Coupling, lengths_of
from planner.trajectory.initial import coarse, corrected, stop_of, unverified
from planner.trajectory.question import Question, Waypoint
from planner.trajectory.restoration import Stop
from planner.trajectory.time_law import TimeLaw
from planner.trajectory.timed import Timed

_ROUNDS = 20
# Steps of the program over the motion on the coarsest mesh, and on the one that plans want.
_COARSE_STEPS, _FINE_STEPS = 40, 1
# How much less exact the former are.
_ROUGHLY = 50.0
# Shares of the way where a further waypoint parts it.
_INSIDE = 0.02


def led(question: Question, ways: list[Waypoint]) -> tuple[list[Waypoint], Array, bool]:
    """Return the waypoints of the best motion, the durations (N,) before them [s], and a check.

    That tells whether each waypoint meets its constraints and the way between them seems clear.
    """
    coupled, durations, met = _coupled(question, ways)
    if not question.surroundings:
        return coupled, durations, met
    lines = question.lines()
    for _ in range(_ROUNDS):
        new = _cleared(question, coupled, durations, lines)
        if new is None:
            return coupled, durations, met
        coupled, durations, met = _coupled(question, new)
    return coupled, durations, met and _cleared(question, coupled, durations, lines) is None


def _cleared(
    question: Question, ways: list[Waypoint], durations: Array, lines: Lines
) -> list[Waypoint] | None:
    """Return waypoints with inequalities where they, or the ways between, are too near."""
    tensions = np.vstack([question.start, *(way.tensions for way in ways)])
    timed = _timed(question, ways, tensions, durations)
    times, laws = timed.starts, timed.laws
    near = unverified(lines, tensions, times, question.wider, laws)
    if not near:
        return None
    found = between(lines, tensions, times, question.surroundings, laws)
    new, changed = [], False
    for k, way in enumerate(ways):
        share = float(found.share[k])
        if found.bound[k] < 0 and _INSIDE < share < 1 - _INSIDE:
            T = tensions[k] + share * (tensions[k + 1] - tensions[k])
            line = lines(T)
            when = float(np.interp(share, laws[k].shares, laws[k].times))
            asked = question.wider.at(times[k] + when)
            if line is not None:
                rows = updated(None, watched_places(line, asked), line, asked)
                new.append(Waypoint((), T, rows, share * way.share))
                way, changed = replace(way, share=(1 - share) * way.share), True
        clear = corrected(question, way, lines, times[k + 1]) if k in near else None
        new.append(clear or way)
        changed = changed or clear is not None
    return new if changed else None


def _timed(question: Question, ways: list[Waypoint], tensions: Array, durations: Array) -> Timed:
    """Return the way with its pace; a steady one where nothing moves, as it is not asked for."""
    if not question.surroundings.moving:
        return Timed(tensions, tuple(TimeLaw.steady(max(own, 1e-9)) for own in durations))
    stops = tuple(i + 1 for i, way in enumerate(ways) if way.targets)
    return Timed.of(question, tensions, durations, stops)


def _coupled(question: Question, ways: list[Waypoint]) -> tuple[list[Waypoint], Array, bool]:
    """Return the waypoints with the tensions of the program over them all, durations [s], check."""
    fine, ways = _statement(ways), _alike(question.arm, ways)
    unit = units(question.arm, question.limits)
    a, lam = np.array([way.tensions for way in ways]) / unit, None
    rough = stops = _stops(question, ways, coarse(fine), a)
    phases = ((coarse(fine), _COARSE_STEPS, _ROUGHLY), (fine, _FINE_STEPS, 1.0))
    for statement, steps, rather in phases:
        if statement is fine:
            stops = _stops(question, ways, fine, a)
        found: Way = solved(
            stops, rough, _coupling(question, ways, stops[0]), a, steps, lam, rather
        )
        a, lam = found.a, found.lam
    T = np.clip(a * unit, question.limits.lower, question.limits.upper)
    moved = [replace(way, tensions=own) for way, own in zip(ways, T, strict=True)]
    return moved, found.durations, found.missed <= question.accuracy


def _alike(arm: Arm, ways: list[Waypoint]) -> list[Waypoint]:
    """Return waypoints whose inequalities are of one structure, so that they share a program."""
    needed = [way.avoidance.needed(arm) for way in ways if way.avoidance]
    room = tuple(max(own) for own in zip(*(own for own in needed if own), strict=True))
    return [
        replace(way, avoidance=replace(way.avoidance, room=room)) if way.avoidance else way
        for way in ways
    ]


def _stops(question: Question, ways: list[Waypoint], statement: Statement, a: Array) -> list[Stop]:
    """Return waypoints as programs, each settled near the one before at scaled tensions (N, n)."""
    stops = (stop_of(question, way, statement) for way in ways)
    return [stop.apart(own) for stop, own in zip(stops, a, strict=True)]


def _coupling(question: Question, ways: list[Waypoint], first: Stop) -> Coupling:
    """Return what couples the waypoints."""
    unit = units(question.arm, question.limits)
    start = question.start / unit
    lengths = np.zeros(start.size)
    if np.isfinite(question.rates.pace):
        lengths = lengths_of(first.problem, start, first.p)[0]
    return Coupling(
        start,
        np.array(question.rates.tension) / unit,
        question.least,
        np.cumsum([0, *(bool(way.targets) for way in ways[:-1])]),
        np.array([way.share for way in ways]),
        question.times is not None,
        question.rates.pace,
        lengths,
    )


def _statement(ways: list[Waypoint]) -> Statement:
    """Return a statement fine enough for all plans."""
    stated = [way.plan.statement for way in ways if way.plan is not None]
    finest = max(stated, key=lambda one: one.refinement)
    return finest.but(mode="exact")
