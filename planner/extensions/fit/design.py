"""Design an arm for its tasks: the numbers of the arm that make their plans cheapest together."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from octoplan.model import Arm, InputError, Scene
from octoplan.model.paths import Array
from octoplan.model.support.checks import kind
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import (
    GRACE,
    OutOfTime,
    limited,
    report,
    reserve,
    seconds_left,
    track,
    with_progress,
)
from octoplan.planner.extensions.fit.calibrate import supported_scene
from octoplan.planner.extensions.fit.design_program import DesignOptimum, DesignProgram, Targets
from octoplan.planner.extensions.fit.designed import Design, worth
from octoplan.planner.extensions.fit.making import Making, Objective, Reach, checked_objective
from octoplan.planner.extensions.fit.unknowns import Parameters, Unknown
from octoplan.planner.plan import Plan, plan
from octoplan.planner.program.terms import Targets as Together
from octoplan.planner.question import Limits, check_targets


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
    time_limit: float | None = None,
    progress: bool | None = None,
) -> Design:
    """Return the arm for which several tasks take the least effort together, or another objective.

    Local optimisations begin at the given arm, at others within the bounds, each at its plans, and
    where a number ends at a bound also at its other bound; every task is planned afresh for the
    best arm found, and certified as any plan is.

    Parameters
    ----------
    arm, scene : Arm, Scene
        The given arm, and the scene of all tasks; the bare arm's unless given.
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
    time_limit : float
        How long the call may take [s]. The search for the best arm ends early by the time that the
        plans of the given arm took, so that those of the best arm are made and certified within the
        limit; they have at least GRACE, 1 s each. The outcome says if the limit ended the search.
    progress : bool
        Whether a line tells how far it is: unless given, after two seconds, on terminals and in
        notebooks.

    Raises
    ------
    InputError
        For targets and unknowns that do not fit, for targets that cannot be met exactly, for an arm
        to begin with that cannot be made, and for scenes as printed or with contact.
    TimeLimitError
        If the time limit is reached before the first arm's optimum.
    """
    if not (isinstance(begins, int) and 1 <= begins <= 1000):
        raise InputError("begins", begins, "a whole number from 1 to 1000")
    parameters = _checked(arm, supported_scene(arm, scene), unknowns)
    making = kind("making", Making() if making is None else making, Making)
    limits = Limits.of(arm, tension_max)
    making.check(arm)
    objective = checked_objective(objective, limits)
    program = DesignProgram(parameters, _tasks(arm, targets), limits, making, objective)
    search, stopped = _Search(program, starts), False
    with limited(time_limit, reserves=True):
        try:
            begun = time.monotonic()
            before = search.plans(arm, parameters.given.scene, certify=True)
            reserve(time.monotonic() - begun)
            search.run(before, begins, seed)
        except OutOfTime:
            if not search.optima:
                raise
            stopped = True
        reserve(0.0)
        end = None if time_limit is None else time.monotonic() + seconds_left()
    best, reaches = search.best, None
    if isinstance(objective, Reach):
        at_first = program.solve(parameters.start, _tensions(before), fixed=True)
        reaches = tuple(at_first.tensions[-1].tolist()), tuple(best.tensions[-1].tolist())
    _, designed, scene = parameters.setting(best.values)
    plans = search.plans(designed, scene, certify=True, end=end)
    ends = zip((arm, designed), (before, plans), reaches or (None, None), strict=True)
    value_before, value = (worth(objective, scene, *each) for each in ends)
    return Design(
        arm,
        scene,
        parameters.unknowns,
        tuple(best.values.tolist()),
        designed,
        plans,
        before,
        value,
        value_before,
        making,
        objective,
        reaches,
        tuple(optimum.objective for optimum in search.optima if optimum.cost[0] == best.cost[0]),
        stopped,
    )


def _checked(arm: Arm, scene: Scene, unknowns: Iterable[Unknown]) -> Parameters:
    """Return the numbers of an arm that a design may choose, or raise InputError."""
    parameters = Parameters.of(arm, scene, unknowns)
    for unknown in parameters.unknowns:
        if unknown.prior or unknown.session is not None:
            raise InputError(unknown.name, "a prior or session", "none in a design")
        if not all(k.startswith("arm.") and not k.startswith("arm.base") for k in unknown.keys):
            raise InputError("key", unknown.name, "numbers of the arm but for its base")
    return parameters


def _tasks(arm: Arm, targets: Iterable[Any]) -> list[Targets]:
    """Return the targets of each task, or raise InputError for those that are not met exactly."""
    kind("targets", targets, Iterable, "a sequence of targets")
    tasks = [check_targets(arm, target) for target in targets]
    if not tasks:
        raise InputError("targets", targets, "at least one task")
    for i, task in enumerate(tasks):
        if Together(arm, task).terms.names[1]:
            raise InputError(f"targets[{i}]", task, "targets that can be met exactly")
    return tasks


class _Search:
    """Local optimisations of one design, by the values that they begin with."""

    def __init__(self, program: DesignProgram, starts: int | None) -> None:
        self.program, self.starts = program, starts
        self._tried: dict[bytes, DesignOptimum | None] = {}

    @property
    def optima(self) -> list[DesignOptimum]:
        """Those that were found."""
        return [optimum for optimum in self._tried.values() if optimum is not None]

    @property
    def best(self) -> DesignOptimum:
        """The best of them."""
        return min(self.optima, key=lambda optimum: optimum.cost)

    def plans(
        self, arm: Arm, scene: Scene, certify: bool = False, end: float | None = None
    ) -> tuple[Plan, ...]:
        """Return the plans of all tasks, each by itself the best for the objective.

        `end` is the time of `time.monotonic` until which they share the time that is left.
        """
        most, plans = self.program.limits.upper, list[Plan]()
        for task in track("tasks planned", self.program.planned):
            limit = None
            if end is not None:
                share = (end - time.monotonic()) / (len(self.program.planned) - len(plans))
                limit = max(share, GRACE)
            more: dict[str, Any] = {"certify": certify, "time_limit": limit}
            plans.append(plan(arm, task, scene, most, starts=self.starts, **more))
        return tuple(plans)

    def run(self, before: Sequence[Plan], begins: int, seed: int) -> None:
        """Begin with the given arm and its plans, others, and the best ones at their other ends."""
        parameters = self.program.parameters
        first, *others = parameters.multistart(begins, seed)
        self._tried[first.tobytes()] = self.program.solve(first, _tensions(before))
        for i, values in enumerate(others, 1):
            report("arms begun with", i, begins)
            self._begin(values)
        while left := [end for end in self._other_ends() if end.tobytes() not in self._tried]:
            report("arms at other bounds")
            self._begin(left[0])

    def _begin(self, values: Array) -> None:
        """Add the optimum that values lead to; none from an arm that cannot be."""
        self._tried[values.tobytes()] = None
        with suppress(OctoplanError):
            _, arm, scene = self.program.parameters.setting(values)
            if self.program.making.room(arm).min() >= 0:
                optimum = self.program.solve(values, _tensions(self.plans(arm, scene)))
                self._tried[values.tobytes()] = optimum

    def _other_ends(self) -> list[Array]:
        """Return the best values with each unknown that is at a bound at the other one."""
        parameters = self.program.parameters
        fractions, ends = parameters.fractions(self.best.values), list[Array]()
        for k in np.flatnonzero(parameters.at_bounds(self.best.values)):
            other = np.round(fractions, 6)
            other[k] = 1.0 - np.round(other[k])
            ends.append(parameters.from_fractions(other))
        return ends


def _tensions(plans: Sequence[Plan]) -> Array:
    return np.array([np.ravel(plan.tensions) for plan in plans])
