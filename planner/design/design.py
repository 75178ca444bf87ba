"""Design an arm for its tasks: the numbers of the arm that make their plans cheapest together."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from model import Arm, InputError, Scene
from model.effects import PrintedStatics
from model.errors import OctoplanError
from model.paths import Array
from model.progress import tell, with_progress
from model.settle import checked_scene
from planner.design.designed import Design
from planner.design.making import Making
from planner.design.objective import Objective, Reach, checked_objective
from planner.design.program import Optimum, Program
from planner.design.tasks import Targets
from planner.fit.unknowns import Unknown
from planner.plan import Plan, plan
from planner.program.limits import Limits
from planner.program.terms import compliance_requests, term_names
from planner.question import check_targets
from planner.targets import Softest, Stiffest
from planner.unknowns.parameters import Parameters, spread

# What the given arm may lack of what can be made [mm].
_END = 1e-6


@with_progress
def design(
    arm: Arm,
    targets: Iterable[Any],
    unknowns: Iterable[Unknown],
    scene: Scene | None = None,
    tension_max: Any = np.inf,
    *,
    making: Making | None = None,
    objective: Objective = "effort",
    begins: int = 3,
    starts: int | None = None,
    seed: int = 0,
    progress: bool | None = None,
) -> Design:
    """Return the arm for which several tasks take the least effort together, or another objective.

    Local optimisations begin at the given arm and at others within the bounds, each at its plans;
    every task is planned afresh for the best arm found, and certified as any plan is.

    Parameters
    ----------
    targets : sequence of targets
        A task each: a target, or several that are to be met at once.
    unknowns : sequence of Unknown
        Numbers of the arm.
    tension_max : float, or one for each tendon
        [N].
    making : Making
        What can be made.
    objective : "effort", Stiffest, Softest or Reach
        What is best while all tasks are met: the root of the sum of squared efforts; the stiffness
        of the tip along a direction, tensions held, its geometric mean over the tasks; or how far
        the tip gets along a direction, by tensions of its own, with limits that are finite.
    begins : int
        How many arms are begun with: the given one, then others spread evenly over the bounds.
    starts : int
        Initial guesses of each plan; see plan.
    seed : int
        Of the other arms.
    progress : bool
        Whether a line tells how far it is: unless given, after two seconds, on terminals and in
        notebooks.

    Raises
    ------
    InputError
        For targets and unknowns that do not fit, for targets that cannot be met exactly, or that
        ask for a stiffness, whose derivative by numbers of the arm is not known, and for an arm to
        begin with that cannot be made.
    """
    scene = checked_scene(arm, scene)
    if scene.has(PrintedStatics):
        raise InputError("scene", "as printed", "a scene whose equations hold under loads")
    if not (isinstance(begins, int) and 1 <= begins <= 1000):
        raise InputError("begins", begins, "a whole number from 1 to 1000")
    objective = checked_objective(objective)
    tasks = _checked(arm, targets)
    parameters = Parameters.of(arm, scene, unknowns)
    for own in parameters.unknowns:
        if not all(key.startswith("arm.") and not key.startswith("arm.base") for key in own.keys):
            raise InputError("key", own.name, "numbers of the arm but for its base")
    making, limits = making or Making(), Limits.of(arm, tension_max)
    _check_made(making, arm)
    if isinstance(objective, Reach) and not np.all(np.isfinite(limits.upper)):
        raise InputError("tension_max", tension_max, "finite tensions where a reach is asked for")
    search = _Search(parameters, tasks, limits, making, objective, starts)
    before = search.plans(arm)
    found = search.optimum(before, begins, seed)
    best = parameters.built(found.values, "")[0]
    reaches = None
    if isinstance(objective, Reach):
        at_first = search.program(parameters.start, before).solve(fixed=True)
        both = (own.tensions[-1].tolist() for own in (at_first, found))
        reaches = (tuple(next(both)), tuple(next(both)))
    return Design(
        arm,
        scene,
        parameters.unknowns,
        tuple(found.values.tolist()),
        best,
        search.plans(best),
        before,
        found.steps,
        making,
        objective,
        reaches,
    )


@dataclass(frozen=True)
class _Search:
    """Local optimisations of one design."""

    parameters: Parameters
    tasks: list[Targets]
    limits: Limits
    making: Making
    objective: Objective
    starts: int | None

    def plans(self, arm: Arm, scene: Scene | None = None) -> tuple[Plan, ...]:
        """Return the plans of all tasks, each by itself the best for the objective."""
        more = (self.objective,) if isinstance(self.objective, Stiffest | Softest) else ()
        if scene is None:
            scene = self.parameters.built(self.parameters.start, "")[1]
        found = []
        for i, task in enumerate(self.tasks):
            tell("tasks planned", i, len(self.tasks))
            asked = (*task, *more)
            found.append(plan(arm, asked, scene, self.limits.upper, starts=self.starts))
        return tuple(found)

    def program(self, values: Array, plans: tuple[Plan, ...]) -> Program:
        """Return the program that begins at values and the plans of that arm."""
        T, tasks = [np.ravel(own.tensions) for own in plans], list(self.tasks)
        if isinstance(self.objective, Reach):
            T, tasks = [*T, T[0]], [*tasks, ()]
        given = self.limits, self.making, values, np.array(T), self.objective
        return Program(self.parameters, tasks, *given)

    def optimum(self, before: tuple[Plan, ...], begins: int, seed: int) -> Optimum:
        """Return the best optimum of those that the given arm and others lead to."""
        found = []
        for i, values in enumerate(spread(self.parameters, begins, seed)):
            tell("arms begun with", i, begins)
            try:
                arm, scene = self.parameters.built(values, "")
                if i and self.making.room(arm).min() < 0:
                    continue
                plans = self.plans(arm, scene) if i else before
                found.append(self.program(values, plans).solve())
            except OctoplanError:
                if not i:
                    raise
        return min(found, key=lambda own: own.cost)


def _check_made(making: Making, arm: Arm) -> None:
    lacking = -1e3 * float(making.room(arm).min()) * arm.length
    if lacking > _END:
        allowed = f"a limit that the given arm keeps: it misses it by {lacking:.3g} mm"
        raise InputError("making", making, allowed)


def _checked(arm: Arm, targets: Iterable[Any]) -> list[Targets]:
    tasks = [check_targets(arm, target) for target in targets]
    if not tasks:
        raise InputError("targets", targets, "at least one task")
    for i, task in enumerate(tasks):
        if compliance_requests(task):
            raise InputError(f"targets[{i}]", "a stiffness", "targets of shape alone")
        if term_names(arm, task)[1]:
            raise InputError(f"targets[{i}]", task, "targets that can be met exactly")
    return tasks
