"""From targets to tensions at the waypoints of a motion: one program over all of them.

It is solved from the plan for the first target, or, where that does not lead to all others, from
plans for each. The mesh is coarse. What targets measure on it is off from that of the settled arm
by a defect, which changes little from one optimum to the next: bounds are shifted by it, and the
program is solved again, warm, until the settled arm meets them (deferred correction).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from model.effects import Extension
from model.errors import InputError, OctoplanError
from model.loads import is_loaded
from model.paths import Array
from model.progress import tell, told
from model.time_limit import OutOfTime
from planner.avoidance.rows import Avoidance
from planner.measure import compliances_along
from planner.plan import Plan
from planner.program.objective import STRETCH
from planner.program.problem import build, units
from planner.settled import settled
from planner.solve.ipopt import Solution
from planner.solve.task import allowed
from planner.targets.base import Target
from planner.trajectory.program import Coupling, MotionProgram, Stop
from planner.trajectory.question import Question

# What the least stretch of the settled arm may be below that on a coarse mesh.
_CRUSHED = 0.02
# The part of the accuracy that is left to rows, and how often they are corrected.
_SHARE, _CORRECTED = 4, 8


@dataclass(frozen=True, eq=False)
class Waypoint:
    """A place of a motion: the targets there, if any, tensions (n_tendons,) [N], inequalities.

    `share` is that of the time between two targets in which the arm goes there from the waypoint
    before.
    """

    targets: tuple[Target, ...]
    tensions: Array
    avoidance: Avoidance | None = None
    share: float = 1.0

    @property
    def stated(self) -> tuple[Target, ...]:
        """The targets of its program."""
        rows = self.avoidance is not None and bool(self.avoidance.rows)
        return (*self.targets, self.avoidance) if rows else self.targets  # type: ignore[arg-type]


class Waypoints:
    """The waypoints of a motion; `ways` are the best so far, `met` whether that is an optimum."""

    def __init__(self, question: Question) -> None:
        self.question = question
        self.unit = units(question.arm, question.limits)
        first = question.planned(question.targets[0], None)
        _check_reached([first])
        self.statement = first.statement.but(
            mode="exact",
            refinement=1 if question.scene.has(Extension) else 2,
            wound=question.limits.strokes is not None or bool(np.isfinite(question.rates.pace)),
        )
        T, rows = np.ravel(first.tensions), first.avoidance
        self.met = self.solve([Waypoint(targets, T, rows) for targets in question.targets])
        if not self.met:
            self.met = self.solve(self._one_by_one(first))

    def solve(self, ways: Sequence[Waypoint]) -> bool:
        """Put optimal tensions in place of those of waypoints; return whether there are any.

        Where the arm would not stand at all of them, it is held to its stability margin, or at
        least to stand.
        """
        self.ways, planned = self._alike(ways), self.statement
        held = planned.but(modes=1)
        loaded = is_loaded(self.question.scene)
        for statement in dict.fromkeys((planned, *[held, held.but(margin=0.0)] * loaded)):
            self.statement = statement
            if self._optimum() is not None:
                return True
        self.statement = planned
        return False

    @property
    def tensions(self) -> Array:
        """The tensions (N + 1, n_tendons) from where the motion begins [N]."""
        return np.vstack([self.question.start, *(way.tensions for way in self.ways)])

    @property
    def met_at(self) -> tuple[int, ...]:
        """At which of these each target is met."""
        return tuple(k for k, way in enumerate(self.ways, start=1) if way.targets)

    def _one_by_one(self, first: Plan) -> list[Waypoint]:
        """Return waypoints that are planned one after the other; InputError if one cannot be."""
        plans = [first]
        for i, targets in enumerate(told("waypoints", self.question.targets[1:]), start=1):
            near = next(own for own in reversed(plans) if own.mode == "exact")
            try:
                plans.append(self.question.planned(targets, near))
            except InputError as reason:
                name = f"targets[{i}]: {reason.field}"
                raise InputError(name, reason.given, reason.allowed) from None
        _check_reached(plans)
        pairs = zip(self.question.targets, plans, strict=True)
        return [Waypoint(own, np.ravel(p.tensions), p.avoidance) for own, p in pairs]

    def _alike(self, ways: Sequence[Waypoint]) -> list[Waypoint]:
        """Return waypoints whose inequalities share a structure, so that they share a program."""
        kept = [way.avoidance.needed(self.question.arm) for way in ways if way.avoidance]
        room = tuple(max(own) for own in zip(*(own for own in kept if own), strict=True))
        return [
            replace(way, avoidance=replace(way.avoidance, room=room)) if way.avoidance else way
            for way in ways
        ]

    def _optimum(self) -> Solution | None:
        """Move the waypoints to the optimum; None without one, or where the arm does not stand."""
        stops = [self._stop(way) for way in self.ways]
        program = MotionProgram(stops, self._coupling(), self._guess(stops))
        defects, solution = [self._expected(stop) for stop in stops], None
        for k in range(_CORRECTED):
            tell("program over the waypoints", k, _CORRECTED)
            solution = program.solve(defects, solution)
            if not (solution.met and solution.finite):
                return None
            x = program.waypoints(solution.x)
            tensions = [
                s.problem.tensions(own, self.question.limits)
                for s, own in zip(stops, x, strict=True)
            ]
            pairs = list(zip(stops, x, tensions, strict=True))
            if not k and not all(stop.problem.stability(own, T) > 0 for stop, own, T in pairs):
                return None
            self.ways = [
                replace(way, tensions=T) for way, T in zip(self.ways, tensions, strict=True)
            ]
            try:
                defects = [self._defect(stop, own, T) for stop, own, T in pairs]
            except OctoplanError:
                break
            worst = max(_violation(*own) for own in zip(stops, x, defects, strict=True))
            if worst <= self.question.accuracy / _SHARE:
                break
        return solution

    def _stop(self, way: Waypoint) -> Stop:
        """Return a waypoint as a program; tendons that may not pull there keep to their minima."""
        asked = self.question
        problem = build(asked.arm, way.stated, asked.scene, self.statement, asked.machine_code)
        lbx, ubx, lbg, ubg = problem.bounds(asked.limits)
        own = allowed(asked.arm, way.stated, asked.limits)
        held = np.flatnonzero(np.array(own.upper) <= asked.limits.lower)
        ubx = ubx.copy()
        ubx[held] = lbx[held]
        p = problem.parameters(way.stated, asked.limits)
        return Stop(problem, way.stated, p, (lbx, ubx, lbg, ubg))

    def _guess(self, stops: Sequence[Stop]) -> list[Array]:
        """Return unknowns for the tensions at the waypoints, many of which may be the same."""
        guesses, known = [], dict[tuple[int, bytes], Array]()
        for stop, way in zip(stops, self.ways, strict=True):
            key = id(stop.problem), way.tensions.tobytes()
            if key not in known:
                known[key] = stop.problem.guess(way.tensions, self.question.limits, stop.p)
            guesses.append(known[key])
        return guesses

    def _coupling(self) -> Coupling:
        """Return what couples the waypoints."""
        asked, begin = self.question, np.zeros(self.unit.size)
        if np.isfinite(asked.rates.pace):
            begin = asked.lines().lengths(asked.start)
        group = np.cumsum([0, *(bool(way.targets) for way in self.ways[:-1])])
        shares = np.array([way.share for way in self.ways])
        rate = np.array(asked.rates.tension)
        return Coupling(
            asked.start, begin, self.unit, rate, asked.rates.pace, group, shares, asked.steps
        )

    def _expected(self, stop: Stop) -> Array:
        """Return defects before they are known: the arm may be crushed between stages."""
        at = [
            row.name == STRETCH for row in stop.problem.program.outer_rows for _ in range(row.size)
        ]
        return np.where(at, -_CRUSHED, 0.0)

    def _defect(self, stop: Stop, x: Array, T: Array) -> Array:
        """Return what rows besides equilibrium are of the settled arm, less what they are in x."""
        asked, problem = self.question, stop.problem
        shape = settled(asked.arm, T, asked.scene, asked.accuracy, asked.machine_code)
        directions = problem.directions(stop.targets)
        off = compliances_along(asked.arm, stop.targets, shape) - problem.compliances(x, directions)
        there = problem.with_measured(x, shape.poses(np.array(problem.stations)), off, directions)
        if self.statement.wound:
            there[problem.program.blocks.lengths] = shape.tendon_lengths / asked.arm.length
        values = problem.program.values
        change = values(there, stop.p)[1][0] - values(x, stop.p)[1][0]
        return np.asarray(change + self._expected(stop))


def _violation(stop: Stop, x: Array, defect: Array) -> float:
    """Return by how much the rows of the settled arm violate their bounds at most."""
    rows = stop.problem.program.values(x, stop.p)[1][0] + defect
    low, high = (own[: rows.size] for own in stop.bounds[2:])
    return float(np.maximum(low - rows, rows - high).max(initial=0.0))


def _check_reached(plans: Sequence[Plan]) -> None:
    """Raise InputError that tells from where to where a path cannot be followed."""
    missed = [i for i, own in enumerate(plans) if own.mode != "exact"]
    if not missed:
        return
    last = missed[0]
    while last + 1 in missed:
        last += 1
    if plans[missed[0]].stopped:
        raise OutOfTime
    place = f"targets[{missed[0]}]" if last == missed[0] else f"targets[{missed[0]}] to [{last}]"
    raise InputError(place, "out of reach", f"targets that can be met: {plans[missed[0]].outcome}")
