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
from model.paths import Array
from planner.avoidance.places import least_gap
from planner.avoidance.rows import Avoidance, grid
from planner.avoidance.surroundings import Surroundings
from planner.initial_guess.guesses import drawn_arms
from planner.solve.refine import settled
from planner.solve.task import Task

# The most arms that are looked at, and given.
_LOOKED_AT, _MOST = 100, 6


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
    """Return tensions of drawn arms that touch nothing, the nearest to the targets first."""
    question = task.arm, task.simple.scene, task.targets, task.allowed, task.machine_code
    looked_at = ((T, lines(T)) for T in islice(drawn_arms(*question), _LOOKED_AT))
    clear = (T for T, at in looked_at if at is not None and least_gap(at, surroundings) >= 0)
    return list(islice(clear, _MOST))
