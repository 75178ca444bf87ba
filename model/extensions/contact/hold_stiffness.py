"""Stiffness of a hold: the force on an obstacle against its displacement."""

from __future__ import annotations

import copy

import numpy as np

from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.extensions.contact.effects import contacts
from octoplan.model.extensions.contact.kernels import BEFORE, FRICTION
from octoplan.model.extensions.contact.touches import kernel_numbers
from octoplan.model.extensions.obstacles.base import Convex
from octoplan.model.paths import Array
from octoplan.model.rotations import POSE
from octoplan.model.shape import Shape
from octoplan.model.support.errors import InputError

# Factor of the friction of the present contacts, so that contacts which slipped before stick now.
_WIDER = 2.0


def hold_stiffness(shape: Shape, obstacle: Convex) -> Array:
    """Return the force of the arm on an obstacle against its displacement (3, 3) [N/m].

    The tensions are constant, and the obstacle moves by a translation. Active contacts stay closed:
    they slide along the obstacle without friction, and stick to the obstacle with friction. The
    reaction of the base to the contact forces follows by the implicit function theorem from the
    derivatives of the equilibrium by the place of the obstacle; with dead loads and this obstacle
    alone in contact, its change is the change of the contact forces.

    Parameters
    ----------
    shape : Shape
        The shape of an arm in contact with this obstacle only.
    obstacle : Convex
        The obstacle of a Contact of the scene.

    Raises
    ------
    InputError
        If the arm does not touch the obstacle, or touches another one.
    SingularError
        If the equilibrium is singular.
    """
    bodies = [contact.obstacle for contact in contacts(shape.scene)]
    touched = {bodies.index(touch.obstacle) for touch in shape.contacts}
    if obstacle not in bodies or touched != {bodies.index(obstacle)}:
        raise InputError("obstacle", obstacle, "the only obstacle that the arm touches")
    j = bodies.index(obstacle)
    point = shape.equilibrium
    assert isinstance(point, Equilibrium)
    system = copy.copy(point.system)
    sticks = contacts(shape.scene)[j].friction > 0
    if sticks:
        numbers = kernel_numbers(system, "touch")
        numbers[:, :, BEFORE] = system.poses(point.states)[1:, None, 4:]
        numbers[:, :, FRICTION] *= _WIDER
    layout = system.layout
    change = np.zeros((layout.equations.n_p, 3))
    for name, values in layout.equations.named(change).items():
        if name in ("touch", "pressure"):
            moved = values["values"].reshape(-1, layout.elements, len(bodies), 3)
            moved[:3, :, j] = np.eye(3)[:, None]
            if name == "touch" and sticks:
                moved[BEFORE, :, j] = np.eye(3)[:, None]
    right = layout.equations.along_parameters(point.x, system.p, change)
    by_displacement = -Equilibrium(system, point.x).solve(right)
    return np.asarray(by_displacement[layout.nodes[0, POSE + 3 : POSE + 6]])
