"""Environments: required distances, violations, and checks of the arguments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.centreline import Centreline
from octoplan.model.extensions.clearance import clearances
from octoplan.model.extensions.clearance.nearest import BASE, ITSELF, OBSTACLES
from octoplan.model.extensions.obstacles import Moving
from octoplan.model.extensions.obstacles.base import check_obstacles, distances_from
from octoplan.model.paths import Array
from octoplan.model.support.checks import flag, not_negative
from octoplan.model.support.errors import InputError
from octoplan.planner.planning_problem import Environment
from octoplan.planner.targets.base import Target

# Additional distance of plans, over L and over the clearance: the resolution of verified bounds.
_SPARE = (1e-4, 2e-2)


def required_gaps(environment: Environment) -> Mapping[str, float]:
    """Return the required distances [m] by the kind of body; see octoplan.model.extensions."""
    kinds = [OBSTACLES] * bool(environment.obstacles) + [BASE, ITSELF] * environment.of_itself
    return dict.fromkeys(kinds, environment.clearance)


def spare(environment: Environment, arm: Arm) -> float:
    """Return the distance that plans keep in addition to the clearance [m]."""
    return _SPARE[0] * arm.length + _SPARE[1] * environment.clearance


def allows(environment: Environment, arm: Arm, targets: tuple[Target, ...]) -> bool:
    """Return whether the tip positions that targets prescribe are off the base plane."""
    least = _radius(arm, arm.length) + environment.clearance
    normal = np.array(arm.base_frame)[:, 0]
    heights = [(place - arm.base_position) @ normal for place in _tips(arm, targets)]
    return not environment.of_itself or min(heights, default=np.inf) >= least


def in_the_way(environment: Environment, line: Centreline) -> str:
    """Return a description of the body nearest to an arm that is too near; "" if it is clear."""
    required = required_gaps(environment)
    gaps = clearances(line, environment.obstacles, required, environment.clearance)
    keeps = all(gaps[name].gap >= gap for name, gap in required.items())
    return "" if keeps else str(min(gaps.values(), key=lambda clear: clear.gap))


def surroundings(
    arm: Arm,
    targets: tuple[Target, ...],
    obstacles: Any,
    clearance: Any,
    of_itself: bool,
    in_time: bool = False,
) -> Environment:
    """Return the environment for arguments of `plan`; obstacles of motions may move (`in_time`).

    Raises InputError for other objects, a negative clearance, a clearance without obstacles, and
    for obstacles that contain the base or a position that the targets prescribe.
    """
    value = list(obstacles) if in_time and isinstance(obstacles, Sequence) else []
    moving = tuple(obstacle for obstacle in value if isinstance(obstacle, Moving))
    still = check_obstacles([one for one in value if one not in moving] if moving else obstacles)
    of_itself = flag("self_clearance", of_itself)
    checked = Environment(still, not_negative("clearance", clearance), of_itself, moving)
    if checked.clearance and not checked:
        allowed = "0 without obstacles; pass obstacles, or self_clearance=True"
        raise InputError("clearance", clearance, allowed)
    if not still:
        return checked
    base = "the arm's base", np.array(arm.base_position), 0.0, "an obstacle away from the base"
    allowed = "an obstacle away from the target, or a target away from the obstacle"
    tips = (("the tip at its target", place, arm.length, allowed) for place in _tips(arm, targets))
    for name, place, s, allowed in (base, *tips):
        gaps = distances_from(still, place[None])[0] - _radius(arm, s) - checked.clearance
        for i in np.flatnonzero(gaps < 0):
            sentence = f"{allowed}: {name} would be {-1e3 * gaps[i]:.3g} mm too near"
            raise InputError(f"obstacles[{i}]", still[i], sentence)
    return checked


def _tips(arm: Arm, targets: tuple[Target, ...]) -> list[Array]:
    """Return the tip positions (3,) that targets prescribe."""
    prescribed = [target.prescribed(arm) for target in targets]
    return [places["tip position"] for places in prescribed if "tip position" in places]


def _radius(arm: Arm, s: float) -> float:
    return float(arm.outer_radius(np.array([s]))[0][0])
