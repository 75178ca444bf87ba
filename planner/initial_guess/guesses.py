"""Initial guesses: tensions fitted to the targets, the straight arm, drawn arms that are near.

For a point, which arms meet in many ways that go over into each other, the latter two do.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from model.arm import Arm
from model.paths import Array
from model.scene import Scene
from planner.initial_guess.fitting import fitted
from planner.initial_guess.many_arms import bend_coordinates, residuals
from planner.program.limits import Limits
from planner.program.problem import units
from planner.program.terms import pulling_tendons, terms_of
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


def initial_guesses(
    arm: Arm,
    scene: Scene,
    targets: tuple[Target, ...],
    limits: Limits,
    machine_code: bool,
    loaded: bool = False,
) -> Iterator[Array]:
    """Yield tensions (n_tendons,) [N] within limits: fitted ones, drawn ones, the straight arm's.

    Fitted ones come by effort. Drawn ones are looked at on the coarsest mesh, in a scene without
    loads, and come by how near they are to what the targets want; those that hardly differ from one
    before are left out. Of an arm that is `loaded` some come again with more pull.
    """
    unit = units(arm, limits)
    low, high = np.array(limits.lower), np.array(limits.upper)
    straight = np.clip(_INSIDE * unit, low, high)
    count = conditions(arm, targets)
    if count > POINT:
        yield from fitted(arm, scene, targets, limits, machine_code)
    # A bend in a plane is met by arms that wind round once more, too, and more cheaply by those
    # next to the straight one.
    first = -1 if count < POINT else _FIRST
    if first < 0:
        yield straight
    drawn = drawn_arms(arm, scene, targets, limits, machine_code)
    for k, T in enumerate(drawn):
        yield T
        if k == first:
            yield straight
        if k >= _FIRST and loaded:
            yield np.clip(_STRONGER * T, low, high)


def drawn_arms(
    arm: Arm, scene: Scene, targets: tuple[Target, ...], limits: Limits, machine_code: bool
) -> Iterator[Array]:
    """Yield drawn tensions that differ: by nearness and effort, and by nearness alone, in turn.

    Without a look at the time, of which they take little.
    """
    unit = units(arm, limits)
    bends = bend_coordinates(arm, pulling_tendons(arm, targets), limits)
    drawn = bends.tensions(bends.draw(_DRAWN))
    distance = np.linalg.norm(residuals(arm, scene, targets, drawn, machine_code), axis=1)
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
