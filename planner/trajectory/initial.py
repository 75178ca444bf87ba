"""Where the program over a motion begins: tensions for each target, found one after another.

The first is planned. From there each is stepped to from the one before, back to its constraints by
the shortest way and around what is near; where that does not lead there, it is planned as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from model.clearance.lines import Lines
from model.errors import InputError
from model.loads import is_loaded
from model.obstacles import numbers_of
from model.obstacles.base import Convex, Translated
from model.obstacles.mesh import TranslatedMesh
from model.paths import Array
from model.progress import told
from planner.avoidance.asked import Surroundings
from planner.avoidance.places import near_places, updated
from planner.avoidance.rows import Avoidance, Place
from planner.program.problem import build, units
from planner.program.statement import Statement
from planner.solve.task import allowed
from planner.targets.base import Target
from planner.trajectory.between import between
from planner.trajectory.question import Question, Waypoint
from planner.trajectory.restoration import EXACT, Stop, restored
from planner.trajectory.time_law import TimeLaw

# Newton steps to the next target, and how often inequalities are added on the way.
_STEPS, _ROUNDS = 8, 4


def planned(question: Question, step: bool = True) -> list[Waypoint]:
    """Return a waypoint for each target, stepped to from the one before or planned.

    Whether those that are stepped to keep clear is looked at together; from the first that does
    not, it is looked at step by step.
    """
    lines = question.lines()
    found = _chain(question, [], lines if step else None, False)
    if not (step and question.surroundings):
        return found
    tensions = np.vstack([question.start, *(way.tensions for way in found)])
    times = np.append(0.0, np.cumsum(question.least))
    near = unverified(lines, tensions, times, replace(question.wider, moving=()))
    lost = [i for i in near if found[i].plan is None and corrected(question, found[i], lines)]
    return _chain(question, found[: lost[0]], lines, True) if lost else found


def unverified(
    lines: Lines,
    tensions: Array,
    times: Array,
    asked: Surroundings,
    laws: Sequence[TimeLaw] | None = None,
) -> list[int]:
    """Return the waypoints on the way to or from which an arm may not keep clear as planned.

    Of tensions (N + 1, n_tendons) at times (N + 1,) [s], the first where the motion begins; see
    planner.trajectory.between for the pace of laws.
    """
    kept = between(lines, tensions, times, asked, laws).bound >= 0
    kept = kept & np.append(kept[1:], True)
    return [int(i) for i in np.flatnonzero(~kept)]


def _chain(
    question: Question, found: list[Waypoint], lines: Lines | None, keeps_clear: bool
) -> list[Waypoint]:
    """Return what is found and the waypoints after it; they are stepped to where lines are given.

    With `keeps_clear` each step does.
    """
    found, near = list(found), next((w.plan for w in reversed(found) if w.plan), None)
    left = question.targets[len(found) :]
    for i, targets in enumerate(told("waypoints", left), start=len(found)):
        if lines is not None and near is not None:
            way = _stepped(
                question, targets, found[-1], coarse(near.statement), lines if keeps_clear else None
            )
            if way is not None:
                found.append(way)
                continue
        try:
            p = question.planned(targets, near)
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
    given = (question.arm, stated, question.scene, statement)
    problem = build(*given, question.machine_code)
    lbx, ubx, *rows = problem.free_bounds(limits)
    own = allowed(question.arm, stated, limits)
    held = np.flatnonzero(np.array(own.upper) <= limits.lower)
    ubx = ubx.copy()
    ubx[held] = lbx[held]
    bounds = (lbx, ubx, rows[0], rows[1])
    return Stop(problem, problem.parameters(stated, limits), bounds, problem.condensed)


def corrected(
    question: Question, way: Waypoint, lines: Lines, t: float | None = None
) -> Waypoint | None:
    """Return a waypoint with inequalities where it is too near; None if it is not.

    Too near to what moves as well, where a time [s] is given.
    """
    line, asked = lines(way.tensions), question.wider
    asked = replace(asked, moving=()) if t is None else asked.at(t)
    if line is None or asked.keeps(line):
        return None
    rows = updated(_still(way.avoidance, asked), near_places(line, asked), line, asked)
    return Waypoint(way.targets, way.tensions, rows, way.share, way.plan)


def _still(avoidance: Avoidance | None, asked: Surroundings) -> Avoidance | None:
    """Return inequalities without those of obstacles that have moved on."""
    if avoidance is None:
        return None
    convex = [own for own in asked.obstacles if isinstance(own, Convex)]
    there = {tuple(own.tolist()) for own in numbers_of(convex)}
    moved = isinstance((*asked.obstacles, None)[-1], Translated | TranslatedMesh)
    rows = [
        row
        for row in avoidance.rows
        if not moved or isinstance(row.other, Place) or row.other in there
    ]
    return replace(avoidance, rows=tuple(rows))


def _stepped(
    question: Question,
    targets: tuple[Target, ...],
    before: Waypoint,
    statement: Statement,
    lines: Lines | None,
) -> Waypoint | None:
    """Return a waypoint stepped to from the one before, None where that does not lead there.

    It keeps clear where lines are given.
    """
    unit = units(question.arm, question.limits)
    way = Waypoint(targets, before.tensions, before.avoidance)
    for _ in range(_ROUNDS):
        stop = stop_of(question, way, statement)
        a, at = restored(stop, way.tensions / unit, _STEPS)
        if not np.abs(stop.lack(at.g)).max(initial=0.0) < EXACT:
            return None
        T = np.clip(a * unit, question.limits.lower, question.limits.upper)
        if is_loaded(question.scene) and not stop.functions.stands:
            return None
        way = Waypoint(targets, T, way.avoidance)
        clear = corrected(question, way, lines) if lines and question.surroundings else None
        if clear is None:
            return way
        way = clear
    return None
