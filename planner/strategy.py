"""Strategies: how a kind of planning problem is checked and solved.

`Strategy` plans free arms. Extensions derive the strategies that entry_points.py lists.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.centreline import Centreline
from octoplan.model.loads import is_loaded
from octoplan.model.scene import Scene
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import OutOfTime
from octoplan.planner.block import Constraints
from octoplan.planner.certificate import BRINK
from octoplan.planner.entry_points import JUMP, STRATEGIES, WARM_START, load
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.solution import Solution
from octoplan.planner.solve.refine import CORRECTIONS, refine
from octoplan.planner.solve.relaxation_stage import RelaxationStage
from octoplan.planner.solve.search import Search


class Strategy:
    """The strategy for free arms: continue a plan nearby, otherwise search from all guesses.

    Strategies have no state.
    """

    def default_margin(self, arm: Arm, scene: Scene) -> float:
        """Return the stability margin of an arm in a scene if none is given."""
        return BRINK if is_loaded(arm, scene) else 0.0

    def prepared(
        self, problem: PlanningProblem, obstacles: Any, clearance: Any, self_clearance: Any
    ) -> PlanningProblem:
        """Return the problem with the environment; raise InputError for unsupported arguments."""
        return problem

    def constraints(self, problem: PlanningProblem) -> Constraints | None:
        """Return further constraints of the program, if any; see octoplan.planner.block."""
        return None

    def is_continuable(self, near: Scene, scene: Scene) -> bool:
        """Return whether a plan in the scene `near` may be continued in a scene."""
        return near == scene

    def adapted(self, problem: PlanningProblem, near: Plan) -> PlanningProblem:
        """Return the problem with the structure of the problem of a plan nearby."""
        return problem

    def plan_of(self, problem: PlanningProblem, solution: Solution) -> Plan:
        """Return the plan of a known solution, such as that of a saved plan."""
        return Plan.of(problem, solution)

    def plan(self, problem: PlanningProblem, near: Plan | None) -> Plan:
        """Return the plan of a problem whose targets also hold between stations.

        `Target.refined_along` adds stations if the settled arm violates the target there. The
        problem is then solved again from the tensions of the plan.
        """
        return self.between_stations(problem, self.solved(problem, near))

    def between_stations(self, problem: PlanningProblem, plan: Plan) -> Plan:
        """Return a plan whose targets also hold between stations, from a plan for the stations."""
        for _ in range(CORRECTIONS):
            if plan.solution.stopped or plan.mode != "exact":
                return plan
            refined = plan.targets
            with suppress(OctoplanError, OutOfTime):
                line = partial(_centreline, plan)
                refined = tuple(each.refined_along(line, problem.accuracy) for each in refined)
            if refined == plan.targets:
                return plan
            again = replace(problem, targets=refined)
            result = self.solve_from(again, plan)
            if result is None:
                plan = self.solved(again, plan)
            else:
                before = plan.solution
                kept = {name: getattr(before, name) for name in ("starts", "jump", "lost")}
                again = replace(again, environment=plan.problem.environment)
                plan = type(plan).of(again, replace(result, **kept))
        return plan

    def solved(self, problem: PlanningProblem, near: Plan | None) -> Plan:
        """Return the plan of a problem; raises OutOfTime if no tensions are found in time."""
        return Plan.of(problem, self.solve(problem, near))

    def solve(self, problem: PlanningProblem, near: Plan | None) -> Solution:
        """Return the solution of a problem, warm-started from a plan nearby if possible."""
        constraints = self.constraints(problem)
        result: Solution | None = None
        if near is not None:
            result = load(WARM_START)(near, problem, constraints)
        if result is None:
            result = self.with_jump(Search(problem, constraints).run(), near)
        return result

    def with_jump(self, result: Solution, near: Plan | None) -> Solution:
        """Return the result of a search with the change of the tensions from a plan nearby."""
        if near is None or result.stopped or result.options.mode != "exact":
            return result
        return replace(result, jump=load(JUMP)(near.tensions, result.tensions))

    def solve_from(self, problem: PlanningProblem, plan: Plan) -> Solution | None:
        """Return the solution that meets the targets near the tensions of a plan, if any."""
        problem = problem.at_base(plan.solution.base)
        constraints = self.constraints(problem)
        blocks = constraints.blocks(problem.arm) if constraints else ()
        stage = RelaxationStage(problem, "exact", blocks=blocks)
        with suppress(OutOfTime):
            optimum = stage.solve_from(np.ravel(plan.tensions))
            fine = None if optimum is None else refine(optimum)
            return None if fine is None else fine.result(stage.trials, avoidance=constraints)
        return None


def _centreline(plan: Plan) -> Centreline:
    """Return the midline of the shape of a plan."""
    return plan.shape.centreline()


def strategy_of(problem: PlanningProblem, has_obstacles: bool) -> Strategy:
    """Return the strategy that targets and effects name, otherwise that of obstacles or none."""
    effects = (effect.plan_strategy for effect in problem.scene.effects)
    targets = (target.plan_strategy for target in problem.targets)
    name = next(filter(None, (*effects, *targets)), "avoidance" if has_obstacles else "")
    strategy: Strategy = load(STRATEGIES[name])() if name else Strategy()
    return strategy
