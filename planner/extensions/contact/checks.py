"""Complementarity in the certificate of a plan: gap >= 0, force >= 0, gap times force = 0."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from octoplan.model.centreline import Centreline
from octoplan.model.extensions.contact.effects import bodies_of
from octoplan.model.extensions.obstacles.base import distances
from octoplan.model.shape import Shape
from octoplan.planner.certificate import COMPLEMENTARITY, Check
from octoplan.planner.planning_problem import PlanningProblem

# Largest violation of gaps [m], forces [N] and their products [N m].
COMPLEMENTARY = 1e-8
# Number of places at which gaps are evaluated.
_PLACES = 2001


def complementarity_fields(
    problem: PlanningProblem, shape: Shape, line: Callable[[], Centreline]
) -> dict[str, Any]:
    """Return the largest violation of complementarity, with its tolerance."""
    violation = _violation(shape, line())
    return {"checks": {COMPLEMENTARITY: Check(violation, COMPLEMENTARY)}}


def _violation(shape: Shape, line: Centreline) -> float:
    """Return the largest of -gap [m], -force [N] and |gap force| [N m]."""
    bodies = bodies_of(shape.scene)
    s = np.linspace(0.0, shape.arm.length, _PLACES)[1:]
    places, radii = line.at(s)
    worst = float((radii[:, None] - distances(bodies, places)[0]).max(initial=-np.inf))
    for touch in shape.contacts:
        out = shape.position(touch.s) - touch.point
        force = float(touch.force @ out) / float(np.linalg.norm(out))
        worst = max(worst, -force, abs(force * touch.gap))
    return max(worst, 0.0)
