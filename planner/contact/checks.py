"""What plans in scenes with contact do not state, refused by name."""

from __future__ import annotations

from model.contact.forward import TouchingMap
from model.equilibrium.forward import STAGES
from model.errors import InputError
from model.loads import contacts
from model.scene import Scene
from planner.contact.load_path import rubs
from planner.contact.search import ROUGH
from planner.program.terms import compliance_requests
from planner.solve.task import Task
from planner.targets.base import Target
from planner.targets.hold import Hold
from planner.targets.wrap import Wrap


def check_contact(task: Task, avoids: bool) -> None:
    """Raise InputError for what is not stated in scenes with contact."""
    if compliance_requests(task.targets):
        raise InputError("target", "a stiffness", "shapes alone, in a scene with contact")
    if task.statement.norm != "2":
        raise InputError("norm", task.statement.norm, '"2", in a scene with contact')
    if rubs(task.scene) and any(isinstance(target, Hold | Wrap) for target in task.targets):
        allowed = "places and poses alone where contacts have friction; 0 for holds and wraps"
        raise InputError("Contact.friction", "above 0", allowed)
    if avoids:
        allowed = "none in a scene with contact: there they are effects"
        raise InputError("obstacles", "given", allowed)
    if task.limits.strokes is not None:
        raise InputError("stroke_max", "given", "none in a scene with contact")
    # Refuses an arm that is inside of an obstacle at rest, which every start would meet.
    TouchingMap(task.arm, task.scene, STAGES, ROUGH)


def check_holds(targets: tuple[Target, ...], scene: Scene) -> None:
    """Raise InputError for what is held and is no contact of the scene."""
    touched = [contact.obstacle for contact in contacts(scene)]
    for target in targets:
        if isinstance(target, Hold) and target.obstacle not in touched:
            allowed = "an obstacle that the scene has as a Contact"
            raise InputError("Hold.obstacle", target.obstacle, allowed)
