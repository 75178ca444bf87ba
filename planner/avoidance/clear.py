"""Tasks with inequalities that keep clear, the midline that these are looked for along, clear arms.

Arms that touch nothing are drawn at random: where to begin on the other side of obstacles.
"""

from __future__ import annotations

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

# Arms that are drawn, the most that are looked at closely, and given.
_DRAWN, _LOOKED_AT, _MOST = 6000, 40, 6


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
    """Return tensions of arms that touch nothing, the nearest to the targets first.

    Those that touch an obstacle without their loads, on the coarsest mesh, are left out beforehand.
    """
    simple, arm = task.simple, task.arm
    bends = bend_coordinates(arm, pulling_tendons(arm, task.targets), task.allowed)
    tensions = bends.tensions(bends.draw(_DRAWN))
    points, radius = many_places(arm, simple.scene, tensions, task.machine_code)
    gaps = Bodies(surroundings.obstacles).at(points[:, :, None])[0] - radius[:, None]
    tensions = tensions[(gaps >= surroundings.clearance).all(axis=(1, 2))]
    off = residuals(arm, simple.scene, task.targets, tensions, task.machine_code)
    nearest = tensions[np.argsort(np.linalg.norm(off, axis=1), kind="stable")]
    looked_at = ((T, lines(T)) for T in nearest[:_LOOKED_AT])
    clear = (T for T, line in looked_at if line is not None and least_gap(line, surroundings) >= 0)
    return list(islice(clear, _MOST))
