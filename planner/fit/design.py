"""Design an arm for its tasks: the numbers of the arm that make their plans cheapest together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from model import Arm, InputError, Scene, settle
from model.errors import OctoplanError, TimeLimitError
from model.paths import Array
from model.progress import reported, tell, with_progress
from model.stiffness import stiffness
from model.text import Shown, counted
from model.time_limit import OutOfTime
from model.time_limit import time_limit as within
from planner.fit.calibrate import supported_scene
from planner.fit.design_program import DesignOptimum, DesignProgram, Targets
from planner.fit.making import Making, Objective, Reach, checked_objective
from planner.fit.unknowns import AT_BOUND, WORSE, Parameters, Unknown
from planner.plan import Plan, plan
from planner.program.limits import Limits
from planner.program.terms import terms_of
from planner.question import check_targets
from planner.targets import Softest, Stiffest


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
        For targets and unknowns that do not fit, for targets that cannot be met exactly, for an arm
        to begin with that cannot be made, and for scenes as printed or with contact.
    TimeLimitError
        If the time limit is reached before the first arm's optimum.
    """
    if not (isinstance(begins, int) and 1 <= begins <= 1000):
        raise InputError("begins", begins, "a whole number from 1 to 1000")
    parameters = _checked(arm, supported_scene(arm, scene), unknowns)
    making, limits = making or Making(), Limits.of(arm, tension_max)
    making.check(arm)
    objective = checked_objective(objective, limits)
    program = DesignProgram(parameters, _tasks(arm, targets), limits, making, objective)
    search, stopped = _Search(program, starts), False
    try:
        with within(time_limit):
            before = search.plans(arm, parameters.scene)
            search.run(before, begins, seed)
    except OutOfTime:
        if not search.optima:
            raise TimeLimitError(time_limit or 0.0) from None
        stopped = True
    best, reaches = search.best, None
    if isinstance(objective, Reach):
        at_first = program.solve(parameters.start, _tensions(before), fixed=True)
        reaches = tuple(at_first.tensions[-1].tolist()), tuple(best.tensions[-1].tolist())
    designed, scene = parameters.built(best.values)
    plans = search.plans(designed, scene)
    worth = zip((arm, designed), (before, plans), reaches or (None, None), strict=True)
    value_before, value = (_value(objective, scene, *each) for each in worth)
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
    tasks = [check_targets(arm, target) for target in targets]
    if not tasks:
        raise InputError("targets", targets, "at least one task")
    for i, task in enumerate(tasks):
        if terms_of(arm, task).names[1]:
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

    def plans(self, arm: Arm, scene: Scene) -> tuple[Plan, ...]:
        """Return the plans of all tasks, each by itself the best for the objective."""
        most = self.program.limits.upper
        return tuple(
            plan(arm, task, scene, most, starts=self.starts)
            for task in reported("tasks planned", self.program.planned)
        )

    def run(self, before: Sequence[Plan], begins: int, seed: int) -> None:
        """Begin with the given arm and its plans, others, and the best ones at their other ends."""
        parameters = self.program.parameters
        first, *others = parameters.multistart(begins, seed)
        self._tried[first.tobytes()] = self.program.solve(first, _tensions(before))
        for i, values in enumerate(others, 1):
            tell("arms begun with", i, begins)
            self._begin(values)
        while left := [end for end in self._other_ends() if end.tobytes() not in self._tried]:
            tell("arms at other bounds")
            self._begin(left[0])

    def _begin(self, values: Array) -> None:
        """Add the optimum that values lead to; none from an arm that cannot be."""
        self._tried[values.tobytes()] = None
        with suppress(OctoplanError):
            arm, scene = self.program.parameters.built(values)
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


