"""Plans for many targets in one call: along a path each begins at the one before."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from model.arm import Arm
from model.errors import InputError
from model.scene import Scene
from planner.plan import Plan, plan
from planner.targets.base import Target


def plan_many(
    arm: Arm,
    targets: Iterable[Target | Iterable[Target]],
    scene: Scene | None = None,
    tension_max: Any = float("inf"),
    *,
    path: bool = True,
    **others: Any,
) -> list[Plan]:
    """Return a plan for each of many targets, in order; `others` as plan takes them.

    Parameters
    ----------
    path : bool
        Whether each target is near the one before, so that its plan starts at the other's optimum:
        some ten times sooner, and tensions that change smoothly. What is followed is one optimum;
        plans that start afresh may find a better one.

    Raises
    ------
    InputError
        As plan does, naming the target.
    """
    plans: list[Plan] = []
    for i, target in enumerate(targets):
        near = plans[-1] if path and plans else None
        try:
            plans.append(plan(arm, target, scene, tension_max, near=near, **others))
        except InputError as error:
            raise InputError(f"targets[{i}]: {error.field}", error.given, error.allowed) from None
    return plans
