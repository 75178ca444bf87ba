"""From tensions at the waypoints to a motion: the program over all, and the way between them.

Inequalities that keep clear are added where they are violated, at waypoints and, by further
waypoints without targets, between them; then it is solved again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.clearance.lines import Lines
from model.paths import Array
from planner.avoidance.places import updated, watched_places
from planner.program.problem import units
from planner.program.statement import Statement
from planner.trajectory.between import between
from planner.trajectory.coupled import Way, solved
from planner.trajectory.coupling import Coupling, lengths_of
from planner.trajectory.initial import coarse, corrected, stop_of
from planner.trajectory.question import Question, Waypoint
from planner.trajectory.restoration import Stop

_ROUNDS = 8
# Steps of the program over the motion on the coarsest mesh, and on the one that plans want.
_COARSE_STEPS, _FINE_STEPS = 40, 2
# Shares of the way where a further waypoint parts it.
_INSIDE = 0.02


def led(question: Question, ways: list[Waypoint]) -> tuple[list[Waypoint], Array, bool]:
    """Return the waypoints of the best motion, the durations (N,) before them [s], and a check.

    That tells whether each waypoint meets its constraints and the way between them seems clear.
    """
    coupled, durations, met = _coupled(question, ways)
    if not question.surroundings:
        return coupled, durations, met
    lines, violated = question.lines(), True
    for _ in range(_ROUNDS):
        new = [corrected(question, way, lines) for way in coupled]
        violated = any(one is not other for one, other in zip(new, coupled, strict=True))
        if not violated:
            new, violated = _parted(question, coupled, lines)
        if not violated:
            break
        coupled, durations, met = _coupled(question, new)
    return coupled, durations, met and not violated


def _coupled(question: Question, ways: list[Waypoint]) -> tuple[list[Waypoint], Array, bool]:
    """Return the waypoints with the tensions of the program over them all, durations [s], check."""
    fine = _statement(ways)
    unit = units(question.arm, question.limits)
    a, lam = np.array([way.tensions for way in ways]) / unit, None
    rough = [stop_of(question, way, coarse(fine)) for way in ways]
    for statement, steps in ((coarse(fine), _COARSE_STEPS), (fine, _FINE_STEPS)):
        stops = [stop_of(question, way, statement) for way in ways]
        found: Way = solved(stops, rough, _coupling(question, ways, stops[0]), a, steps, lam)
        a, lam = found.a, found.lam
    T = np.clip(a * unit, question.limits.lower, question.limits.upper)
    moved = [replace(way, tensions=own) for way, own in zip(ways, T, strict=True)]
    return moved, found.durations, found.missed <= question.accuracy


def _coupling(question: Question, ways: list[Waypoint], first: Stop) -> Coupling:
    """Return what couples the waypoints."""
    unit = units(question.arm, question.limits)
    start = question.start / unit
    lengths = np.zeros(start.size)
    if np.isfinite(question.rates.stroke):
        lengths = lengths_of(first.problem, start, first.p)[0]
    return Coupling(
        start,
        np.array(question.rates.tension) / unit,
        question.least,
        np.cumsum([0, *(bool(way.targets) for way in ways[:-1])]),
        np.array([way.share for way in ways]),
        question.times is not None,
        question.rates.stroke,
        lengths,
    )


def _statement(ways: list[Waypoint]) -> Statement:
    """Return a statement fine enough for all plans."""
    stated = [way.plan.statement for way in ways if way.plan is not None]
    finest = max(stated, key=lambda one: one.refinement)
    return finest.but(mode="exact")


def _parted(question: Question, ways: list[Waypoint], lines: Lines) -> tuple[list[Waypoint], bool]:
    """Return the waypoints with others between them where the way there touches something."""
    tensions = np.vstack([question.start, *(way.tensions for way in ways)])
    on_way, asked = between(lines, tensions, question.surroundings), question.wider
    found, parted = [], False
    for k, way in enumerate(ways):
        share = float(on_way.share[k])
        if on_way.bound[k] < 0 and _INSIDE < share < 1 - _INSIDE:
            T = tensions[k] + share * (tensions[k + 1] - tensions[k])
            line = lines(T)
            if line is not None:
                rows = updated(None, watched_places(line, asked), line, asked)
                found.append(Waypoint((), T, rows, share * way.share))
                way, parted = replace(way, share=(1 - share) * way.share), True
        found.append(way)
    return found, parted
