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
from dataclasses import dataclass, replace

import numpy as np

from model.effects import Extension
from model.errors import OctoplanError
from model.loads import is_loaded
from model.paths import Array
from model.progress import tell
from planner.avoidance.rows import Avoidance
from planner.plan import Plan
from planner.program.objective import STRETCH
from planner.program.problem import Problem
from planner.program.terms import pulling_tendons
from planner.solve.ipopt import Candidate, solve
from planner.solve.refine import defect, settled
from planner.solve.warm_start import jump
from planner.targets.base import Target
from planner.trajectory.program import MotionProgram, Stop
from planner.trajectory.question import Question

# What the least stretch of the settled arm may be below that on a coarse mesh.
_CRUSHED = 0.02
# The part of the accuracy that is left to rows, and how often they are corrected.
_SHARE, _CORRECTED = 4, 8


@dataclass(frozen=True, eq=False)
class Waypoint:
    """A place of a motion: the targets there, if any, tensions (n_tendons,) [N], inequalities.

    `fraction` is that of the time between two targets in which the arm goes there from the waypoint
    before.
    """

    targets: tuple[Target, ...]
    tensions: Array
    avoidance: Avoidance | None = None
    fraction: float = 1.0

    @property
    def stated(self) -> tuple[Target, ...]:
        """The targets of its program."""
        rows = self.avoidance is not None and bool(self.avoidance.rows)
        return (*self.targets, self.avoidance) if rows else self.targets  # type: ignore[arg-type]


class Waypoints:
    """The waypoints of a motion; `waypoints` are the best so far."""

    def __init__(self, question: Question) -> None:
        self.question, self.waypoints = question, list[Waypoint]()
        first = question.planned(0)
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
        needed = [w.avoidance.needed(self.question.arm) for w in waypoints if w.avoidance]
        # Inequalities of one structure share a program.
        room = tuple(max(each) for each in zip(*filter(None, needed), strict=True))
        self.waypoints = [
            replace(w, avoidance=w.avoidance and replace(w.avoidance, room=room)) for w in waypoints
        ]
        planned, loaded = self.statement, is_loaded(self.question.scene)
        held = planned.but(modes=1)
        for statement in dict.fromkeys((planned, *[held, held.but(margin=0.0)] * loaded)):
            self.statement = statement
            if self._optimum():
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

    def _optimum(self) -> bool:
        """Move the waypoints to the optimum; return whether there is one, and the arm stands."""
        stops = [self._stop(waypoint) for waypoint in self.waypoints]
        pairs = zip(stops, self.waypoints, strict=True)
        guess = [stop.problem.guess(waypoint.tensions, True) for stop, waypoint in pairs]
        program, solution = MotionProgram(self.question, stops, guess), None
        for k in range(_CORRECTED):
            tell("program over the waypoints", k, _CORRECTED)
            solution = program.solve(stops, solution)
            if not (solution.met and solution.finite):
                return False
            solved = list(zip(stops, program.split(solution.x), strict=True))
            if not k and not all(stop.problem.stands(x) for stop, x in solved):
                return False
            changed = zip(self.waypoints, solved, strict=True)
            self.waypoints = [replace(w, tensions=s.problem.tensions(x)) for w, (s, x) in changed]
            try:
                stops = [self._corrected(stop, x) for stop, x in solved]
            except OctoplanError:
                break
            corrected = zip(stops, solved, strict=True)
            worst = max(_violation(stop, x) for stop, (_, x) in corrected)
            if worst <= self.question.accuracy / _SHARE:
                break
        return True

    def _stop(self, waypoint: Waypoint) -> Stop:
        """Return a waypoint as a program; tendons that may not pull there keep to their minima."""
        question = self.question
        definition = (
            question.arm,
            question.scene,
            waypoint.stated,
            question.limits,
            self.statement,
        )
        problem = Problem(*definition, question.machine_code)
        lbx, ubx, lbg, ubg = problem.bounds
        at_targets = question.limits.restricted(pulling_tendons(question.arm, waypoint.stated))
        held = np.flatnonzero(np.array(at_targets.upper) <= question.limits.lower)
        ubx, lbg = ubx.copy(), lbg.copy()
        ubx[held] = lbx[held]
        short = np.repeat(
            [row.name == STRETCH for row in problem.rows], [r.size for r in problem.rows]
        )
        lbg[short] += _CRUSHED
        bounds = lbx, ubx, lbg, ubg
        return Stop(
            problem, problem.parameters(), bounds, waypoint.fraction, bool(waypoint.targets)
        )

    def _corrected(self, stop: Stop, x: Array) -> Stop:
        """Return a waypoint with the defect of its mesh, by the shape that settles."""
        question, problem = self.question, stop.problem
        at = question.arm, problem.tensions(x), question.scene, question.accuracy
        error = defect(problem, x, settled(*at, question.machine_code))
        return replace(stop, p=problem.parameters(defect=error))

    def _alone(self, first: Plan) -> list[Waypoint]:
        """Return an optimum of each target by itself, beginning with the plan for the first.

        From a plan targets are followed as far as one optimum leads, up to the last, found by
        bisection, at which it is that of the plan; the next is planned.
        """
        targets, plans, waypoints = self.question.targets, {0: first}, list[Waypoint]()

        def planned(k: int) -> Waypoint:
            plans[k] = plan = plans.get(k) or self.question.planned(k)
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
        self, waypoint: Waypoint, targets: Sequence[tuple[Target, ...]]
    ) -> Iterator[Waypoint]:
        """Yield a waypoint, and those of further targets as far as its optimum leads."""
        optimum: Candidate | None = None
        yield waypoint
        for following in targets:
            stop = self._stop(replace(waypoint, targets=following))
            if optimum is None or stop.problem.program is not optimum.problem.program:
                x, multipliers = stop.problem.guess(waypoint.tensions, True), None
            else:
                x, multipliers = optimum.x, (optimum.lam_x, optimum.lam_g)
            optimum = solve(stop.problem, x, stop.p, stop.bounds, multipliers, "follow")
            if not (optimum.met and optimum.finite):
                return
            waypoint = replace(waypoint, targets=following, tensions=optimum.tensions)
            yield waypoint


def _violation(stop: Stop, x: Array) -> float:
    """Return by how much rows besides equilibrium violate their bounds at most."""
    rows = stop.problem.constraints(x, stop.p)[: stop.problem.n_outer]
    low, high = (bounds[: rows.size] for bounds in stop.bounds[2:])
    return float(np.maximum(low - rows, rows - high).max(initial=0.0))
