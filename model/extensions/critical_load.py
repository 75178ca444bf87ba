"""The critical load factor of an arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.continuation import BranchEnd, continue_branches
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.forward import ORDER, checked_accuracy, collocation_map, first_pair, refined
from octoplan.model.loads import convergence_order, is_coupled
from octoplan.model.scene import Scene
from octoplan.model.settle import checked_scene
from octoplan.model.support.checks import positive
from octoplan.model.support.errors import InputError


@dataclass(frozen=True)
class Critical:
    """The end of the branch of stable equilibria that begins at the unloaded arm.

    Attributes
    ----------
    load_factor : float
        Factor of the scene's loads at the end of the branch; above 1 the arm bears the loads.
    why : str
        Reason for the end; empty if the branch continues up to the largest load factor.
    """

    load_factor: float
    why: str


def critical_load_factor(
    arm: Arm, tensions: Any, scene: Scene, most: float = 10.0, accuracy: float = 1e-4
) -> Critical:
    """Return the factor of all loads that an arm bears under tensions, by continuation.

    Parameters
    ----------
    most : float
        Largest load factor of the continuation.
    accuracy : float
        Accepted relative error of the load factor.

    Raises
    ------
    InputError
        For a scene without loads, and as settle does.
    """
    scene = checked_scene(arm, scene)
    accuracy = checked_accuracy(accuracy)
    if not is_coupled(arm, scene):
        raise InputError("scene", scene.effects, "a scene with loads")
    T = arm.flat(tensions)
    most = positive("most", most)

    def end(refinement: int) -> BranchEnd:
        """Return the end of the branch on the mesh of a refinement, four times as accurate."""
        forward = collocation_map(arm, scene, refinement)
        x = forward.system.x(T, 0.0, forward.without_loads(T))
        begin = BranchEnd(Equilibrium(forward.system, x), 0.0)
        lines = np.append(T, 0.0)[None], np.append(T, most)[None]
        first_step = min(1.0, 1 / most)
        return continue_branches([begin], lines, accuracy / 4, first_step=first_step)[0]

    def gap(now: BranchEnd, before: BranchEnd) -> float:
        return abs(now.fraction - before.fraction) / now.fraction

    order = convergence_order(scene, ORDER)
    last, _, _ = refined(first_pair(accuracy), accuracy, order, end, gap)
    return Critical(most * last.fraction, last.why)
