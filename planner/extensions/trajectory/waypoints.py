"""Tensions at the waypoints of a motion: one program over all targets.

The initial guess is an optimum of each target alone, continued from target to target. The last
optimum must agree with the best one from independent initial guesses; otherwise the continuation
has left the better branch, and each target is planned alone. The mesh is coarse. The difference
between target values on this mesh and of the settled arm, the defect, varies little between optima:
the bounds are shifted by the defect, and the program is solved again with a warm start, until the
settled arm meets the targets (deferred correction).

With contact, the equilibrium depends on the history. Waypoints are then planned one after another,
each for the least effort that is reachable from the previous one. If a plan has a load path of
several tensions, these become waypoints. Friction opposes the motion from the previous waypoint,
which is straight in the tensions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from octoplan.model.effects import Extension
from octoplan.model.loads import is_coupled, is_path_dependent
from octoplan.model.paths import Array
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.errors import CollapsedError, Described, InputError, OctoplanError
from octoplan.model.support.progress import report, track
from octoplan.planner.extensions.trajectory.program import MotionProgram
from octoplan.planner.extensions.trajectory.question import Question, Waypoint
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from octoplan.planner.program_instance import ProgramInstance
from octoplan.planner.solution import NlpSolution
from octoplan.planner.solve.ipopt import solve
from octoplan.planner.solve.multistart import Multistart
from octoplan.planner.solve.refine import CORRECTIONS, SAFETY_FACTOR, collapse_defect, defect
from octoplan.planner.solve.search import Search


class Waypoints:
    """Solver of a motion's waypoints; `waypoints` are the best so far."""

    def __init__(self, question: Question) -> None:
        self.question = question
        self.waypoints = list[Waypoint]()
        first = question.planned(0)
        self.options = first.problem.options.replace(
            mode="exact",
            refinement=1 if question.scene.has(Extension) else 2,
        )
        continued = self._continued(first)
        # Continued optima may be feasible on the coarse mesh only.
        if continued is None or not self.solve(continued):
            self.solve(self._planned(first))

    def solve(self, waypoints: Sequence[Waypoint]) -> bool:
        """Optimise the tensions of waypoints; return whether an optimum was found.

        If the arm is unstable at some waypoint, add constraints of the stability margin, and if
        this fails of stability alone.
        """
        self.waypoints = list(waypoints)
        planned = self.options
        stable = self.options.replace(modes=1)
        more = (
            (stable, stable.replace(margin=0.0))
            if is_coupled(self.question.arm, self.question.scene)
            else ()
        )
        for options in dict.fromkeys((planned, *more)):
            found = self._optimum(options)
            if found is not None:
                self.waypoints = found
                self.options = options
                return True
        return False

    def _optimum(self, options: NlpOptions) -> list[Waypoint] | None:
        """Return the optimal waypoints; return None if this fails or the arm is unstable."""
        waypoints = self.waypoints
        instances = [self._instance(waypoint, options) for waypoint in waypoints]
        program = MotionProgram(self.question, waypoints, instances)
        parameters = [instance.parameters() for instance in instances]
        solution = None
        for k in range(CORRECTIONS):
            report("program over the waypoints", k, CORRECTIONS)
            solution, unknowns = program.solve(parameters, solution)
            if not solution.converged:
                return None
            if not k and not all(map(ProgramInstance.is_stable, instances, unknowns)):
                return None
            tensions = map(ProgramInstance.tensions, instances, unknowns)
            joints = map(ProgramInstance.base_joints, instances, unknowns)
            each = zip(waypoints, tensions, joints, strict=True)
            waypoints = [replace(waypoint, tensions=T, base=base) for waypoint, T, base in each]
            parameters = list(map(self._corrected, instances, unknowns, parameters))
            if program.violation(solution, parameters) <= self.question.accuracy / SAFETY_FACTOR:
                break
        return waypoints

    def _instance(self, waypoint: Waypoint, options: NlpOptions) -> ProgramInstance:
        """Return the problem of a waypoint, with tendon lengths if stroke rates are limited."""
        question = self.question
        limits = question.limits
        if limits.strokes is None and np.isfinite(question.rates.pace):
            free = (np.inf,) * question.arm.n_tendons
            limits = replace(limits, strokes=(tuple(np.negative(free).tolist()), free))
        problem = PlanningProblem(
            question.arm,
            waypoint.targets,
            question.scene,
            limits,
            options,
            question.accuracy,
            placement=question.placement and question.placement.at(()),
            machine_code=question.machine_code,
        ).at_base(waypoint.base)
        return ProgramInstance(problem, options, waypoint.blocks(question.arm))

    def _corrected(self, instance: ProgramInstance, x: Array, p: Array) -> Array:
        """Return parameters p with the defect of the mesh, from the shape that settles nearby.

        For a crushed arm, the defect of the smallest stretch is used. If the arm does not settle,
        the defect is unchanged; the certificate then reports the error.
        """
        problem = instance.problem.at_base(instance.base_joints(x))
        point = instance.linearised(x)
        before = p[instance.program.parts["defect"]]
        near = Shape(problem.arm, problem.scene, np.inf, point, instance.options.refinement)
        try:
            settled = settle(
                problem.arm,
                point.tensions,
                problem.scene,
                problem.reference_accuracy,
                compile=problem.machine_code,
                near=near,
            )
            error = defect(instance, x, settled)
        except CollapsedError as crushed:
            error = collapse_defect(instance, x, crushed, before)
        except OctoplanError:
            error = before
        return instance.parameters(defect=error)

    def _continued(self, first: Plan) -> list[Waypoint] | None:
        """Return the optimum of each target alone, continued from the plan of the first target.

        Return None if a target is not reached, or if initial guesses reach a better optimum of the
        last target.
        """
        begin, *others = self.question.targets
        solution = first.solution
        T = np.ravel(first.tensions)
        waypoint = Waypoint(begin, T, solution.avoidance, base=solution.base)
        waypoints = [waypoint]
        optimum: NlpSolution | None = None
        for targets in others:
            waypoint = replace(waypoint, targets=targets)
            instance = self._instance(waypoint, self.options)
            if optimum and instance.program is optimum.instance.program:
                x = optimum.x
                multipliers = (optimum.lam_x, optimum.lam_g)
            else:
                x = instance.guess(waypoint.tensions, True)
                multipliers = None
            optimum = solve(
                instance, x, instance.parameters(), instance.bounds, multipliers, "follow"
            )
            if not optimum.converged:
                return None
            base = instance.base_joints(optimum.x)
            waypoint = replace(waypoint, tensions=optimum.tensions, base=base)
            waypoints.append(waypoint)
        return waypoints if optimum is None or _is_best(optimum) else None

    def _planned(self, first: Plan) -> list[Waypoint]:
        """Return the plan of each target alone.

        Among mirror images of equal effort, take the one with tensions closest to the previous
        ones.
        """
        question = self.question
        later = range(1, len(question.targets))
        plans = [first, *map(question.planned, track("plans of waypoints", later))]
        alone = list[Waypoint]()
        before = np.ravel(first.tensions)
        for targets, each in zip(question.targets, plans, strict=True):
            images = [each.tensions, *(T for _, T in each.mirror_images())]
            before = min(map(np.ravel, images), key=partial(_largest_change, before))
            solution = each.solution
            alone.append(Waypoint(targets, before, solution.avoidance, base=solution.base))
        return alone


