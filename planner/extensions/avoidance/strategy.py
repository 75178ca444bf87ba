"""The strategy for problems with obstacles, or with clearance of the arm from itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from octoplan.planner.entry_points import WARM_START, load
from octoplan.planner.extensions.avoidance.around import ObstacleSearch, line_of
from octoplan.planner.extensions.avoidance.surroundings import in_the_way, surroundings
from octoplan.planner.plan import Strategy
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.solution import Solution


class AvoidanceStrategy(Strategy):
    """Plan without the obstacles; then lead the arm around the obstacles that it meets."""

    def prepared(
        self, problem: PlanningProblem, obstacles: Any, clearance: Any, self_clearance: Any
    ) -> PlanningProblem:
        """See Strategy.prepared: with the environment."""
        arm, targets = problem.arm, problem.targets
        environment = surroundings(arm, targets, obstacles, clearance, self_clearance)
        return replace(problem, environment=environment)

    def solve(self, problem: PlanningProblem, near: Plan | None) -> Solution:
        """See Strategy.solve."""
        environment = problem.environment
        if not environment:
            return super().solve(problem, near)
        result: Solution | None = None
        if near is not None:
            avoidance = near.solution.avoidance
            if avoidance is not None and near.problem.environment == environment:
                # Among the same obstacles: with the inequalities of the plan nearby.
                kept: Solution | None = load(WARM_START)(near, problem, avoidance)
                if kept is not None and not kept.stopped and not kept.jump:
                    line = line_of(problem.at_base(kept.base), np.ravel(kept.tensions))
                    if line is not None and not in_the_way(environment, line):
                        return kept
            result = load(WARM_START)(near, problem)
        if result is not None and result.stopped:
            return result
        search = ObstacleSearch(problem)
        result = search.run(result)
        return self.with_jump(result, near) if search.searched else result

    def solve_from(self, problem: PlanningProblem, plan: Plan) -> Solution | None:
        """See Strategy.solve_from."""
        return ObstacleSearch(problem).led_from(plan.solution.controls)
