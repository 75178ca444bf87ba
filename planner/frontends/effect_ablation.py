"""Compare a scene with and without each effect: tip change and cost."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, NeoHookean, Shear, Weight
from octoplan.model.effects.base import Effect
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.forward import checked_accuracy, forward_map
from octoplan.model.scene import Scene
from octoplan.model.settle import ACCURACY, settle
from octoplan.model.support.checks import whole, within
from octoplan.model.support.errors import InputError, OctoplanError
from octoplan.model.support.progress import track
from octoplan.planner.frontends.accuracy_study import processor_time

# Tip change over the arm's length from which an effect matters, unless another is given: markers
# of cameras and moulded arms are accurate to about 1 %.
TOLERANCE = 0.01
# Effects with default parameters, by name. The fluid is not a choice of the model: buoyancy is
# switched together with the weight only.
_KNOWN: dict[str, Effect] = {
    type(effect).__name__: effect
    for effect in (Extension(), ExactTendons(), NeoHookean(), Shear(), Weight())
}


@dataclass(frozen=True)
class ProblemSize:
    """Problem sizes, independent of the machine.

    Attributes
    ----------
    states : int
        Number of quantities integrated along the arm, including the pose.
    unknowns, constraints : int
        Size of the boundary value problem; 0 if the shape is an explicit function.
    instructions : int
        Elementary operations to evaluate the shape, or the constraints, on the coarsest mesh.
    """

    states: int
    unknowns: int
    constraints: int
    instructions: int


def problem_size(arm: Arm, scene: Scene) -> ProblemSize:
    """Return the sizes of the forward map of a scene on the coarsest mesh."""
    forward = forward_map(arm, scene, 1)
    if not isinstance(forward, CollocationMap):
        function = forward.function
        carried = 7 + (function.size1_out(2) if function.n_out() > 2 else 0)
        return ProblemSize(carried, 0, 0, function.expand().n_instructions())
    layout = forward.system.layout
    instructions = sum(
        term.count * term.kernel.value.n_instructions() for term in layout.equations.terms
    )
    n = layout.n_states
    carried = layout.node_size + layout.structure.n_strains
    return ProblemSize(carried, n, n, instructions)


@dataclass(frozen=True)
class Switch:
    """Comparison of a scene with and without an effect.

    Attributes
    ----------
    effect : str
        Name of the effect, followed by the effects that were switched too.
    enabled : bool
        Whether the scene has the effect.
    tip_change : float
        Distance between the two tips over L; NaN if one of the scenes does not settle.
    sizes, sizes_without : ProblemSize
        Sizes with and without the effect.
    time_factor : float
        Processor time of settle with the effect over the time without.
    matters : bool
        Whether the tip change is above the tolerance, one of the scenes does not settle, or an
        effect that requires this effect matters.
    problem : str
        Error of the scene that does not settle; empty if both settle.
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
        """Number of states that the effect adds."""
        return self.sizes.states - self.sizes_without.states

    @property
    def unknowns_added(self) -> int:
        """Number of unknowns that the effect adds; negative if a coarser mesh is sufficient."""
        return self.sizes.unknowns - self.sizes_without.unknowns


def switch_effects(
    arm: Arm,
    tensions: Any,
    scene: Scene,
    accuracy: float = ACCURACY,
    repeats: int = 5,
    tolerance: float = TOLERANCE,
) -> tuple[Switch, ...]:
    """Settle a scene with each of its effects switched off in turn, and others switched on.

    The others are effects with default parameters: extension, exact tendons, the neo-Hookean body,
    shear and weight. Effects that an effect requires are switched on too, and effects that require
    an effect are switched off too. Buoyancy is switched together with the weight only, because the
    fluid around the arm is given.

    Parameters
    ----------
    arm, tensions, scene, accuracy
        See settle.
    repeats : int
        Number of timed runs.
    tolerance : float
        Tip change over the arm's length from which an effect matters, from 2 accuracies to 1.

    Returns
    -------
    tuple of Switch
        First the effects of the scene, then the others.

    Raises
    ------
    InputError
        As settle, for `repeats` below 1, and for a tolerance that the accuracy does not resolve;
        the scene must settle.
    """
    repeats = whole("repeats", repeats, 1)
    check_tolerance(tolerance, checked_accuracy(accuracy))
    settle(arm, tensions, scene, accuracy)
    own = [effect for effect in scene.effects if not isinstance(effect, Buoyancy)]
    others = [(_without(scene, effect), effect) for effect in own]
    addable = {} if scene.has(PrintedStatics) else _KNOWN
    for effect in addable.values():
        if not scene.has(type(effect)):
            added = [effect, *(_KNOWN[name] for name in _needs(effect))]
            missing = [each for each in added if not scene.has(type(each))]
            others.append((Scene(*scene.effects, *missing), effect))
    switches = [
        switch_effect(arm, tensions, scene, other, effect, accuracy, repeats, tolerance)
        for other, effect in track("effects switched", others)
    ]
    pairs = list(zip((effect for _, effect in others), switches, strict=True))
    required = {name for effect, switch in pairs if switch.matters for name in _needs(effect)}
    return tuple(
        replace(switch, matters=switch.matters or type(effect).__name__ in required)
        for effect, switch in pairs
    )


def check_tolerance(tolerance: float, accuracy: float) -> None:
    """Raise InputError for a tolerance that shapes of an accuracy do not resolve."""
    within("tolerance", tolerance, 0.0, 1.0)
    if tolerance < 2 * accuracy:
        allowed = f"at least 2 accuracies, {2 * accuracy:g}; lower the accuracy"
        raise InputError("tolerance", tolerance, allowed)


def _needs(effect: Effect) -> set[str]:
    """Return the names of the effects that an effect requires."""
    return {name for name, _ in effect.needs()}


def _without(scene: Scene, effect: Effect) -> Scene:
    """Return the scene without an effect, and without effects that require this effect."""
    left = [other for other in scene.effects if other != effect]
    names = {type(other).__name__ for other in left}
    return Scene(*(other for other in left if _needs(other) <= names))


def switch_effect(
    arm: Arm,
    tensions: Any,
    scene: Scene,
    other: Scene,
    effect: Effect,
    accuracy: float = ACCURACY,
    repeats: int = 5,
    tolerance: float = TOLERANCE,
) -> Switch:
    """Settle a scene, and another one that differs by an effect.

    The time factor is the median over alternating runs of both scenes.
    """
    enabled = effect in scene.effects
    with_it, without = (scene, other) if enabled else (other, scene)
    added = [each for each in with_it.effects if each not in without.effects]
    names = [type(each).__name__ for each in sorted(added, key=lambda each: each != effect)]
    change = np.nan
    factor = np.nan
    problem = ""
    calls = [partial(settle, arm, tensions, each, accuracy) for each in (with_it, without)]
    try:
        tips = [call().tip for call in calls]
        times = [[processor_time(call) for call in calls] for _ in range(repeats)]
        change = float(np.linalg.norm(tips[0] - tips[1])) / arm.length
        factor = float(np.median([pair[0] / pair[1] for pair in times]))
    except OctoplanError as reason:
        problem = str(reason)
    return Switch(
        " and ".join(names),
        enabled,
        change,
        problem_size(arm, with_it),
        problem_size(arm, without),
        factor,
        not change <= tolerance,
        problem,
    )
