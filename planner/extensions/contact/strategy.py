"""The strategy for scenes with contact, and for targets that use obstacles (Wrap, Hold)."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.extensions.contact.effects import contacts
from octoplan.model.extensions.obstacles.base import check_obstacles
from octoplan.model.scene import Scene
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import OutOfTime, reserve, seconds_left
from octoplan.planner.extensions.avoidance.strategy import AvoidanceStrategy
from octoplan.planner.extensions.contact.load_path import is_same, rubs
from octoplan.planner.extensions.contact.plan import ContactPlan
from octoplan.planner.extensions.contact.search import ContactSearch
from octoplan.planner.extensions.contact.supported import check_contact
from octoplan.planner.extensions.contact.wrapping import (
    beside,
    beside_contacts,
    open_wrap,
    with_places_of,
    with_turns,
)
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.solution import Solution
from octoplan.planner.targets.base import Target

# Share of the time limit that is reserved for shape and certificate until the search has measured
# the time that the arm takes to settle.
CONTACT_SHARE = 0.25


class ContactStrategy(AvoidanceStrategy):
    """Plan an arm that lies along obstacles, leans on obstacles or holds objects."""

    def default_margin(self, arm: Arm, scene: Scene) -> float:
        """See Strategy.default_margin: 0 if contacts have friction."""
        return 0.0 if rubs(scene) else super().default_margin(arm, scene)

    def prepared(
        self, problem: PlanningProblem, obstacles: Any, clearance: Any, self_clearance: Any
    ) -> PlanningProblem:
        """See Strategy.prepared: the arm keeps clear of obstacles that it lies along."""
        both = check_obstacles(obstacles) + beside(problem.targets, problem.scene)
        problem = super().prepared(problem, both, clearance, self_clearance)
        open_wrap(problem.targets)
        check_contact(problem)
        return problem

    def is_continuable(self, near: Scene, scene: Scene) -> bool:
        """See Strategy.is_continuable: the earlier friction of contacts does not matter."""
        return is_same(near, scene)

    def adapted(self, problem: PlanningProblem, near: Plan) -> PlanningProblem:
        """See Strategy.adapted: with the places along obstacles of the plan nearby."""
        return replace(problem, targets=with_places_of(problem.targets, near.targets))

    def plan_of(self, problem: PlanningProblem, solution: Solution) -> Plan:
        """See Strategy.plan_of."""
        kind = ContactPlan if contacts(problem.scene) else Plan
        return kind.of(problem, solution)

    def plan(self, problem: PlanningProblem, near: Plan | None) -> Plan:
        """See Strategy.plan; finds the length of a wrap that is given by its turns."""
        if contacts(problem.scene) and seconds_left() < np.inf:
            reserve(CONTACT_SHARE * seconds_left())
        wrap = open_wrap(problem.targets)
        if wrap is None:
            return super().plan(problem, near)

        def planned(targets: tuple[Target, ...], previous: Plan | None) -> Plan:
            leads = previous is not None and previous.mode == "exact"
            return self.solved(replace(problem, targets=targets), previous if leads else near)

        first = with_turns(problem.arm, problem.targets, wrap, planned)
        return self.between_stations(problem, first)

    def solved(self, problem: PlanningProblem, near: Plan | None) -> Plan:
        """See Strategy.solved.

        An arm that lies along an obstacle may keep clear of it. This is tried first, unless the arm
        of the plan nearby leans on an obstacle. Otherwise, and if the arm then touches something on
        its way from rest, the search is that of an arm in contact.
        """
        if not contacts(problem.scene):
            return super().solved(problem, near)
        leaning = near if isinstance(near, ContactPlan) else None
        free = None if leaning and not leaning.beside else beside_contacts(problem)
        if free is not None:
            result = self.solve(free, leaning and leaning.beside)
            kept_clear = replace(problem, environment=free.environment)
            plan = ContactPlan.of(kept_clear, result)
            with suppress(OctoplanError, OutOfTime):
                is_exact = result.options.mode == "exact"
                if result.stopped or (is_exact and not plan.shape.contacts):
                    return plan
        begin = None if near is None else tuple(np.ravel(near.tensions).tolist())
        path = leaning.solution.load_path if leaning else ()
        load_path = None if begin is None else (*path, begin)
        return ContactPlan.of(problem, ContactSearch(problem, load_path).run())

    def solve_from(self, problem: PlanningProblem, plan: Plan) -> Solution | None:
        """See Strategy.solve_from: only for an arm that keeps clear of the obstacles."""
        free = plan.beside if isinstance(plan, ContactPlan) else plan
        if free is None:
            return None
        environment = free.problem.environment
        problem = replace(problem, scene=free.scene, environment=environment)
        return super().solve_from(problem, free)
