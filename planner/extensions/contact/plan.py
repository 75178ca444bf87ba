"""Plans of arms in contact."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from octoplan.model.extensions.contact.effects import without_contacts
from octoplan.model.paths import Array
from octoplan.model.shape import Shape
from octoplan.planner.block import ACTIVE
from octoplan.planner.certificate import Optimality
from octoplan.planner.extensions.contact.grasp import Grip, grips_of
from octoplan.planner.extensions.contact.hold import Hold
from octoplan.planner.extensions.contact.load_path import settled_along
from octoplan.planner.extensions.contact.search import optimality_of
from octoplan.planner.linearised_blocks import STABILITY, active_margin
from octoplan.planner.plan_result import Plan
from octoplan.planner.program_instance import ProgramInstance


@dataclass(frozen=True, eq=False, repr=False)
class ContactPlan(Plan):
    """The plan of an arm in contact.

    The arm comes to its shape along the load path of the solution; `shape.snaps` reports whether
    the arm snaps on the last part of the path. If the problem has an environment, the arm keeps
    clear of the bodies that it may lean on, and the plan is optimal among such plans.
    """

    def _settle(self) -> Shape:
        """Return the shape at the end of the load path."""
        problem, solution = self.problem, self.solution
        accuracy = max(problem.accuracy / 10, 1e-12)
        path, T = solution.load_path, np.ravel(solution.tensions)
        return settled_along(problem.arm, path, T, problem.scene, accuracy, problem.machine_code)

    @cached_property
    def grips(self) -> tuple[Grip, ...]:
        """The forces on the held objects, by target and from base to tip."""
        holds = [target for target in self.targets if isinstance(target, Hold)]
        return tuple(grip for hold in holds for grip in grips_of(self.shape, hold))

    @cached_property
    def beside(self) -> Plan | None:
        """The same plan in the scene without contacts, if the arm keeps clear of the bodies."""
        if not self.problem.environment:
            return None
        free = replace(self.problem, scene=without_contacts(self.scene))
        return Plan.of(free, replace(self.solution, optimum=vars(self).get("optimum")))

    def _compose_outcome(self) -> str:
        text = super()._compose_outcome()
        leans = "It keeps clear of what it may lean on; leaning was not tried."
        return f"{text} {leans}" if self.beside and self.reached else text

    def program(self) -> ProgramInstance:
        """See Plan.program: without contacts, if the arm keeps clear of the bodies."""
        return self.beside.program() if self.beside else super().program()

    def multiplier_counts(self) -> tuple[int, int]:
        """See Plan.multiplier_counts: an arm that leans has any number of rows."""
        if self.beside:
            return super().multiplier_counts()
        return self.arm.n_tendons, len(self.solution.lam_g)

    def multipliers(self, kind: str) -> Array:
        """See Plan.multipliers: an arm that leans has the multiplier of stability alone."""
        if self.beside:
            return super().multipliers(kind)
        solution = self.solution
        has_mode = kind == STABILITY and solution.options.modes
        return np.array(solution.lam_g[-1:] if has_mode else ())

    def active_rows(self) -> list[tuple[float, str]]:
        """See Plan.active_rows: an arm that leans has no rows but the stability margin."""
        if self.beside:
            return super().active_rows()
        is_active = self.multipliers(STABILITY).min(initial=0.0) < -ACTIVE
        bound = self.problem.options.stability_bound
        return [(np.inf, active_margin(bound))] if is_active else []

    def _optimality(self) -> Optimality:
        if self.beside:
            return self.beside._optimality()
        T, path = np.ravel(self.tensions), self.solution.load_path
        return optimality_of(self.problem, T, self.shape, path)

    def _obstacle_keywords(self) -> dict[str, Any]:
        return {}
