"""Where the program over a motion begins: tensions for each target, found one after another.

The first is planned. From there each is stepped to from the one before, back to its constraints by
the shortest way and around what is near; where that does not lead there, it is planned as well.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from model.clearance.lines import Lines
from model.errors import InputError
from model.loads import is_loaded
from model.progress import told
from planner.avoidance.places import near_places, updated
from planner.plan import Plan, plan
from planner.program.problem import build, units
from planner.program.statement import Form, Statement
from planner.solve.task import allowed
from planner.targets.base import Target
from planner.trajectory.question import Question, Waypoint
from planner.trajectory.restoration import EXACT, Stop, restored

# Newton steps to the next target, and how often inequalities are added on the way.
_STEPS, _ROUNDS = 8, 4


def planned(question: Question, step: bool = True) -> list[Waypoint]:
    """Return a waypoint for each target, stepped to from the one before or planned."""
    found: list[Waypoint] = []
    near: Plan | None = None
    lines = question.lines()
    for i, targets in enumerate(told("waypoints", question.targets)):
        if step and near is not None:
            way = _stepped(question, targets, found[-1], coarse(near.statement), lines)
            if way is not None:
                found.append(way)
                continue
        try:
            p = _plan(question, targets, near)
        except InputError as reason:
            name = f"targets[{i}]: {reason.field}"
            raise InputError(name, reason.given, reason.allowed) from None
        found.append(Waypoint(targets, np.ravel(p.tensions), p.avoidance, plan=p))
        near = p if p.mode == "exact" else near
    return found


def coarse(statement: Statement) -> Statement:
    """Return a statement on the coarsest mesh."""
    return statement.but(mode="exact", refinement=1)


def stop_of(question: Question, way: Waypoint, statement: Statement) -> Stop:
    """Return a waypoint as a program; tendons that may not pull there keep to their minima."""
    stated, limits = way.stated, question.limits
    # See planner.solve.task.Task.coarse.
    form: Form = statement.form if way.stated != way.targets else "condensed"
    given = (question.arm, stated, question.scene, statement.but(form=form))
    problem = build(*given, question.machine_code)
    lbx, ubx, *rows = problem.free_bounds(limits)
    own = allowed(question.arm, stated, limits)
    held = np.array(own.upper) <= limits.lower
    ubx[: held.size][held] = lbx[: held.size][held]
    return Stop(problem, problem.parameters(stated, limits), (lbx, ubx, rows[0], rows[1]))


def corrected(question: Question, way: Waypoint, lines: Lines) -> Waypoint:
    """Return a waypoint with inequalities where it is too near; the same if it is not."""
    line, asked = lines(way.tensions), question.wider
    if line is None or asked.keeps(line):
        return way
    rows = updated(way.avoidance, near_places(line, asked), line, asked)
    return Waypoint(way.targets, way.tensions, rows, way.share, way.plan)


def _plan(question: Question, targets: tuple[Target, ...], near: Plan | None) -> Plan:
    around, limits = question.wider, question.limits
    ends: Any = limits.strokes or (None, None)
    return plan(
        question.arm,
        targets,
        question.scene,
        np.array(limits.upper),
        tension_min=np.array(limits.lower),
        total_pull=limits.total,
        accuracy=question.accuracy,
        near=near,
        obstacles=around.obstacles,
        clearance=around.clearance,
        self_clearance=around.of_itself,
        stroke_min=ends[0],
        stroke_max=ends[1],
        compile=question.machine_code,
    )


def _stepped(
    question: Question,
    targets: tuple[Target, ...],
    before: Waypoint,
    statement: Statement,
    lines: Lines,
) -> Waypoint | None:
    """Return a waypoint stepped to from the one before, None where that does not lead there."""
    unit = units(question.arm, question.limits)
    way = Waypoint(targets, before.tensions, before.avoidance)
    for _ in range(_ROUNDS):
        stop = stop_of(question, way, statement)
        a, at = restored(stop, way.tensions / unit, _STEPS)
        if not np.abs(stop.lack(at.g)).max(initial=0.0) < EXACT:
            return None
        T = np.clip(a * unit, question.limits.lower, question.limits.upper)
        if is_loaded(question.scene) and not stop.problem.stability(a, T) > 0:
            return None
        way = Waypoint(targets, T, way.avoidance)
        clear = corrected(question, way, lines) if question.surroundings else way
        if clear is way:
            return way
        way = clear
    return None
