"""Clearances in the certificate of a plan."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from octoplan.model.centreline import Centreline
from octoplan.model.extensions.clearance import KINDS, clearances
from octoplan.model.shape import Shape
from octoplan.model.support.progress import report
from octoplan.planner.extensions.avoidance.surroundings import required_gaps
from octoplan.planner.planning_problem import PlanningProblem


def clearance_fields(
    problem: PlanningProblem, shape: Shape, line: Callable[[], Centreline]
) -> dict[str, Any]:
    """Return the distances of the arm from every body, and the required distances."""
    report("verifying clearance")
    required, obstacles = required_gaps(problem.environment), problem.environment.obstacles
    gaps = clearances(line(), obstacles, required) if required else {}
    others = [kind for kind in KINDS if kind not in gaps]
    return {
        "gaps_asked": {name: clear.gap for name, clear in gaps.items()},
        "least_gaps": required,
        "clearances": {**gaps, **clearances(line(), obstacles, others)},
    }
