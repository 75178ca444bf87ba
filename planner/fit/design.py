"""Design an arm for its tasks: the numbers of the arm that make their plans cheapest together."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from model import Arm, InputError, Scene
from model.errors import OctoplanError, TimeLimitError
from model.paths import Array
from model.progress import tell, told, with_progress
from model.time_limit import OutOfTime, time_limit
from planner.fit.calibrate import supported_scene
from planner.fit.design_program import Optimum, Program, Targets
from planner.fit.designed import Design
from planner.fit.making import Making, Objective, Reach, checked_objective
from planner.fit.unknowns import Parameters, Unknown
from planner.plan import Plan, plan
from planner.program.limits import Limits
from planner.program.terms import compliance_requests, term_names
from planner.question import check_targets
from planner.targets import Softest, Stiffest

# What the given arm may lack of what can be made [mm]; how near a bound an unknown is at it.
_LACK, _AT_BOUND = 1e-6, 1e-6


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
        After how long no further arm is begun with [s]; the outcome says so. The plans of the best
        arm found are still made.
    progress : bool
        Whether a line tells how far it is: unless given, after two seconds, on terminals and in
        notebooks.

    Raises
    ------
    InputError
        For targets and unknowns that do not fit, for targets that cannot be met exactly, or that
        ask for a stiffness, whose derivative by numbers of the arm is not known, for an arm to
        begin with that cannot be made, and for scenes as printed or with contact.
    TimeLimitError
        If the time limit is reached before the first arm's optimum.
    """
    scene = supported_scene(arm, scene)
    if not (isinstance(begins, int) and 1 <= begins <= 1000):
        raise InputError("begins", begins, "a whole number from 1 to 1000")
    objective = checked_objective(objective)
    tasks = _checked(arm, targets)
    parameters = Parameters.of(arm, scene, unknowns)
    for unknown in parameters.unknowns:
        if not all(k.startswith("arm.") and not k.startswith("arm.base") for k in unknown.keys):
            raise InputError("key", unknown.name, "numbers of the arm but for its base")
    making, limits = making or Making(), Limits.of(arm, tension_max)
    lacking = -1e3 * float(making.room(arm).min()) * arm.length
    if lacking > _LACK:
        allowed = f"a limit that the given arm keeps: it misses it by {lacking:.3g} mm"
        raise InputError("making", making, allowed)
    if isinstance(objective, Reach) and not np.all(np.isfinite(limits.upper)):
        raise InputError("tension_max", tension_max, "finite tensions where a reach is asked for")
    return _Search(parameters, scene, tasks, limits, making, objective, starts).run(
        arm, begins, seed, time_limit
    )


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


@dataclass
class _Search:
    """Local optimisations of one design."""

    parameters: Parameters
    scene: Scene
    tasks: list[Targets]
    limits: Limits
    making: Making
    objective: Objective
    starts: int | None
    optima: list[Optimum] = field(default_factory=list)

    def run(self, arm: Arm, begins: int, seed: int, seconds: float | None) -> Design:
        """Return the design of the best optimum that the given arm and others lead to."""
        stopped = False
        try:
            with time_limit(seconds):
                before = self._plans(arm)
                self._begin(self.parameters.start, before)
                spread = self.parameters.multistart(begins, seed)
                for i, values in enumerate(spread[1:], 1):
                    tell("arms begun with", i, begins)
                    self._begin(values)
                for values in self._other_ends(self._best.values):
                    tell("arms at other bounds")
                    self._begin(values)
        except OutOfTime:
            if not self.optima:
                raise TimeLimitError(seconds or 0.0) from None
            stopped = True
        best = self._best
        designed = self.parameters.built(best.values)[0]
        reaches = None
        if isinstance(self.objective, Reach):
            at_first = self._program(self.parameters.start, before).solve(fixed=True)
            reaches = tuple(tuple(own.tensions[-1].tolist()) for own in (at_first, best))
        return Design(
            arm,
            self.scene,
            self.parameters.unknowns,
            tuple(best.values.tolist()),
            designed,
            self._plans(designed),
            before,
            best.steps,
            self.making,
            self.objective,
            reaches,  # type: ignore[arg-type]
            tuple(own.objective for own in self.optima if own.cost[0] == best.cost[0]),
            stopped,
        )

    @property
    def _best(self) -> Optimum:
        return min(self.optima, key=lambda own: own.cost)

    def _plans(self, arm: Arm) -> tuple[Plan, ...]:
        """Return the plans of all tasks, each by itself the best for the objective."""
        more = (self.objective,) if isinstance(self.objective, Stiffest | Softest) else ()
        return tuple(
            plan(arm, (*task, *more), self.scene, self.limits.upper, starts=self.starts)
            for task in told("tasks planned", self.tasks)
        )

    def _program(self, values: Array, plans: tuple[Plan, ...]) -> Program:
        """Return the program that begins at values and the plans of that arm."""
        T, tasks = [np.ravel(own.tensions) for own in plans], list(self.tasks)
        if isinstance(self.objective, Reach):
            T, tasks = [*T, T[0]], [*tasks, ()]
        given = self.limits, self.making, values, np.array(T), self.objective
        return Program(self.parameters, tasks, *given)

    def _begin(self, values: Array, plans: tuple[Plan, ...] | None = None) -> None:
        """Add the optimum that values lead to; none from another arm that cannot be."""
        try:
            if plans is None:
                arm = self.parameters.built(values)[0]
                if self.making.room(arm).min() < 0:
                    return
                plans = self._plans(arm)
            self.optima.append(self._program(values, plans).solve())
        except OctoplanError:
            if not self.optima:
                raise

    def _other_ends(self, values: Array) -> list[Array]:
        """Return values with each unknown that is at a bound at the other one."""
        shares, ends = self.parameters.shares(values), list[Array]()
        for k in np.flatnonzero(np.minimum(shares, 1 - shares) < _AT_BOUND):
            other = shares.copy()
            other[k] = 1.0 - np.round(shares[k])
            ends.append(self.parameters.from_shares(other))
        return ends
