"""Designed arm: its plans, the values of the objective, and remedies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from octoplan.model import Arm, InputError, Scene, settle
from octoplan.model.paths import Array
from octoplan.model.stiffness import stiffness
from octoplan.model.support.errors import Described
from octoplan.model.support.text import TextRepr, counted
from octoplan.planner.extensions.fit.design_program import DesignProgram
from octoplan.planner.extensions.fit.manufacturing import ManufacturingLimits, Objective, Reach
from octoplan.planner.extensions.fit.unknowns import AT_BOUND, WORSE, Parameters, Unknown
from octoplan.planner.plan_result import Plan
from octoplan.planner.targets import Softest, Stiffest


@dataclass(frozen=True, repr=False)
class Design(TextRepr):
    """A designed arm; see octoplan.planner.extensions.fit.design_program for the optimisation.

    Attributes
    ----------
    given_arm, scene
        The arm before the design, and the scene.
    unknowns : tuple of Unknown
    values : tuple of float
        Chosen values of the unknowns, in the units of their keys.
    arm : Arm
        The designed arm.
    plans, before : tuple of Plan
        Plans of the tasks for the designed arm, and for the given arm.
    value, value_before : float
        Objective of the designed and of the given arm: effort [N], mean stiffness of the tip [N/m],
        or reach [m].
    manufacturing : ManufacturingLimits
        Limits of the arms that can be manufactured.
    objective : "effort", Stiffest, Softest or Reach
    reaches : (before, now) or None
        Tensions (n_tendons,) of the farthest reach, of the given arm and the designed one.
    optima : tuple of float
        Objectives of all local optima that violate the constraints as little as the best one.
    stopped : bool
        Whether the time limit came before all optimisations had run.
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
    manufacturing: ManufacturingLimits = field(default_factory=ManufacturingLimits)
    objective: Objective = "effort"
    reaches: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    optima: tuple[float, ...] = ()
    stopped: bool = False

    @property
    def parameters(self) -> Parameters:
        """The unknowns, with the arm and the scene that contain them."""
        return Parameters.of(self.given_arm, self.scene, self.unknowns)

    @property
    def array(self) -> Array:
        """The values (K,)."""
        return np.array(self.values)

    @property
    def feasible(self) -> bool:
        """Whether the designed arm meets every task, according to the plans' certificates."""
        return _all_met(self.plans)

    @property
    def effort(self) -> float:
        """Root of the sum of the squared efforts of all tasks [N]."""
        return _root_sum_square(self.plans)

    @property
    def gain(self) -> float:
        """Relative decrease of the effort, or relative increase of the stiffness or the reach.

        NaN unless both arms meet all tasks.
        """
        if not (self.feasible and _all_met(self.before)):
            return float("nan")
        grown = self.value / self.value_before - 1
        return -grown if self.objective == "effort" else grown

    @property
    def sensitivity(self) -> Array:
        """Derivatives of the effort with respect to the unknowns (K,) [N per unit].

        The tensions are optimal for each value. The derivative of an unknown at a bound is the
        price of the bound. Raises InputError unless the objective is the effort and all tasks are
        met.
        """
        if self.objective != "effort":
            raise InputError("design", self.objective, "a design for the least effort")
        if not self.feasible:
            raise InputError(
                "design", Described("a design that misses tasks"), "a design that meets all tasks"
            )
        tasks = [plan.targets for plan in self.plans]
        limits = self.plans[0].problem.limits
        program = DesignProgram(self.parameters, tasks, limits, self.manufacturing)
        T = np.array([np.ravel(plan.tensions) for plan in self.plans])
        return program.sensitivity(self.array, T) / self.effort

    @property
    def outcome(self) -> str:
        """Result of the design; for tasks that are not met, the active limits."""
        lines = [self._comparison()]
        for i, each in enumerate(self.plans):
            if not each.certificate.passed:
                T = np.ravel(each.tensions)
                upper = np.array(each.problem.limits.upper)
                at_limit = np.flatnonzero(upper * (1 - AT_BOUND) <= T)
                names = ", ".join(each.arm.tendon_name(int(j)) for j in at_limit)
                held = f" At the tension limit: {names}." if names else ""
                lines.append(f"Task {i} is not met: {each.outcome}{held}")
        limits = self.manufacturing.binding(self.arm)
        if limits:
            lines.append(f"At a limit of what can be made: {', '.join(limits)}.")
        if ends := self.parameters.names_at_bounds(self.array):
            lines.append(f"At a bound: {', '.join(ends)}.")
        others = [x for x in self.optima if x > min(self.optima) + WORSE * abs(min(self.optima))]
        if others:
            count = f"{len(others)} of {counted(len(self.optima), 'initial arm')}"
            lines.append(
                f"{count} ended in worse optima; raise n_starts to search for better ones."
            )
        if self.stopped:
            lines.append("Stopped at the time limit: not all initial arms were optimised.")
        return " ".join(lines)

    def _comparison(self) -> str:
        tasks = f"{counted(len(self.plans), 'task')}, {counted(len(self.unknowns), 'unknown')}"
        if not self.feasible:
            return f"{tasks}: no arm within the bounds was found that meets all of them."
        name, unit = _WORDS[type(self.objective)]
        now = f"{name} {self.value:.4g} {unit}"
        if not np.isfinite(self.gain):
            return f"{tasks}: {now}; the given arm does not meet all of them."
        before = f"the given arm's {self.value_before:.4g} {unit}"
        compared = "less" if self.value < self.value_before else "more"
        return f"{tasks}: {now}, {100 * abs(self.gain):.3g} % {compared} than {before}."


# Name and unit of the objective in the outcome.
_WORDS: dict[type, tuple[str, str]] = {
    str: ("effort", "N"),
    Stiffest: ("stiffness of the tip", "N/m"),
    Softest: ("stiffness of the tip", "N/m"),
    Reach: ("reach", "m"),
}


def objective_value(
    objective: Objective, scene: Scene, arm: Arm, plans: Sequence[Plan], T: Sequence[float] | None
) -> float:
    """Return the objective of an arm with its plans; of a reach, with its tensions T."""
    if objective == "effort":
        return _root_sum_square(plans)
    along = np.array(objective.direction)
    if T is not None:
        return float(settle(arm, T, scene).tip @ along)
    compliances = [stiffness(arm, plan.tensions, scene).compliance[:3, :3] for plan in plans]
    return float(np.exp(-np.mean([np.log(along @ C @ along) for C in compliances])))


def _all_met(plans: Sequence[Plan]) -> bool:
    return all(plan.certificate.passed for plan in plans)


def _root_sum_square(plans: Sequence[Plan]) -> float:
    return float(np.linalg.norm([plan.effort for plan in plans]))
