"""Design an arm for its tasks: the numbers of the arm that make their plans cheapest together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from model import Arm, InputError, Scene
from model.effects import PrintedStatics
from model.errors import OctoplanError
from model.paths import Array
from model.progress import tell
from model.settle import checked_scene
from planner.design.making import Making
from planner.design.program import Optimum, Program
from planner.design.sensitivity import effort_slopes
from planner.design.tasks import Targets, Tasks
from planner.plan import Plan, plan
from planner.program.limits import Limits
from planner.program.terms import compliance_requests, term_names
from planner.question import check_targets
from planner.unknowns.parameters import Parameters, spread
from planner.unknowns.unknown import Unknown

_END, _REFINEMENT = 1e-6, 2


@dataclass(frozen=True)
class Design:
    """A designed arm.

    Attributes
    ----------
    given_arm, scene
        What it began with.
    unknowns : tuple of Unknown
    values : tuple of float
        In the units of their keys.
    arm : Arm
        The designed arm.
    plans, before : tuple of Plan
        Of each task for the designed arm, and for the given one.
    steps : int
        Of the optimisation.
    making : Making
        What can be made.
    """

    given_arm: Arm
    scene: Scene
    unknowns: tuple[Unknown, ...]
    values: tuple[float, ...]
    arm: Arm
    plans: tuple[Plan, ...] = field(compare=False)
    before: tuple[Plan, ...] = field(compare=False)
    steps: int
    making: Making = field(default_factory=Making)

    @cached_property
    def parameters(self) -> Parameters:
        """The unknowns with what they are numbers of."""
        return Parameters.of(self.given_arm, self.scene, self.unknowns)

    @property
    def array(self) -> Array:
        """The values (K,)."""
        return np.array(self.values)

    @property
    def feasible(self) -> bool:
        """Whether the designed arm meets every task, by the plans' certificates."""
        return _met(self.plans)

    @property
    def effort(self) -> float:
        """Root of the sum of the squared efforts of all tasks [N]."""
        return _total(self.plans)

    @property
    def gain(self) -> float:
        """The share of the given arm's effort that is saved; NaN unless both meet all tasks."""
        met = self.feasible and _met(self.before)
        return 1 - self.effort / _total(self.before) if met else float("nan")

    @cached_property
    def sensitivity(self) -> Array:
        """How the effort changes with the unknowns (K,) [N per unit], tensions chosen anew.

        At a bound it says what the bound costs. Raises InputError unless all tasks are met.
        """
        if not self.feasible:
            raise InputError("design", "tasks that are not met", "a design that meets all tasks")
        tasks = Tasks(self.parameters, [own.targets for own in self.plans], _REFINEMENT)
        T = np.array([np.ravel(own.tensions) for own in self.plans])
        return effort_slopes(self.plans, tasks.missed(self.array, T))

    @cached_property
    def outcome(self) -> str:
        """What was found, and where that is not enough which task and which limit hold it."""
        told = [self._told()]
        for i, own in enumerate(self.plans):
            if not own.certificate.passed:
                told.append(f"Task {i} is not met: {own.outcome}{self._held(own)}")
        limits = self.making.binding(self.arm)
        if limits:
            told.append(f"At a limit of what can be made: {', '.join(limits)}.")
        rows = zip(self.unknowns, self.values, strict=True)
        ends = [own.name for own, x in rows if _at_end(own, x)]
        if ends:
            told.append(f"At a bound: {', '.join(ends)}.")
        return " ".join(told)

    def _held(self, own: Plan) -> str:
        """Return which tension limits a plan is at."""
        T, upper = np.ravel(own.tensions), np.array(own.limits.upper)
        at = np.flatnonzero(upper * (1 - _END) <= T)
        names = ", ".join(own.arm.tendon_name(int(j)) for j in at)
        return f" At the tension limit: {names}." if names else ""

    def _told(self) -> str:
        tasks = f"{len(self.plans)} tasks, {len(self.unknowns)} unknowns"
        if not self.feasible:
            return f"{tasks}: no arm within the bounds was found that meets all of them."
        if not np.isfinite(self.gain):
            return f"{tasks}: effort {self.effort:.4g} N; the given arm does not meet all of them."
        saved = f"{100 * self.gain:.3g} % less than the given arm's {_total(self.before):.4g} N"
        return f"{tasks}: effort {self.effort:.4g} N, {saved}."


def design(
    arm: Arm,
    targets: Iterable[Any],
    unknowns: Iterable[Unknown],
    scene: Scene | None = None,
    tension_max: Any = np.inf,
    *,
    making: Making | None = None,
    begins: int = 3,
    starts: int | None = None,
    seed: int = 0,
) -> Design:
    """Return the arm for which several tasks take the least effort together.

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
    begins : int
        How many arms are begun with: the given one, then others spread evenly over the bounds.
    starts : int
        Initial guesses of each plan; see plan.
    seed : int
        Of the other arms.

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
    tasks = _checked(arm, targets)
    parameters = Parameters.of(arm, scene, unknowns)
    for own in parameters.unknowns:
        if not all(key.startswith("arm.") and not key.startswith("arm.base") for key in own.keys):
            raise InputError("key", own.name, "numbers of the arm but for its base")
    making, limits = making or Making(), Limits.of(arm, tension_max)
    _check_made(making, arm)
    before = _plans(arm, tasks, scene, tension_max, starts)
    found = _optimum(parameters, tasks, limits, making, (before, begins, starts, seed))
    best = parameters.built(found.values, "")[0]
    plans = _plans(best, tasks, scene, tension_max, starts)
    values = tuple(found.values.tolist())
    steps = found.steps
    return Design(arm, scene, parameters.unknowns, values, best, plans, before, steps, making)


def _optimum(
    parameters: Parameters,
    tasks: list[Targets],
    limits: Limits,
    making: Making,
    search: tuple[tuple[Plan, ...], int, int | None, int],
) -> Optimum:
    """Return the best optimum of those that the given arm and others lead to."""
    before, begins, starts, seed = search
    found = []
    for i, values in enumerate(spread(parameters, begins, seed)):
        tell("arms begun with", i, begins)
        try:
            arm, scene = parameters.built(values, "")
            if i and making.room(arm).min() < 0:
                continue
            plans = _plans(arm, tasks, scene, limits.upper, starts) if i else before
            T: Array = np.array([np.ravel(own.tensions) for own in plans])
            found.append(Program(parameters, tasks, limits, making, values, T).solve())
        except OctoplanError:
            if not i:
                raise
    return min(found, key=lambda own: own.cost)


def _check_made(making: Making, arm: Arm) -> None:
    lacking = -1e3 * float(making.room(arm).min()) * arm.length
    if lacking > _END:
        allowed = f"what the given arm keeps to: it lacks {lacking:.3g} mm"
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


def _plans(
    arm: Arm, tasks: Sequence[Targets], scene: Scene, tension_max: Any, starts: int | None
) -> tuple[Plan, ...]:
    found = []
    for i, task in enumerate(tasks):
        tell("tasks planned", i, len(tasks))
        found.append(plan(arm, task, scene, tension_max, starts=starts))
    return tuple(found)


def _met(plans: Sequence[Plan]) -> bool:
    return all(own.certificate.passed for own in plans)


def _total(plans: Sequence[Plan]) -> float:
    return float(np.linalg.norm([own.effort for own in plans]))


def _at_end(own: Unknown, value: float) -> bool:
    return min(value - own.lower, own.upper - value) < _END * own.range
