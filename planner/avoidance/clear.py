"""Tasks with inequalities that keep clear, the midline that these are looked for along, clear arms.

Arms that touch nothing are drawn at random: where to begin on the other side of obstacles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from model.centreline import Centreline
from model.clearance.lines import Lines
from model.errors import OctoplanError
from model.obstacles.bodies import Bodies
from model.paths import Array
from planner.avoidance.places import least_gap
from planner.avoidance.rows import Avoidance, grid
from planner.avoidance.surroundings import Surroundings
from planner.initial_guess.many_arms import bend_coordinates, many_places, residuals
from planner.program.terms import pulling_tendons
from planner.solve.refine import settled
from planner.solve.task import Task

# Arms that are drawn, so many looked at together, the most that are looked at closely, and given.
_DRAWN, _TOGETHER, _LOOKED_AT, _MOST = 6000, 200, 40, 6


def keeping(task: Task, avoidance: Avoidance) -> Task:
    """Return a task with inequalities."""
    return replace(task, targets=(*task.targets, avoidance)) if avoidance.rows else task


def line_of(task: Task, T: Array) -> Centreline | None:
    """Return the centreline of a plan's settled shape; None if it does not settle."""
    try:
        shape = settled(task.arm, T, task.scene, task.accuracy, task.machine_code)
        return Centreline.of(shape, grid(task.arm).tolist())
    except (OctoplanError, np.linalg.LinAlgError):
        return None


def clear_arms(task: Task, surroundings: Surroundings, lines: Lines) -> list[Array]:
    """Return tensions of arms that touch nothing, the nearest to the targets first."""
    drawn = islice(_likely_clear(task.simple, surroundings), _LOOKED_AT)
    results = ((T, line) for T in drawn if (line := lines(T)) is not None)
    clear = (T for T, line in results if least_gap(line, surroundings) >= 0)
    return list(islice(clear, _MOST))


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
