"""From targets to tensions at the waypoints of a motion: one program over all of them.

It begins at an optimum of each target by itself. They are followed, each from the one before, and
the last has to agree with the best that initial guesses lead to: where it does not the path has
left the better branch, and each target is planned. The mesh is coarse. What targets measure on it
is off from that of the settled arm by a defect, which changes little from one optimum to the next:
bounds are shifted by it, and the program is solved again, warm, until the settled arm meets them
(deferred correction).

Which of several equilibria an arm in contact is in depends on how it came there: then waypoints
are planned one after another, each for the least effort to which tensions lead from the one before.
A plan that is come to by further tensions has these as waypoints. Friction acts against the way
from the waypoint before, which is straight in the tensions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from octoplan.model.effects import Extension
from octoplan.model.loads import is_loaded
from octoplan.model.paths import Array
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.errors import CollapsedError, InputError, OctoplanError
from octoplan.model.support.progress import report, track
from octoplan.planner.extensions.contact.load_path import from_rest, rubs
from octoplan.planner.extensions.trajectory.program import MotionProgram
from octoplan.planner.extensions.trajectory.question import Question, Waypoint
from octoplan.planner.plan import ContactPlan, Plan
from octoplan.planner.program.problem import Candidate, Problem
from octoplan.planner.question import Statement
from octoplan.planner.solve.ipopt import solve
from octoplan.planner.solve.refine import CORRECTIONS, PART, defect, stretched
from octoplan.planner.solve.search import Reading, Search
from octoplan.planner.task import Task


class Waypoints:
    """The waypoints of a motion; `waypoints` are the best so far."""

    def __init__(self, question: Question) -> None:
        self.question, self.waypoints = question, list[Waypoint]()
        first = question.planned(0)
        self.statement = first.statement.but(
            mode="exact",
            refinement=1 if question.scene.has(Extension) else 2,
        )
        followed = self._followed(first)
        # What is followed is met on the coarse mesh alone.
        if followed is None or not self.solve(followed):
            self.solve(self._planned(first))

    def solve(self, waypoints: Sequence[Waypoint]) -> bool:
        """Put optimal tensions in place of those of waypoints; return whether there are any.

        Where the arm would not stand at all of them, it is held to its stability margin, or at
        least to stand.
        """
        self.waypoints = list(waypoints)
        planned, held = self.statement, self.statement.but(modes=1)
        more = (held, held.but(margin=0.0)) if is_loaded(self.question.scene) else ()
        for statement in dict.fromkeys((planned, *more)):
            found = self._optimum(statement)
            if found is not None:
                self.waypoints, self.statement = found, statement
                return True
        return False

    def _optimum(self, statement: Statement) -> list[Waypoint] | None:
        """Return the waypoints at the optimum, None if there is none or the arm is unstable."""
        waypoints = self.waypoints
        problems = [self._problem(waypoint, statement) for waypoint in waypoints]
        program = MotionProgram(self.question, waypoints, problems)
        parameters, solution = [problem.parameters() for problem in problems], None
        for k in range(CORRECTIONS):
            report("program over the waypoints", k, CORRECTIONS)
            solution, unknowns = program.solve(parameters, solution)
            if not solution.met or (not k and not all(map(Problem.is_stable, problems, unknowns))):
                return None
            tensions = map(Problem.tensions, problems, unknowns)
            pairs = zip(waypoints, tensions, strict=True)
            waypoints = [replace(waypoint, tensions=T) for waypoint, T in pairs]
            parameters = list(map(self._corrected, problems, unknowns, parameters))
            if program.violation(solution, parameters) <= self.question.accuracy / PART:
                break
        return waypoints

    def _problem(self, waypoint: Waypoint, statement: Statement) -> Problem:
        """Return the problem of a waypoint; with lengths of tendons if their rates have limits."""
        of, limits = self.question, self.question.limits
        if limits.strokes is None and np.isfinite(of.rates.pace):
            free = (np.inf,) * of.arm.n_tendons
            limits = replace(limits, strokes=(tuple(np.negative(free).tolist()), free))
        definition = of.arm, waypoint.stated, of.scene, limits, statement, of.accuracy
        return Problem(Task(*definition, machine_code=of.machine_code))

    def _corrected(self, problem: Problem, x: Array, p: Array) -> Array:
        """Return parameters p with the defect of the mesh, by the shape that settles nearby.

        With that of the least stretch where it is crushed; unchanged where the arm does not settle,
        which the certificate tells.
        """
        of, point, before = problem.task, problem.linearised(x), p[problem.program.parts["defect"]]
        near = Shape(of.arm, of.scene, np.inf, point, problem.statement.refinement)
        at = of.arm, point.tensions, of.scene, of.sharper
        try:
            error = defect(problem, x, settle(*at, compile=of.machine_code, near=near))
        except CollapsedError as crushed:
            error = stretched(problem, x, crushed, before)
        except OctoplanError:
            error = before
        return problem.parameters(defect=error)

    def _followed(self, first: Plan) -> list[Waypoint] | None:
        """Return the optimum of each target by itself, followed from the plan for the first.

        None where one is not reached, and where guesses lead to a better one of the last.
        """
        begin, *others = self.question.targets
        waypoint = Waypoint(begin, np.ravel(first.tensions), first.avoidance)
        waypoints = [waypoint]
        optimum: Candidate | None = None
        for targets in others:
            waypoint = replace(waypoint, targets=targets)
            problem = self._problem(waypoint, self.statement)
            if optimum and problem.program is optimum.problem.program:
                x, multipliers = optimum.x, (optimum.lam_x, optimum.lam_g)
            else:
                x, multipliers = problem.guess(waypoint.tensions, True), None
            numbers = problem.parameters(), problem.bounds, multipliers
            optimum = solve(problem, x, *numbers, "follow")
            if not optimum.met:
                return None
            waypoint = replace(waypoint, tensions=optimum.tensions)
            waypoints.append(waypoint)
        return waypoints if optimum is None or _is_best(optimum) else None

    def _planned(self, first: Plan) -> list[Waypoint]:
        """Return the plan for each target by itself.

        Of mirror images that cost the same those are taken that are next to the tensions before.
        """
        question = self.question
        later = range(1, len(question.targets))
        plans = [first, *map(question.planned, track("plans of waypoints", later))]
        alone, before = list[Waypoint](), np.ravel(first.tensions)
        for targets, each in zip(question.targets, plans, strict=True):
            images = [each.tensions, *(T for _, T in each.mirror_images())]
            before = min(map(np.ravel, images), key=partial(_largest_change, before))
            alone.append(Waypoint(targets, before, each.avoidance))
        return alone


def _largest_change(before: Array, T: Array) -> float:
    """Return how far the tension that changes most does [N]."""
    return float(np.abs(T - before).max())


def _is_best(optimum: Candidate) -> bool:
    """Return whether initial guesses lead to none that is better."""
    task = optimum.problem.task
    return Reading(task, "exact", Search(task).guesses()).agrees_on(optimum)


def planned_touching(question: Question) -> list[Waypoint]:
    """Return the waypoints: the targets, and what plans for these are come to by.

    Raises InputError for what is not stated of motions in contact.
    """
    of_places = np.isfinite(question.rates.of_places)
    if question.surroundings:
        allowed = "none in a scene with contact: there they are effects"
        raise InputError("obstacles", "given", allowed)
    if of_places.any():
        name = "stroke_rate_max" if of_places[:2].any() else "tip_acceleration_max"
        raise InputError(name, "given", "rate_max or times in a scene with contact")
    if rubs(question.scene) and question.begin is None:
        if not np.array_equal(question.start, question.limits.lower):
            allowed = "with friction of contacts the plan that the arm moves from, or none"
            raise InputError("start", question.start.tolist(), allowed)
        from_rest(question.arm, question.start, question.scene, "start")
    near, waypoints = question.begin, list[Waypoint]()
    for k, targets in enumerate(track("waypoints", list(question.targets))):
        before = () if near is None else (*near.load_path, tuple(np.ravel(near.tensions).tolist()))
        planned = question.planned(k, near)
        assert isinstance(planned, ContactPlan)
        follows, near = planned.load_path[: len(before)] == before, planned
        new = [*planned.load_path[len(before) * follows :], np.ravel(planned.tensions)]
        each = [Waypoint((), np.array(T), fraction=1 / len(new)) for T in new]
        waypoints += [*each[:-1], replace(each[-1], targets=targets)]
    return waypoints
