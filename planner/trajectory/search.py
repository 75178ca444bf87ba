"""From what is asked of a motion to tensions at its waypoints and durations between them.

Plans for the targets one after another, each begun at the one before, are where the program over
the whole motion begins. Inequalities that keep clear are added where they are violated, at
waypoints and, by further waypoints without targets, between them; then it is solved again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from model.arm import Arm
from model.centreline import Centreline
from model.equilibrium.forward import STAGES, Collocation
from model.errors import InputError, OctoplanError
from model.paths import Array
from model.progress import told
from model.scene import Scene
from planner.avoidance.asked import Surroundings
from planner.avoidance.places import near_places, updated, watched_places
from planner.avoidance.rows import Avoidance
from planner.plan import Plan, plan
from planner.program.limits import Limits
from planner.program.problem import build, units
from planner.program.statement import Form, Statement
from planner.solve.task import allowed
from planner.targets.base import Target
from planner.trajectory.asked import Rates
from planner.trajectory.between import crossed
from planner.trajectory.coupled import Coupling, Stop, Way, lengths_of, solved

_ROUNDS = 8
# Steps of the program over the motion on the coarsest mesh, and on the one that plans want.
_COARSE_STEPS, _FINE_STEPS = 40, 4
# What waypoints keep besides the clearance, over L, for the way between them.
_SPARE = 1e-3


@dataclass(frozen=True, eq=False)
class Waypoint:
    """A place of a motion: the targets there, if any, tensions (n_tendons,) [N], inequalities.

    `share` is that of the time between two targets in which the arm goes there from the waypoint
    before, `plan` what was planned for it alone.
    """

    targets: tuple[Target, ...]
    tensions: Array
    avoidance: Avoidance | None
    share: float = 1.0
    plan: Plan | None = None

    @property
    def stated(self) -> tuple[Target, ...]:
        """The targets of its program."""
        rows = self.avoidance is not None and bool(self.avoidance.rows)
        return (*self.targets, self.avoidance) if rows else self.targets  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked of a motion; `start` are the tensions (n_tendons,) that it begins with [N]."""

    arm: Arm
    scene: Scene
    targets: tuple[tuple[Target, ...], ...]
    limits: Limits
    rates: Rates
    surroundings: Surroundings
    times: Array | None
    start: Array
    accuracy: float

    @property
    def least(self) -> Array:
        """The least time to each target from the one before [s]: what is given, or none."""
        if self.times is None:
            return np.zeros(len(self.targets))
        return np.diff(self.times, prepend=0.0)


def planned(question: Question, **others: Any) -> list[Waypoint]:
    """Return a waypoint for each target, planned one after another."""
    found: list[Waypoint] = []
    near: Plan | None = None
    around, limits = _wider(question), question.limits
    for i, targets in enumerate(told("waypoints", question.targets)):
        try:
            p = plan(
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
                **others,
            )
        except InputError as reason:
            name = f"targets[{i}]: {reason.field}"
            raise InputError(name, reason.given, reason.allowed) from None
        found.append(Waypoint(targets, np.ravel(p.tensions), p.avoidance, plan=p))
        near = p if p.mode == "exact" else near
    return found


def led(question: Question, ways: list[Waypoint]) -> tuple[list[Waypoint], Array]:
    """Return the waypoints of the best motion, and the durations (N,) before them [s]."""
    coupled, durations = _coupled(question, ways)
    if not question.surroundings:
        return coupled, durations
    for _ in range(_ROUNDS):
        corrected = [_corrected(question, way) for way in coupled]
        violated = any(new is not old for new, old in zip(corrected, coupled, strict=True))
        if not violated:
            corrected, violated = _parted(question, coupled)
        if not violated:
            break
        coupled, durations = _coupled(question, corrected)
    return coupled, durations


def _coupled(question: Question, ways: list[Waypoint]) -> tuple[list[Waypoint], Array]:
    """Return the waypoints with the tensions of the program over them all, and durations [s]."""
    fine = _statement(ways)
    unit = units(question.arm, question.limits)
    a = np.array([way.tensions for way in ways]) / unit
    for statement, steps in ((fine.but(refinement=1), _COARSE_STEPS), (fine, _FINE_STEPS)):
        stops = [_stop(question, way, statement) for way in ways]
        found: Way = solved(stops, _coupling(question, ways, stops[0]), a, steps)
        a = found.a
    T = np.clip(a * unit, question.limits.lower, question.limits.upper)
    return [replace(w, tensions=t) for w, t in zip(ways, T, strict=True)], found.durations


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


def _stop(question: Question, way: Waypoint, statement: Statement) -> Stop:
    """Return a waypoint as a program; tendons that may not pull there keep to their minima."""
    stated, limits = way.stated, question.limits
    # See planner.solve.task.Task.coarse.
    form: Form = statement.form if way.stated != way.targets else "condensed"
    problem = build(question.arm, stated, question.scene, statement.but(form=form))
    lbx, ubx, *rows = problem.free_bounds(limits)
    own = allowed(question.arm, stated, limits)
    held = np.array(own.upper) <= limits.lower
    ubx[: held.size][held] = lbx[: held.size][held]
    return Stop(problem, problem.parameters(stated, limits), (lbx, ubx, rows[0], rows[1]))


def _wider(question: Question) -> Surroundings:
    """Return what waypoints are planned to keep clear of: by a little more than is asked."""
    asked = question.surroundings
    if not asked:
        return asked
    return replace(asked, clearance=asked.clearance + _SPARE * question.arm.length)


def _statement(ways: list[Waypoint]) -> Statement:
    """Return a statement fine enough for all plans."""
    stated = [way.plan.statement for way in ways if way.plan is not None]
    finest = max(stated, key=lambda one: one.refinement)
    return finest.but(mode="exact")


def line_of(question: Question, T: Array) -> Centreline | None:
    """Return the centreline under tensions (n_tendons,); None where the arm does not settle."""
    places = tuple(Avoidance(()).stations(question.arm))
    try:
        forward = Collocation(question.arm, question.scene, STAGES, 3, places)
        return Centreline.at_states(forward.system, forward.found(T).states)
    except OctoplanError:
        return None


def _corrected(question: Question, way: Waypoint) -> Waypoint:
    """Return a waypoint with inequalities where it is too near; the same if it is not."""
    line, asked = line_of(question, way.tensions), _wider(question)
    if line is None or asked.keeps(line):
        return way
    return replace(way, avoidance=updated(way.avoidance, near_places(line, asked), line, asked))


def _parted(question: Question, ways: list[Waypoint]) -> tuple[list[Waypoint], bool]:
    """Return the waypoints with others between them where the way there touches something."""
    found, parted, before = [], False, question.start
    asked, settled = _wider(question), partial(line_of, question)
    for way in ways:
        share = crossed(settled, before, way.tensions, question.surroundings)
        line = (
            None if share is None else line_of(question, before + share * (way.tensions - before))
        )
        if line is not None and share is not None:
            T = before + share * (way.tensions - before)
            rows = updated(None, watched_places(line, asked), line, asked)
            found.append(Waypoint((), T, rows, share * way.share))
            way, parted = replace(way, share=(1 - share) * way.share), True
        found.append(way)
        before = way.tensions
    return found, parted
