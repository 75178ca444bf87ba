"""Design an arm for its tasks: choose parameters of the arm that minimise the tasks' effort."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from octoplan.model import Arm, InputError, Scene
from octoplan.model.paths import Array
from octoplan.model.support.checks import kind, whole
from octoplan.model.support.errors import Described, OctoplanError
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
from octoplan.planner.extensions.fit.designed import Design, objective_value
from octoplan.planner.extensions.fit.manufacturing import (
    ManufacturingLimits,
    Objective,
    Reach,
    checked_objective,
)
from octoplan.planner.extensions.fit.unknowns import Parameters, Unknown
from octoplan.planner.limits import TendonLimits
from octoplan.planner.plan import plan
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import check_targets
from octoplan.planner.targets.target_set import TargetSet


@with_progress
def design(
    arm: Arm,
    targets: Iterable[Any],
    unknowns: Iterable[Unknown],
    scene: Scene | None = None,
    tension_max: Any = np.inf,
    *,
    manufacturing: ManufacturingLimits | None = None,
    objective: Objective = "effort",
    n_starts: int = 3,
    starts: int | None = None,
    seed: int = 0,
    time_limit: float | None = None,
    progress: bool | None = None,
) -> Design:
    """Return the arm that minimises the total effort of several tasks, or another objective.

    Local optimisations start at the given arm and at other arms within the bounds, each with the
    plans of its tasks. If an unknown ends at a bound, another optimisation starts at its other
    bound. All tasks are then planned anew for the best arm, and the plans are certified.

    Parameters
    ----------
    arm, scene : Arm, Scene
        The given arm, and the scene of all tasks; bending only unless given.
    targets : sequence of targets
        One entry per task: a target, or several targets of one shape.
    unknowns : sequence of Unknown
        Parameters of the arm to choose.
    tension_max : float, or one for each tendon
        Upper limits of the tensions [N].
    manufacturing : ManufacturingLimits
        Limits of the arms that can be manufactured.
    objective : "effort", Stiffest, Softest or Reach
        Objective, subject to all tasks: the root of the sum of squared efforts; the stiffness of
        the tip along a direction with tensions held, as geometric mean over the tasks; or the
        reach of the tip along a direction, with tensions of its own, which requires finite limits.
    n_starts : int
        Number of initial arms: the given arm, then arms that are spread evenly over the bounds.
    starts : int
        Number of initial guesses of each plan; see plan.
    seed : int
        Random seed of the other initial arms.
    time_limit : float
        Limit of the whole call [s]. The search for the best arm ends earlier by the time that the
        plans of the given arm took, so that the plans of the best arm are computed and certified
        within the limit; each of these has at least GRACE, 1 s. The outcome reports a search that
        the limit ended.
    progress : bool
        Whether to show progress. By default, progress is shown after two seconds on terminals and
        in notebooks.

    Raises
    ------
    InputError
        If targets or unknowns are unsuitable, if targets cannot be met exactly, if the given arm
        violates the manufacturing limits, and for scenes as printed or with contact.
    TimeLimitError
        If the time limit is reached before the first arm's optimum.
    """
    n_starts = whole("n_starts", n_starts, 1, 1000)
    parameters = _checked(arm, supported_scene(arm, scene), unknowns)
    if manufacturing is None:
        manufacturing = ManufacturingLimits()
    manufacturing = kind("manufacturing", manufacturing, ManufacturingLimits)
    limits = TendonLimits.of(arm, tension_max)
    manufacturing.check(arm)
    objective = checked_objective(objective, limits)
    program = DesignProgram(parameters, _tasks(arm, targets), limits, manufacturing, objective)
    search = _Search(program, starts)
    stopped = False
    with limited(time_limit, reserves=True):
        try:
            started = time.monotonic()
            before = search.plans(arm, parameters.given.scene, certify=True)
            reserve(time.monotonic() - started)
            search.run(before, n_starts, seed)
        except OutOfTime:
            if not search.optima:
                raise
            stopped = True
        reserve(0.0)
        end = None if time_limit is None else time.monotonic() + seconds_left()
    best = search.best
    reaches = None
    if isinstance(objective, Reach):
        given = program.solve(parameters.start, _tensions(before), fixed=True)
        reaches = tuple(given.tensions[-1].tolist()), tuple(best.tensions[-1].tolist())
    _, designed, scene = parameters.setting(best.values)
    plans = search.plans(designed, scene, certify=True, end=end)
    reach_before, reach = reaches or (None, None)
    return Design(
        given_arm=arm,
        scene=scene,
        unknowns=parameters.unknowns,
        values=tuple(best.values.tolist()),
        arm=designed,
        plans=plans,
        before=before,
        value=objective_value(objective, scene, designed, plans, reach),
        value_before=objective_value(objective, scene, arm, before, reach_before),
        manufacturing=manufacturing,
        objective=objective,
        reaches=reaches,
        optima=tuple(
            optimum.objective for optimum in search.optima if optimum.cost[0] == best.cost[0]
        ),
        stopped=stopped,
    )


def _checked(arm: Arm, scene: Scene, unknowns: Iterable[Unknown]) -> Parameters:
    """Return the unknowns of a design, or raise InputError."""
    parameters = Parameters.of(arm, scene, unknowns)
    for unknown in parameters.unknowns:
        if unknown.prior or unknown.session is not None:
            given = Described("an unknown with prior or session")
            raise InputError(unknown.name, given, "without both in a design")
        if not all(k.startswith("arm.") and not k.startswith("arm.base") for k in unknown.keys):
            raise InputError("key", unknown.name, "a number of the arm, except its base")
    return parameters


def _tasks(arm: Arm, targets: Iterable[Any]) -> list[Targets]:
    """Return the targets of each task, or raise InputError if a target cannot be met exactly."""
    kind("targets", targets, Iterable, "a sequence of targets")
    tasks = [check_targets(arm, target) for target in targets]
    if not tasks:
        raise InputError("targets", targets, "at least one task")
    for i, task in enumerate(tasks):
        if TargetSet(arm, task).terms.names[1]:
            raise InputError(f"targets[{i}]", task, "targets that can be met exactly")
    return tasks


class _Search:
    """Local optimisations of a design, by initial values."""

    def __init__(self, program: DesignProgram, starts: int | None) -> None:
        self.program = program
        self.starts = starts
        self._tried: dict[bytes, DesignOptimum | None] = {}

    @property
    def optima(self) -> list[DesignOptimum]:
        """All local optima that were found."""
        return [optimum for optimum in self._tried.values() if optimum is not None]

    @property
    def best(self) -> DesignOptimum:
        """The best local optimum."""
        return min(self.optima, key=lambda optimum: optimum.cost)

    def plans(
        self, arm: Arm, scene: Scene, certify: bool = False, end: float | None = None
    ) -> tuple[Plan, ...]:
        """Plan each task of an arm separately.

        `end` is the time of `time.monotonic` until which the tasks share the remaining time.
        """
        upper = self.program.limits.upper
        plans = list[Plan]()
        for task in track("tasks planned", self.program.planned):
            limit = None
            if end is not None:
                share = (end - time.monotonic()) / (len(self.program.planned) - len(plans))
                limit = max(share, GRACE)
            plans.append(
                plan(arm, task, scene, upper, starts=self.starts, certify=certify, time_limit=limit)
            )
        return tuple(plans)

    def run(self, before: Sequence[Plan], n_starts: int, seed: int) -> None:
        """Optimise from the given arm, from other arms, and from the best arm at other bounds."""
        parameters = self.program.parameters
        first, *others = parameters.multistart(n_starts, seed)
        self._tried[first.tobytes()] = self.program.solve(first, _tensions(before))
        for i, values in enumerate(others, 1):
            report("initial arms", i, n_starts)
            self._optimise_from(values)
        while untried := [
            values for values in self._at_other_bounds() if values.tobytes() not in self._tried
        ]:
            report("arms at other bounds")
            self._optimise_from(untried[0])

    def _optimise_from(self, values: Array) -> None:
        """Add the local optimum reached from initial values; skip values of an invalid arm."""
        self._tried[values.tobytes()] = None
        with suppress(OctoplanError):
            _, arm, scene = self.program.parameters.setting(values)
            if self.program.manufacturing.margins(arm).min() >= 0:
                optimum = self.program.solve(values, _tensions(self.plans(arm, scene)))
                self._tried[values.tobytes()] = optimum

    def _at_other_bounds(self) -> list[Array]:
        """Return the best values with each unknown that is at a bound moved to its other bound."""
        parameters = self.program.parameters
        fractions = parameters.fractions(self.best.values)
        ends = list[Array]()
        for k in np.flatnonzero(parameters.at_bounds(self.best.values)):
            other = np.round(fractions, 6)
            other[k] = 1.0 - np.round(other[k])
            ends.append(parameters.from_fractions(other))
        return ends


def _tensions(plans: Sequence[Plan]) -> Array:
    return np.array([np.ravel(plan.tensions) for plan in plans])
