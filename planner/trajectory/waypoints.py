"""From targets to tensions at the waypoints of a motion: one program over all of them.

It begins at an optimum of each target by itself. Those along a path are followed, each from the one
before, and compared with plans, which are the best of several optima: where the two differ the
path has left the better branch, and is followed anew from the plan. The mesh is coarse. What
targets measure on it is off from that of the settled arm by a defect, which changes little from one
optimum to the next: bounds are shifted by it, and the program is solved again, warm, until the
settled arm meets them (deferred correction).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from model.effects import Extension
from model.errors import InputError, OctoplanError
from model.loads import is_loaded
from model.paths import Array
from model.progress import tell
from model.time_limit import OutOfTime
from planner.plan import Plan
from planner.program.objective import STRETCH
from planner.program.problem import Problem
from planner.solve.ipopt import Candidate, Solution, solve
from planner.solve.refine import defect, settled
from planner.solve.task import allowed
from planner.solve.warm_start import jump
from planner.targets.base import Target
from planner.trajectory.program import MotionProgram, Stop, Waypoint
from planner.trajectory.question import Question

# What the least stretch of the settled arm may be below that on a coarse mesh.
_CRUSHED = 0.02
# The part of the accuracy that is left to rows, and how often they are corrected.
_SHARE, _CORRECTED = 4, 8


class Waypoints:
    """The waypoints of a motion; `waypoints` are the best so far."""

    def __init__(self, question: Question) -> None:
        self.question = question
        first = self._planned(0)
        self.statement = first.statement.but(
            mode="exact",
            refinement=1 if question.scene.has(Extension) else 2,
            wound=question.limits.strokes is not None or bool(np.isfinite(question.rates.pace)),
        )
        self.solve(self._alone(first))

    def solve(self, waypoints: Sequence[Waypoint]) -> bool:
        """Put optimal tensions in place of those of waypoints; return whether there are any.

        Where the arm would not stand at all of them, it is held to its stability margin, or at
        least to stand.
        """
        self.waypoints, planned = self._alike(waypoints), self.statement
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
        return np.vstack([self.question.start, *(waypoint.tensions for waypoint in self.waypoints)])

    @property
    def met_at(self) -> tuple[int, ...]:
        """At which of these each target is met."""
        return tuple(k for k, waypoint in enumerate(self.waypoints, start=1) if waypoint.targets)

    def _planned(self, i: int) -> Plan:
        """Return the plan for a target by itself; InputError if there is none."""
        try:
            plan = self.question.planned(self.question.targets[i], None)
        except InputError as reason:
            raise InputError(
                f"targets[{i}]: {reason.field}", reason.given, reason.allowed
            ) from None
        if plan.stopped:
            raise OutOfTime
        if plan.mode == "exact":
            return plan
        last, targets = i, self.question.targets
        while last + 1 < len(targets) and self._is_missed(targets[last + 1]):
            last += 1
        place = f"targets[{i}]" + (last > i) * f" to [{last}]"
        raise InputError(place, "out of reach", f"targets that can be met: {plan.outcome}")

    def _is_missed(self, targets: tuple[Target, ...]) -> bool:
        return self.question.planned(targets, None).mode != "exact"

    def _alike(self, waypoints: Sequence[Waypoint]) -> list[Waypoint]:
        """Return waypoints whose inequalities share a structure, so that they share a program."""
        kept = [
            waypoint.avoidance.needed(self.question.arm)
            for waypoint in waypoints
            if waypoint.avoidance
        ]
        room = tuple(max(each) for each in zip(*(each for each in kept if each), strict=True))
        return [
            replace(waypoint, avoidance=replace(waypoint.avoidance, room=room))
            if waypoint.avoidance
            else waypoint
            for waypoint in waypoints
        ]

    def _optimum(self) -> Solution | None:
        """Move the waypoints to the optimum; None without one, or where the arm does not stand."""
        stops = [self._stop(waypoint) for waypoint in self.waypoints]
        pairs = zip(stops, self.waypoints, strict=True)
        guess = [stop.problem.guess(waypoint.tensions, True) for stop, waypoint in pairs]
        program, solution = MotionProgram(self.question, stops, guess), None
        for k in range(_CORRECTED):
            tell("program over the waypoints", k, _CORRECTED)
            solution = program.solve(stops, solution)
            if not (solution.met and solution.finite):
                return None
            x = program.waypoints(solution.x)
            tensions = [s.problem.tensions(x_k) for s, x_k in zip(stops, x, strict=True)]
            triples = list(zip(stops, x, tensions, strict=True))
            if not k and not all(stop.problem.stability(x_k) > 0 for stop, x_k, _ in triples):
                return None
            changed = zip(self.waypoints, tensions, strict=True)
            self.waypoints = [replace(waypoint, tensions=T) for waypoint, T in changed]
            try:
                stops = [self._corrected(stop, x_k, T) for stop, x_k, T in triples]
            except OctoplanError:
                break
            worst = max(_violation(*pair) for pair in zip(stops, x, strict=True))
            if worst <= self.question.accuracy / _SHARE:
                break
        return solution

    def _stop(self, waypoint: Waypoint) -> Stop:
        """Return a waypoint as a program; tendons that may not pull there keep to their minima."""
        question = self.question
        stated = (question.arm, question.scene, waypoint.stated, question.limits, self.statement)
        problem = Problem(*stated, question.machine_code)
        lbx, ubx, lbg, ubg = problem.bounds
        at_targets = allowed(question.arm, waypoint.stated, question.limits)
        held = np.flatnonzero(np.array(at_targets.upper) <= question.limits.lower)
        ubx, lbg = ubx.copy(), lbg.copy()
        ubx[held] = lbx[held]
        rows = problem.program.outer_rows
        short = np.repeat([row.name == STRETCH for row in rows], [row.size for row in rows])
        lbg[: short.size][short] += _CRUSHED
        return Stop(waypoint, problem, problem.parameters(), (lbx, ubx, lbg, ubg))

    def _alone(self, first: Plan) -> list[Waypoint]:
        """Return an optimum of each target by itself, beginning with the plan for the first.

        From a plan targets are followed as far as one optimum leads, up to the last, found by
        bisection, at which it is that of the plan; the next is planned.
        """
        targets, plans = self.question.targets, {0: first}
        waypoints = list[Waypoint]()

        def planned(k: int) -> Waypoint:
            plans[k] = plan = plans.get(k) or self._planned(k)
            return Waypoint(targets[k], np.ravel(plan.tensions), plan.avoidance)

        while len(waypoints) < len(targets):
            tell("waypoints", len(waypoints), len(targets))
            low = len(waypoints)
            waypoints += self._followed(planned(low), targets[low + 1 :])
            high, k = len(waypoints), len(waypoints) - 1
            while k > low:
                if jump(waypoints[k].tensions, planned(k).tensions):
                    high = k
                else:
                    low = k
                k = (low + high) // 2
            del waypoints[high:]
        return waypoints

    def _followed(
        self, first: Waypoint, targets: Sequence[tuple[Target, ...]]
    ) -> Iterator[Waypoint]:
        """Yield a waypoint, and those of further targets as far as its optimum leads."""
        waypoint, stop = first, self._stop(first)
        optimum: Candidate | None = None
        yield waypoint
        for following in targets:
            before, stop = stop, self._stop(replace(waypoint, targets=following))
            if optimum is None or stop.problem.program is not before.problem.program:
                x = stop.problem.guess(waypoint.tensions, True)
                optimum = solve(stop.problem, x, stop.p, stop.bounds, purpose="follow")
            else:
                multipliers = optimum.lam_x, optimum.lam_g
                optimum = solve(stop.problem, optimum.x, stop.p, stop.bounds, multipliers, "follow")
            if not (optimum.met and optimum.finite):
                return
            waypoint = replace(waypoint, targets=following, tensions=optimum.tensions)
            yield waypoint

    def _corrected(self, stop: Stop, x: Array, T: Array) -> Stop:
        """Return a waypoint with the defect of its mesh, by the shape that settles."""
        question = self.question
        shape = settled(question.arm, T, question.scene, question.accuracy, question.machine_code)
        return replace(stop, p=stop.problem.parameters(defect=defect(stop.problem, x, shape)))


def _violation(stop: Stop, x: Array) -> float:
    """Return by how much rows besides equilibrium violate their bounds at most."""
    rows = stop.problem.constraints(x, stop.p)[: stop.problem.n_outer]
    low, high = (bounds[: rows.size] for bounds in stop.bounds[2:])
    return float(np.maximum(low - rows, rows - high).max(initial=0.0))
