"""Where to begin once no optimum can be led around: other arms, and arms that touch nothing."""

from __future__ import annotations

import numpy as np

from model.paths import Array
from planner.avoidance.asked import Surroundings
from planner.avoidance.clear import line_of
from planner.avoidance.clear_guesses import likely_clear
from planner.avoidance.places import near_places
from planner.initial_guess.fitting import COUNT, fitted_guesses
from planner.solve.task import Task

# Arms of both kinds that are given.
_OTHERS, _CLEAR_ONES = 12, 6


def other_arms(task: Task, asked: Surroundings, enough: float) -> list[Array]:
    """Return other arms that meet the targets, those that are farther off first."""
    accuracy, task = task.accuracy, task.simple
    found = fitted_guesses(task.problem(task.coarse("exact")), task.targets, task.allowed, COUNT)
    tensions = [*found.likely, *found.others][: 4 * _OTHERS]
    lacks = []
    for T in tensions:
        line = line_of(task.problem(task.coarse("exact")), T, accuracy)
        near = [] if line is None else near_places(line, asked)
        lacks.append(sum(min(place.gap - enough, 0.0) for place in near))
    order = np.argsort(lacks, kind="stable")[::-1]
    return [tensions[i] for i in order[:_OTHERS]]


def clear_arms(task: Task, asked: Surroundings) -> list[Array]:
    """Return arms that touch nothing, those first that are nearer to the target."""
    accuracy, task = task.accuracy, task.simple
    problem, found = task.problem(task.coarse("exact")), []
    for T in likely_clear(problem, task.targets, task.allowed, asked):
        line = line_of(problem, T, accuracy)
        if line is not None and all(near.gap >= 0 for near in near_places(line, asked)):
            found.append(T)
        if len(found) == _CLEAR_ONES:
            break
    return found
