"""Plans with wraps: obstacles beside the arm, and the length of a part that is given by turns."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.extensions.contact.effects import contacts, without_contacts
from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.scene import Scene
from octoplan.model.support.errors import InputError
from octoplan.model.support.progress import OutOfTime
from octoplan.planner.extensions.contact.hold import Hold
from octoplan.planner.extensions.contact.remarks import LOOKS, turned
from octoplan.planner.extensions.contact.wrap import Wrap
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import Environment, PlanningProblem
from octoplan.planner.targets.base import Target

# Number of plans for the length of a part, and the share by which a part exceeds its estimate.
_ROUNDS, _SPARE = 4, 0.01


def beside(targets: Iterable[Target], scene: Scene) -> tuple[Obstacle, ...]:
    """Return the obstacles of wraps that are no contacts: the arm keeps clear of these obstacles.

    Raises InputError if the scene has other obstacles as contacts.
    """
    touched = [contact.obstacle for contact in contacts(scene)]
    obstacles = [wrap.obstacle for wrap in targets if isinstance(wrap, Wrap)]
    free = tuple(obstacle for obstacle in obstacles if obstacle not in touched)
    if free and touched:
        allowed = "an obstacle that is a Contact of the scene, which has others"
        raise InputError("Wrap.obstacle", free[0], allowed)
    return free


def beside_contacts(problem: PlanningProblem) -> PlanningProblem | None:
    """Return the problem of an arm that keeps clear of the bodies that it may lean on.

    None if no target lies along an obstacle, and if an object is to be held.
    """
    kinds = [type(target) for target in problem.targets]
    if Wrap not in kinds or Hold in kinds:
        return None
    bodies = tuple(contact.obstacle for contact in contacts(problem.scene))
    scene = without_contacts(problem.scene)
    return replace(problem, scene=scene, environment=Environment(bodies))


def open_wrap(targets: Iterable[Target]) -> Wrap | None:
    """Return the wrap whose length a plan has to find; raises InputError for several."""
    wraps = [wrap for wrap in targets if isinstance(wrap, Wrap) and wrap.is_open]
    if len(wraps) > 1:
        raise InputError("target", wraps, "one Wrap by turns, others with where they begin")
    return wraps[0] if wraps else None


def with_places_of(targets: tuple[Target, ...], before: tuple[Target, ...]) -> tuple[Target, ...]:
    """Return the targets with the places that a plan has added to wraps of the same parts.

    Then both programs have the same structure, as a warm start requires.
    """
    if len(targets) != len(before):
        return targets
    pairs = zip(targets, before, strict=True)
    return tuple(_with_places_of(target, each) for target, each in pairs)


def _with_places_of(target: Target, before: Target) -> Target:
    if not (isinstance(target, Wrap) and isinstance(before, Wrap)) or target.places:
        return target
    same = (target.start, target.length, target.turns is None)
    if same != (before.start, before.length, before.turns is None):
        return target
    return replace(target, places=before.places)


def with_turns(
    arm: Arm,
    targets: tuple[Target, ...],
    wrap: Wrap,
    planned: Callable[[tuple[Target, ...], Plan | None], Plan],
) -> Plan:
    """Return the plan for a wrap that is given by its turns.

    Plans for parts of increasing length, each near the one before, lead to a part with enough
    turns. The last plan is for the share of this part that the turns need, with the number of turns
    as an inequality.
    """

    def stated(part: Wrap) -> tuple[Target, ...]:
        return tuple(part if target is wrap else target for target in targets)

    assert wrap.turns is not None
    start = wrap.part(arm)[0]
    before: Plan | None = None
    with suppress(OutOfTime):
        for _ in range(_ROUNDS):
            length = min((arm.length - start) * (1 + _SPARE), arm.length)
            before = planned(stated(replace(wrap, turns=None, length=length)), before)
            if before.mode != "exact" or before.solution.stopped:
                break
            s = np.linspace(arm.length - length, arm.length, LOOKS)
            turns = turned(before.shape, wrap.obstacle, s)
            if turns[-1] >= wrap.turns:
                start = float(np.interp(turns[-1] - wrap.turns, turns, s))
                break
            start = max(arm.length - length * wrap.turns / max(float(turns[-1]), 1e-300), 0.0)
    length = min((arm.length - start) * (1 + _SPARE), arm.length)
    return planned(stated(replace(wrap, start=arm.length - length)), before)
