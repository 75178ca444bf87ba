"""Initial guesses: tensions fitted to the targets, the straight arm, drawn arms that are near.

For a point, which arms meet in many ways that go over into each other, the latter two do.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from model.arm import Arm
from model.paths import Array
from planner.initial_guess.fitting import fitted
from planner.initial_guess.many_arms import BendCoordinates, residuals
from planner.program.problem import units
from planner.program.terms import pulling_tendons, terms_of
from planner.solve.task import Task
from planner.targets.base import Target

# Arms that are drawn, what a unit of tension counts beside how near they are, and by what part of
# their tensions those that are taken differ at least.
_DRAWN, _CHEAP, _DIFFERENT = 200, 0.2, 0.5
# Drawn arms before the straight one, and before those with more pull.
_FIRST = 3
# How many times what bends it without loads an arm may take with them.
_STRONGER = 3.0
# How many conditions a point is.
POINT = 3
# How much all tendons pull in the straight arm, of a unit of tension: a little inside the limits.
_INSIDE = 0.005


def initial_guesses(task: Task, loaded: bool = False) -> Iterator[Array]:
    """Yield tensions (n_tendons,) [N] within limits: fitted ones, drawn ones, the straight arm's.

    Fitted ones come by effort. Drawn ones are looked at on the coarsest mesh, in a scene without
    loads, and come by how near they are to what the targets want; those that hardly differ from one
    before are left out. Of an arm that is `loaded` some come again with more pull.
    """
    limits, count = task.allowed, conditions(task.arm, task.targets)
    straight = np.clip(_INSIDE * units(task.arm, limits), limits.lower, limits.upper)
    if count > POINT:
        yield from fitted(task)
    # A bend in a plane is met by arms that wind round once more, too, and more cheaply by those
    # next to the straight one.
    first = -1 if count < POINT else _FIRST
    if first < 0:
        yield straight
    for k, T in enumerate(drawn_arms(task)):
        yield T
        if k == first:
            yield straight
        if k >= _FIRST and loaded:
            yield np.clip(_STRONGER * T, limits.lower, limits.upper)


def drawn_arms(task: Task) -> Iterator[Array]:
    """Yield drawn tensions that differ: by nearness and effort, and by nearness alone, in turn.

    Without a look at the time, of which they take little.
    """
    unit = units(task.arm, task.allowed)
    bends = BendCoordinates(task.arm, pulling_tendons(task.arm, task.targets), task.allowed)
    drawn = bends.tensions(bends.draw(_DRAWN))
    distance = np.linalg.norm(residuals(task, drawn), axis=1)
    cheap = distance + _CHEAP * np.linalg.norm(drawn / unit, axis=1)
    orders = (np.argsort(cheap, kind="stable"), np.argsort(distance, kind="stable"))
    taken = np.zeros((0, unit.size))
    for T in drawn[np.ravel(orders, "F")]:
        apart = np.linalg.norm((taken - T) / unit, axis=1)
        if np.all(apart > _DIFFERENT * np.linalg.norm(T / unit)):
            taken = np.vstack([taken, T])
            yield T


def conditions(arm: Arm, targets: tuple[Target, ...]) -> float:
    """Return how many numbers are to be met; infinite where others are to be kept above 0."""
    terms = terms_of(arm, targets)
    return np.inf if terms.names[2] else terms.count