def _largest_change(before: Array, T: Array) -> float:
    """Return the largest change of a tension [N]."""
    return float(np.abs(T - before).max())


def _is_best(optimum: NlpSolution) -> bool:
    """Return whether initial guesses lead to no better optimum."""
    problem = optimum.instance.problem
    guesses = Search(problem).guesses()
    blocks = optimum.instance.extensions
    return Multistart(problem, "exact", guesses, blocks).confirms(optimum)


def planned_touching(question: Question) -> list[Waypoint]:
    """Return the waypoints of a motion in contact: the targets, and the load paths of their plans.

    Raises InputError for options that motions in contact do not support.
    """
    from octoplan.planner.extensions.contact.load_path import from_rest
    from octoplan.planner.extensions.contact.plan import ContactPlan

    of_places = np.isfinite(question.rates.of_places)
    if question.surroundings:
        allowed = "omitted in a scene with contact; add Contact(obstacle) to the scene"
        raise InputError("obstacles", Described("given"), allowed)
    if of_places.any():
        name = "stroke_rate_max" if of_places[:2].any() else "tip_acceleration_max"
        allowed = "None in a scene with contact; pass rate_max or times"
        raise InputError(name, Described("given"), allowed)
    if is_path_dependent(question.scene) and question.begin is None:
        if not np.array_equal(question.start, question.limits.lower):
            allowed = "a plan of the arm, or None, in a scene with friction of contacts"
            raise InputError("start", question.start.tolist(), allowed)
        from_rest(question.arm, question.start, question.scene, "start")
    near = question.begin
    waypoints = list[Waypoint]()
    for k, targets in enumerate(track("waypoints", list(question.targets))):
        before = (
            ()
            if near is None
            else (*near.solution.load_path, tuple(np.ravel(near.tensions).tolist()))
        )
        planned = question.planned(k, near)
        assert isinstance(planned, ContactPlan)
        path = planned.solution.load_path
        follows = path[: len(before)] == before
        near = planned
        new = [*path[len(before) * follows :], np.ravel(planned.tensions)]
        each = [Waypoint((), np.array(T), fraction=1 / len(new)) for T in new]
        waypoints += [*each[:-1], replace(each[-1], targets=targets)]
    return waypoints