@dataclass(frozen=True)
class Design(Shown):
    """A designed arm; see planner.fit.design_program for what it is best at.

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
    value, value_before : float
        What was made best: effort [N], mean stiffness of the tip [N/m], or reach [m]; the same of
        the given arm.
    making : Making
        What can be made.
    objective : "effort", Stiffest, Softest or Reach
    reaches : (before, now) or None
        Tensions (n_tendons,) that reach farthest, of the given arm and the designed one.
    optima : tuple of float
        What is least at the optima that arms begun with came to, if they meet as much as this one.
    stopped : bool
        Whether the time limit came before all of them were begun with.
    """

    given_arm: Arm
    scene: Scene
    unknowns: tuple[Unknown, ...]
    values: tuple[float, ...]
    arm: Arm
    plans: tuple[Plan, ...] = field(compare=False)
    before: tuple[Plan, ...] = field(compare=False)
    value: float
    value_before: float
    making: Making = field(default_factory=Making)
    objective: Objective = "effort"
    reaches: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    optima: tuple[float, ...] = ()
    stopped: bool = False

    @property
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
        """The share of the given arm's effort that is saved, or by which stiffness or reach grow.

        NaN unless both meet all tasks.
        """
        if not (self.feasible and _met(self.before)):
            return float("nan")
        grown = self.value / self.value_before - 1
        return -grown if self.objective == "effort" else grown

    @property
    def sensitivity(self) -> Array:
        """How the effort changes with the unknowns (K,) [N per unit], tensions chosen anew.

        At a bound it says what the bound costs. Raises InputError unless all tasks are met, and
        unless effort was made least.
        """
        if self.objective != "effort":
            raise InputError("design", self.objective, "a design for the least effort")
        if not self.feasible:
            raise InputError("design", "tasks that are not met", "a design that meets all tasks")
        tasks, limits = [plan.targets for plan in self.plans], self.plans[0].limits
        program = DesignProgram(self.parameters, tasks, limits, self.making)
        T = np.array([np.ravel(plan.tensions) for plan in self.plans])
        return program.sensitivity(self.array, T) / self.effort

    @property
    def outcome(self) -> str:
        """What was found, and where that is not enough which task and which limit hold it."""
        lines = [self._told()]
        for i, each in enumerate(self.plans):
            if not each.certificate.passed:
                T, upper = np.ravel(each.tensions), np.array(each.limits.upper)
                at = np.flatnonzero(upper * (1 - AT_BOUND) <= T)
                names = ", ".join(each.arm.tendon_name(int(j)) for j in at)
                held = f" At the tension limit: {names}." if names else ""
                lines.append(f"Task {i} is not met: {each.outcome}{held}")
        limits = self.making.binding(self.arm)
        if limits:
            lines.append(f"At a limit of what can be made: {', '.join(limits)}.")
        if ends := self.parameters.names_at_bounds(self.array):
            lines.append(f"At a bound: {', '.join(ends)}.")
        others = [x for x in self.optima if x > min(self.optima) + WORSE * abs(min(self.optima))]
        if others:
            count = f"{len(others)} of {counted(len(self.optima), 'arm')} begun with"
            lines.append(
                f"{count} came to worse optima: there may be better ones; begin with more."
            )
        if self.stopped:
            lines.append("Stopped at the time limit: not all arms were begun with.")
        return " ".join(lines)

    def _told(self) -> str:
        tasks = f"{counted(len(self.plans), 'task')}, {counted(len(self.unknowns), 'unknown')}"
        if not self.feasible:
            return f"{tasks}: no arm within the bounds was found that meets all of them."
        said, unit = _WORDS[type(self.objective)]
        now = f"{said} {self.value:.4g} {unit}"
        if not np.isfinite(self.gain):
            return f"{tasks}: {now}; the given arm does not meet all of them."
        before = f"the given arm's {self.value_before:.4g} {unit}"
        compared = "less" if self.value < self.value_before else "more"
        return f"{tasks}: {now}, {100 * abs(self.gain):.3g} % {compared} than {before}."


_WORDS: dict[type, tuple[str, str]] = {
    str: ("effort", "N"),
    Stiffest: ("stiffness of the tip", "N/m"),
    Softest: ("stiffness of the tip", "N/m"),
    Reach: ("reach", "m"),
}


def _value(
    objective: Objective, scene: Scene, arm: Arm, plans: Sequence[Plan], T: Sequence[float] | None
) -> float:
    """Return what a design makes best, of an arm with its plans, or tensions T that reach far."""
    if objective == "effort":
        return _total(plans)
    along = np.array(objective.direction)
    if T is not None:
        return float(settle(arm, T, scene).tip @ along)
    compliances = [stiffness(arm, plan.tensions, scene).compliance[:3, :3] for plan in plans]
    return float(np.exp(-np.mean([np.log(along @ C @ along) for C in compliances])))


def _met(plans: Sequence[Plan]) -> bool:
    return all(plan.certificate.passed for plan in plans)


def _total(plans: Sequence[Plan]) -> float:
    return float(np.linalg.norm([plan.effort for plan in plans]))
