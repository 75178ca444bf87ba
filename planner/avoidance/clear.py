"""The inequalities of a plan among obstacles, and the midline that they are looked for along."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.centreline import Centreline
from model.equilibrium.forward import STAGES, Collocation
from model.errors import OctoplanError
from model.paths import Array
from planner.avoidance.rows import Avoidance
from planner.program.statement import Statement
from planner.solve.refine import settled
from planner.solve.task import Task


def keeping(task: Task, avoidance: Avoidance | None) -> Task:
    """Return a task with inequalities."""
    if avoidance is None or not avoidance.rows:
        return task
    return replace(task, targets=(*task.targets, avoidance))


def line_of(
    task: Task, statement: Statement, T: Array, finished: bool = False
) -> Centreline | None:
    """Return the centreline of an arm under tensions on a mesh; None if it does not settle.

    Of a plan that is `finished` on the mesh of its shape, and near it.
    """
    arm, scene = task.arm, task.scene
    try:
        places = tuple(Avoidance(()).stations(arm))
        refinement, near = statement.refinement, None
        if finished:
            shape = settled(arm, T, scene, task.accuracy, task.machine_code)
            refinement, near = shape.refinement, shape.known
        form = STAGES, refinement, places, True, task.machine_code
        forward = Collocation(arm, scene, *form)
        return Centreline.at_states(forward.system, forward.found(T, near).states)
    except (OctoplanError, np.linalg.LinAlgError):
        return None
