"""Problems that scenes with contact do not support."""

from __future__ import annotations

import numpy as np

from octoplan.model.extensions.contact.effects import contacts, without_contacts
from octoplan.model.extensions.contact.forward import TouchingMap
from octoplan.model.loads import is_coupled
from octoplan.model.support.errors import Described, InputError
from octoplan.planner.extensions.contact.hold import Hold
from octoplan.planner.extensions.contact.wrap import Wrap
from octoplan.planner.planning_problem import PlanningProblem


def check_contact(problem: PlanningProblem) -> None:
    """Raise InputError for problems that scenes with contact do not support."""
    bodies = [contact.obstacle for contact in contacts(problem.scene)]
    for target in problem.targets:
        if not isinstance(target, Hold):
            continue
        if target.obstacle not in bodies:
            allowed = "an obstacle that the scene has as a Contact"
            raise InputError("Hold.obstacle", target.obstacle, allowed)
        _check_reach(problem, target)
    if not bodies:
        return
    holds = any(isinstance(target, Hold | Wrap) for target in problem.targets)
    friction = max(contact.friction for contact in contacts(problem.scene))
    refused = [
        (
            bool(problem.target_set.requests),
            "target",
            Described("a stiffness"),
            "a shape: plans in a scene with contact do not support stiffnesses",
        ),
        (problem.options.norm != "2", "norm", problem.options.norm, '"2" in a scene with contact'),
        (
            holds and friction > 0,
            "Contact.friction",
            friction,
            "0 for holds and wraps; with friction, plans are for positions and poses",
        ),
        (
            bool(problem.environment),
            "obstacles",
            Described("given"),
            "none in a scene with contact; add each obstacle to the scene as a Contact",
        ),
        (
            problem.limits.strokes is not None,
            "stroke_max",
            Described("given"),
            "none in a scene with contact",
        ),
    ]
    for is_given, name, value, allowed in refused:
        if is_given:
            raise InputError(name, value, allowed)
    # Refuses an arm that is inside of an obstacle at rest, which every start would meet.
    TouchingMap(problem.arm, problem.scene, 1)


def _check_reach(problem: PlanningProblem, hold: Hold) -> None:
    """Raise InputError for a held object beyond the length of the arm.

    Loads may stretch an arm, which tendons only shorten.
    """
    arm = problem.arm
    reach = arm.length + float(arm.outer_radius(np.array([arm.length]))[0][0])
    distance = float(hold.obstacle.distance(np.array(arm.base_position)))
    if distance > reach and not is_coupled(arm, without_contacts(problem.scene)):
        allowed = f"an obstacle within reach: it is {1e3 * distance:.4g} mm from the base"
        allowed += f", and the arm is {1e3 * arm.length:.4g} mm long"
        raise InputError("Hold.obstacle", hold.obstacle, allowed)
