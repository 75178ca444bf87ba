"""Tasks with inequalities that keep clear, the midline that these are looked for along, clear arms.

Arms that touch nothing are drawn at random: where to begin on the other side of obstacles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from model.centreline import Centreline
from model.equilibrium.newton import STAGES, Collocation
from model.errors import OctoplanError
from model.obstacles.bodies import Bodies
from model.paths import Array
from planner.avoidance.places import near_places
from planner.avoidance.rows import Avoidance
from planner.avoidance.surroundings import Surroundings
from planner.initial_guess.many_arms import bend_coordinates, many_places, residuals
from planner.program.statement import Statement
from planner.program.terms import pulling_tendons
from planner.solve.refine import settled
from planner.solve.task import Task

# Arms that are drawn, so many looked at together, the most that are looked at closely, and given.
_DRAWN, _TOGETHER, _LOOKED_AT, _MOST = 6000, 200, 40, 6


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
        return Centreline.at_states(forward.system, forward.solve(T, near).states)
    except (OctoplanError, np.linalg.LinAlgError):
        return None


def clear_arms(task: Task, surroundings: Surroundings) -> list[Array]:
    """Return tensions of arms that touch nothing, the nearest to the targets first."""
    task, clear = task.simple, list[Array]()
    for k, T in enumerate(_likely_clear(task, surroundings)):
        line = line_of(task, task.coarse("exact"), T)
        if line is not None and all(near.gap >= 0 for near in near_places(line, surroundings)):
            clear.append(T)
        if len(clear) == _MOST or k == _LOOKED_AT:
            break
    return clear


def _likely_clear(task: Task, surroundings: Surroundings) -> Iterator[Array]:
    """Yield tensions of arms that touch no obstacle, the nearest to the targets first.

    Looked at on the coarsest mesh, for a scene without loads, so that some may touch after all.
    """
    arm, targets, limits = task.arm, task.targets, task.allowed
    bends = bend_coordinates(arm, pulling_tendons(arm, targets), limits)
    tensions = bends.tensions(bends.draw(_DRAWN))
    off = residuals(arm, task.scene, targets, tensions, task.machine_code)
    order = np.argsort(np.linalg.norm(off, axis=1), kind="stable")
    bodies = Bodies(surroundings.obstacles)
    for some in np.split(order, np.arange(_TOGETHER, _DRAWN, _TOGETHER)):
        points, radius = many_places(arm, task.scene, tensions[some], task.machine_code)
        distances = bodies.at(points[:, :, None])[0]
        clear = (distances - radius[:, None] >= surroundings.clearance).all(axis=(1, 2))
        yield from (tensions[i] for i in some[clear])
