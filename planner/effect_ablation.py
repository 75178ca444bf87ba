"""Which effects matter: a scene settled with each of its effects switched off, and others on."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from model.arm import Arm
from model.effects import (
    Buoyancy,
    Effect,
    ExactTendons,
    Extension,
    NeoHookean,
    PrintedStatics,
    Shear,
    Weight,
)
from model.errors import InputError, OctoplanError
from model.forward import COLLOCATIONS, by_collocation, explicit_map, schemes_of
from model.loads import is_loaded
from model.progress import reported
from model.scene import Scene
from model.settle import ACCURACY, settle
from model.shape import Shape


@dataclass(frozen=True)
class ProblemSize:
    """Counts that do not depend on the machine.

    Attributes
    ----------
    states : int
        Numbers carried along the arm: the pose, and what is integrated with it.
    unknowns, constraints : int
        Of the boundary value problem; none where the shape is an explicit function.
    instructions : int
        Elementary operations to evaluate the shape, or the constraints, on the coarsest mesh.
    """

    states: int
    unknowns: int
    constraints: int
    instructions: int


def problem_size(arm: Arm, scene: Scene) -> ProblemSize:
    """Return the sizes of a scene's functions, by the scheme that is used unless one is named."""
    scheme = schemes_of(scene)[0]
    if not is_loaded(scene):
        function = explicit_map(arm, scene, scheme, 1).function
        carried = 7 + (function.size1_out(2) if function.n_out() > 2 else 0)
        return ProblemSize(carried, 0, 0, function.expand().n_instructions())
    of = by_collocation(arm, scene, COLLOCATIONS[scheme], 1).system.of
    instructions = sum(
        term.count * term.kernel.value.n_instructions() for term in of.equations.terms
    )
    return ProblemSize(of.node_size + of.form.strains, of.n_states, of.n_states, instructions)


# Effects that need no numbers of the user's, and what a scene that has them needs besides.
_KNOWN: tuple[tuple[Effect, ...], ...] = (
    (Extension(),),
    (ExactTendons(),),
    (NeoHookean(), Extension(), ExactTendons()),
    (Shear(),),
    (Weight(),),
    (Buoyancy(), Weight()),
)
_REPEATS = 5


@dataclass(frozen=True)
class Switch:
    """One effect, and the scene with and without it.

    Attributes
    ----------
    effect : str
        Its name, with the names of what had to be switched along with it.
    enabled : bool
        Whether the scene has it.
    tip_change : float
        Distance between the tips with and without it, over L; NaN where one does not settle.
    sizes, sizes_without : ProblemSize
        Of the scene with and without it.
    time_factor : float
        Time of a settle with it over that without it.
    matters : bool
        Whether the tip change is above the accuracy, or the arm does not settle without it or
        with it.
    problem : str
        Why one of the two does not settle, if so.
    """

    effect: str
    enabled: bool
    tip_change: float
    sizes: ProblemSize
    sizes_without: ProblemSize
    time_factor: float
    matters: bool
    problem: str = ""

    @property
    def states_added(self) -> int:
        """How many states it adds."""
        return self.sizes.states - self.sizes_without.states

    @property
    def unknowns_added(self) -> int:
        """How many unknowns it adds; below 0 where a coarser mesh is as accurate with it."""
        return self.sizes.unknowns - self.sizes_without.unknowns


def switch_effects(
    arm: Arm,
    tensions: Any,
    scene: Scene,
    accuracy: float = ACCURACY,
    repeats: int = _REPEATS,
) -> tuple[Switch, ...]:
    """Settle a scene with each of its effects switched off in turn, and others switched on.

    The others are those that have natural values: extension, exact tendons, the neo-Hookean body,
    shear, weight in air and in water. What an effect needs is switched along with it.

    Returns
    -------
    tuple of Switch
        First the scene's own effects, then the others.

    Raises
    ------
    InputError
        As settle does, and for no repeats; the scene itself has to settle.
    """
    _check_repeats(repeats)
    settle(arm, tensions, scene, accuracy)
    parts = [(_without(scene, effect), scene, effect, True) for effect in scene.effects]
    others = [(scene, richer, effect, False) for effect, richer in _richer(scene)]
    results = []
    for without, with_it, effect, enabled in reported("effects switched", [*parts, *others]):
        pair = (without, with_it)
        results.append(_compare(arm, tensions, pair, effect, enabled, accuracy, repeats))
    return tuple(results)


def switch_on(
    arm: Arm,
    tensions: Any,
    scene: Scene,
    effects: tuple[Effect, ...],
    accuracy: float = ACCURACY,
    repeats: int = _REPEATS,
) -> Switch:
    """Settle a scene with and without some effects that it lacks; the first gives its name."""
    _check_repeats(repeats)
    pair = (scene, Scene(*scene.effects, *effects))
    return _compare(arm, tensions, pair, effects[0], False, accuracy, repeats)


def _check_repeats(repeats: int) -> None:
    if isinstance(repeats, bool) or not isinstance(repeats, int) or repeats < 1:
        raise InputError("repeats", repeats, "a whole number from 1")


def _without(scene: Scene, effect: Effect) -> Scene:
    """Return the scene without an effect, and without those that need it."""
    left = [other for other in scene.effects if other != effect]
    while True:
        try:
            return Scene(*left)
        except InputError as reason:
            kinds = [type(other).__name__ for other in left]
            left.pop(kinds.index(str(reason.given)))


def _richer(scene: Scene) -> list[tuple[Effect, Scene]]:
    """Return each of the known effects that the scene lacks and can have, and the scene with it."""
    effects = []
    for effect, *needs in () if scene.has(PrintedStatics) else _KNOWN:
        if not scene.has(type(effect)):
            added = [effect, *(need for need in needs if not scene.has(type(need)))]
            effects.append((effect, Scene(*scene.effects, *added)))
    return effects


def _compare(
    arm: Arm,
    tensions: Any,
    pair: tuple[Scene, Scene],
    effect: Effect,
    enabled: bool,
    accuracy: float,
    repeats: int,
) -> Switch:
    without, with_it = pair
    others = set(with_it.effects) - set(without.effects) - {effect}
    name = " and ".join([*_names([effect]), *_names(others)])
    counted = (problem_size(arm, with_it), problem_size(arm, without))

    def settled(scene: Scene) -> Shape:
        return settle(arm, tensions, scene, accuracy)

    try:
        shapes = [settled(with_it), settled(without)]
    except OctoplanError as reason:
        return Switch(name, enabled, np.nan, *counted, np.nan, True, str(reason))
    change = float(np.linalg.norm(shapes[0].tip - shapes[1].tip)) / arm.length
    factor = _time_factor(lambda: settled(with_it), lambda: settled(without), repeats)
    return Switch(name, enabled, change, *counted, factor, change > accuracy)


def _names(effects: Iterable[Effect]) -> list[str]:
    return sorted(type(effect).__name__ for effect in effects)


def _time_factor(first: Callable[[], Shape], second: Callable[[], Shape], repeats: int) -> float:
    """Return the median ratio of the times of two calls made in turn."""
    ratios = []
    for _ in range(repeats):
        times = []
        for call in (first, second):
            begin = time.perf_counter()
            call()
            times.append(time.perf_counter() - begin)
        ratios.append(times[0] / times[1])
    return float(np.median(ratios))
