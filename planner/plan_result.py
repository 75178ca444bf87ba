"""Plans: a problem and its solution, with shape, certificate and outcome."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.shape import Shape
from octoplan.model.support.checks import not_negative, positive
from octoplan.model.support.errors import OctoplanError, UncertifiedError
from octoplan.model.support.progress import OUT_OF_TIME, OutOfTime, report, with_progress
from octoplan.model.support.progress import time_limit as limited_to
from octoplan.model.support.text import TextRepr, plotted
from octoplan.model.tendons import strokes
from octoplan.planner.certificate import Certificate, Optimality, certify
from octoplan.planner.entry_points import MIRROR_IMAGES, PLAN, SAVE_PLAN, load
from octoplan.planner.outcome import holding, outcome, remarks
from octoplan.planner.planning_problem import Mode, PlanningProblem, effort
from octoplan.planner.program_instance import ProgramInstance
from octoplan.planner.solution import NlpSolution, Solution
from octoplan.planner.solve.refine import on_mesh
from octoplan.planner.targets.base import Target


@dataclass(frozen=True, eq=False, repr=False)
class Plan(TextRepr):
    """Tensions for a target, with shape, certificate and outcome.

    `plan` computes shape, certificate and outcome before it returns. Other plans, such as copies
    with another problem or solution (dataclasses.replace), compute each at its first reading.

    Attributes
    ----------
    problem : PlanningProblem
        The arm, the scene, the targets and the limits, with the options of the last program.
    solution : Solution
        The optimum: tensions, multipliers, results of the initial guesses.
    """

    problem: PlanningProblem
    solution: Solution

    @classmethod
    def of(cls, problem: PlanningProblem, solution: Solution, **more: Any) -> Self:
        """Return the plan of a problem from the result of a search; `more` are further fields."""
        asked = replace(problem.at_base(()), options=solution.options)
        plan = cls(asked, replace(solution, optimum=None), **more)
        if solution.optimum is not None:
            vars(plan)["optimum"] = solution.optimum
        return plan

    @cached_property
    def placed(self) -> PlanningProblem:
        """The problem with the base at the joint values of the solution."""
        return self.problem.at_base(self.solution.base)

    @property
    def base(self) -> Any:
        """The joint values of the base: `insertion` [m], `rotation` [rad]; None if it is fixed."""
        placement = self.placed.placement
        return None if placement is None else placement.position

    @property
    def arm(self) -> Arm:
        """The arm as given. The arm of `shape` has its base at the joint values."""
        return self.problem.arm

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.problem.scene

    @property
    def targets(self) -> tuple[Target, ...]:
        """The targets."""
        return self.problem.targets

    @property
    def tensions(self) -> Array:
        """The tensions by section (n_sections, n) or, if sections differ, (n_tendons,) [N]."""
        return self.solution.tensions

    @property
    def mode(self) -> Mode:
        """The treatment of the targets by the last program: "exact", "closest" or "nearest"."""
        return self.solution.options.mode

    @property
    def effort(self) -> float:
        """The norm of the tensions, which the program minimises [N]."""
        return float(effort(np.ravel(self.tensions), self.solution.options.norm))

    # Shape, certificate and outcome

    @property
    def shape(self) -> Shape:
        """The shape under the tensions, settled to a hundredth of the accuracy.

        Raises the errors of settle, and UncertifiedError if the time limit was reached before.
        """
        found = self._shape_or_error
        if isinstance(found, OctoplanError):
            raise found.with_traceback(None)
        return found

    @cached_property
    def _shape_or_error(self) -> Shape | OctoplanError:
        """The shape, or the error of settle: settling an arm that yields takes long."""
        try:
            return self._settle()
        except OctoplanError as reason:
            return reason

    def _settle(self) -> Shape:
        return self.placed.settled(self.tensions)

    @property
    def tip(self) -> Array:
        """The position of the tip (3,) in the base frame [m]."""
        return self.shape.tip

    @property
    def lengths(self) -> Array:
        """The length of each tendon between base and anchorage [m], in the form of `tensions`."""
        return self.arm.by_section(self.shape.tendon_lengths)

    @property
    def strokes(self) -> Array:
        """The length of each tendon that the winch has taken in [m], in the form of `tensions`.

        Strokes count from `stroke_zero`, see `plan`. The stroke of a slack tendon is its maximum
        without tension.
        """
        return self.arm.by_section(strokes(self.shape, self.problem.limits.stroke_zero))

    @cached_property
    def certificate(self) -> Certificate:
        """The check of the tensions by another integrator; see octoplan.planner.certificate."""
        T = np.ravel(self.tensions)
        return certify(self.placed, T, lambda: self.shape, self._optimality)

    @property
    def reached(self) -> bool:
        """Whether the certificate confirms that the target is met."""
        return self.certificate.passed

    @cached_property
    def outcome(self) -> str:
        """The result, the active limits and a remedy: a sentence."""
        return self._compose_outcome()

    def _compose_outcome(self) -> str:
        return outcome(self)

    @cached_property
    def remarks(self) -> str:
        """Sentences about mirror images, targets and slack tendons, each after a space."""
        return remarks(self)

    def complete(self) -> None:
        """Compute shape, certificate and outcome, as far as the time limit allows.

        `shape` raises UncertifiedError if the time limit is reached before the arm is settled.
        """
        report("settling the shape")
        try:
            self._shape_or_error  # noqa: B018  (cached)
        except OutOfTime:
            vars(self)["_shape_or_error"] = UncertifiedError(OUT_OF_TIME)
        self.certificate  # noqa: B018  (cached)
        try:
            self.remarks  # noqa: B018  (cached)
        except OutOfTime:
            vars(self)["remarks"] = ""
        self.outcome  # noqa: B018  (cached)

    def copy_results(self, other: Plan) -> None:
        """Copy shape, certificate and optimum of a plan with the same problem and solution."""
        names = ("_shape_or_error", "certificate", "remarks", "optimum")
        vars(self).update({name: vars(other)[name] for name in names if name in vars(other)})

    @with_progress
    def certify(self, time_limit: float | None = None, progress: bool | None = None) -> Self:
        """Return the plan with shape and certificate computed anew, as `plan` does.

        Pass a longer `time_limit` [s], or none, if the limit of `plan` was reached before the
        certificate was complete. If the limit is reached, the outcome reports so.
        """
        seconds = None if time_limit is None else positive("time_limit", time_limit)
        result = replace(self)
        with limited_to(seconds):
            result.complete()
        return result

    # The nonlinear program

    def program(self) -> ProgramInstance:
        """Return the nonlinear program that the solution is an optimum of."""
        avoidance = self.solution.avoidance
        blocks = avoidance.blocks(self.arm) if avoidance else ()
        return ProgramInstance(self.placed, self.problem.options, blocks)

    def multiplier_counts(self) -> tuple[int, int]:
        """Return the numbers of multipliers of bounds and rows that the solution must have."""
        program = self.program().program
        return program.n_decision, program.n_design_rows

    @cached_property
    def optimum(self) -> NlpSolution | None:
        """The solution as a point of the program, with the defect of the mesh.

        The search's own point if there is one; otherwise the equilibrium under the tensions. None
        if the tensions do not settle, or if the multipliers belong to another program.
        """
        instance = self.program()
        program = instance.program
        lam_x, lam_g = np.array(self.solution.lam_x), np.array(self.solution.lam_g)
        if lam_x.size < program.n_decision or lam_g.size < program.n_design_rows:
            return None
        with suppress(OctoplanError, np.linalg.LinAlgError):
            known = NlpSolution(np.zeros(0), lam_x, lam_g, 0.0, True, 0, instance=instance)
            return on_mesh(known, instance, self.shape)
        return None

    def _optimality(self) -> Optimality:
        """Return the first-order conditions of the plan."""
        return Optimality(np.inf if self.optimum is None else self.optimum.residual)

    def multipliers(self, kind: str) -> Array:
        """Return the multipliers of the constraints of a kind; see Program.row_kinds."""
        lam = np.array(self.solution.lam_g)
        rows = self.program().program.row_kinds
        return np.asarray(lam[rows[: lam.size] == kind])

    def active_rows(self) -> list[tuple[float, str]]:
        """Return priority and name of each active limit of the program's blocks."""
        blocks = self.program().blocks
        return [each for b in blocks for each in b.active_limits(self.arm, self.multipliers)]

    def holding(self) -> list[str]:
        """Return the names of the limits that are active, by decreasing multiplier."""
        return holding(self)

    # Further plans, files and figures

    def mirror_images(self) -> tuple[tuple[float, Array], ...]:
        """Return other tensions that meet the targets at the same effort.

        Angles of planes through the base's axis, from n towards b [rad], and mirrored tensions [N].
        Empty if the target is not reached, among obstacles, and in contact.
        """
        in_contact = any(effect.plan_strategy for effect in self.scene.effects)
        if self.problem.environment or in_contact or self.mode != "exact" or not self.reached:
            return ()
        images = load(MIRROR_IMAGES)(self.placed, self.shape)
        return tuple((angle, self.arm.by_section(T)) for angle, T in images)

    def co_contract(self, level: float) -> Plan:
        """Return the plan for the same targets with at least a given tension in each tendon [N].

        The shape stays the same if the statics let tensions change without the shape: a straight
        arm without extension, tendons parallel to the midline. Otherwise the targets are still met,
        if the limits allow. The new plan continues this plan, so that the arm does not change to
        another way of meeting the targets; a search follows only if this fails.
        """
        problem = self.problem
        least = np.maximum(not_negative("level", level), problem.limits.lower)
        result: Plan = load(PLAN)(
            self.arm,
            self.targets,
            self.scene,
            norm=problem.options.norm,
            accuracy=problem.accuracy,
            near=self,
            stability_margin=problem.options.margin,
            compile=problem.machine_code,
            **replace(problem.limits, lower=tuple(least.tolist())).keywords,
            **self._obstacle_keywords(),
            **self.problem.base_keywords,
        )
        return result

    def _obstacle_keywords(self) -> dict[str, Any]:
        """Return the obstacles that were passed to `plan`, as keywords."""
        return self.problem.environment.keywords

    def save(self, path: str | Path) -> Path:
        """Write the plan, its certificate and its problem to a .json file; see load_plan.

        The file is written completely or not at all. Raises InputError for another suffix, if the
        file cannot be written, and for targets, effects and paths of other projects.
        """
        written: Path = load(SAVE_PLAN)(self, path)
        return written

    def plot(self, ax: Any = None) -> Any:
        """Draw the arm in 3-D with its tendons, tensions and target.

        See octoplan.planner.frontends.plots.plan.
        """
        return plotted(self, ax)

    def __getstate__(self) -> dict[str, Any]:
        """Return the numbers without the program, for pickle."""
        return {name: item for name, item in vars(self).items() if name != "optimum"}

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Plan):
            return NotImplemented
        return self.problem == other.problem and self.solution == other.solution

    __hash__ = None  # type: ignore[assignment]
