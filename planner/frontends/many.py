"""Plan many targets in one call; along a path, each plan starts from the one before."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.extensions.batches import Errors
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.shape import Shape
from octoplan.model.support.checks import kind
from octoplan.model.support.errors import InputError, OctoplanError
from octoplan.model.support.progress import OutOfTime
from octoplan.planner.certificate import Certificate
from octoplan.planner.limits import checked_limits
from octoplan.planner.plan import plan
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem, planned_scene
from octoplan.planner.solution import Solution
from octoplan.planner.targets.base import Target, as_targets


@dataclass(frozen=True, eq=False, repr=False)
class FailedPlan(Plan):
    """A plan for a target that raised an error.

    Numbers are nan, `reached` is False, and certificate and outcome have the reason.

    Attributes
    ----------
    reason : str
        Message of the error.
    """

    reason: str = ""

    @property
    def shape(self) -> Shape:
        """Raise OctoplanError with the reason."""
        raise OctoplanError(self.reason)

    def plot(self, ax: Any = None) -> Any:
        """Raise OctoplanError with the reason."""
        raise OctoplanError(self.reason)

    @property
    def tip(self) -> Array:
        """Position of the tip (3,), nan."""
        return np.full(3, np.nan)

    @property
    def lengths(self) -> Array:
        """Tendon lengths, nan for each tendon."""
        return np.full_like(self.tensions, np.nan)

    strokes = lengths

    @property
    def certificate(self) -> Certificate:
        """A failed certificate with the reason."""
        return Certificate(problem=self.reason, tolerance=self.problem.accuracy)


def plan_many(
    arm: Arm,
    targets: Iterable[Target | Iterable[Target]],
    scene: Scene | None = None,
    tension_max: Any = float("inf"),
    *,
    path: bool = True,
    errors: Errors = "raise",
    **others: Any,
) -> list[Plan]:
    """Return a plan for each of many targets, in order.

    Parameters
    ----------
    arm, scene, tension_max
        See plan.
    targets : sequence of Target, or of several simultaneous targets
    path : bool
        Whether to warm-start each plan from the one before, for targets that follow a path. This is
        about ten times faster, and tensions change smoothly; the plans follow one local optimum,
        and plans from all initial guesses may find a better one.
    errors : "raise" or "nan"
        Whether to raise the error of a target, or to return a FailedPlan for this target.
    **others
        Further arguments of plan.

    Raises
    ------
    InputError
        As plan, with the index of the target. With `errors="nan"`, for arguments that are invalid
        for every target only.
    """
    if errors not in ("raise", "nan"):
        raise InputError("errors", errors, '"raise" or "nan"')
    scene = planned_scene(arm, scene)
    limits = checked_limits(arm, scene, tension_max, **others)
    kind("targets", targets, Iterable, "a sequence of targets")
    plans: list[Plan] = []
    near: Plan | None = None
    for i, target in enumerate(targets):
        given = tuple(target) if isinstance(target, Iterator) else target
        try:
            plans.append(plan(arm, given, scene, tension_max, near=near, **others))
            near = plans[-1] if path else None
        except OutOfTime:
            raise  # the limit of an outer call
        except Exception as error:
            reason = _of_target(error, f"targets[{i}]")
            if errors == "raise":
                raise reason from None
            accuracy = others.get("accuracy", 1e-6)
            problem = PlanningProblem(arm, as_targets(given), scene, limits, NlpOptions(), accuracy)
            T = arm.by_section(np.full(arm.n_tendons, np.nan))
            nothing = Solution(NlpOptions(), T, (), (), ())
            kind_of = "" if isinstance(reason, OctoplanError) else f"{type(reason).__name__}: "
            plans.append(FailedPlan.of(problem, nothing, reason=f"{kind_of}{reason}"))
    return plans


def _of_target(reason: Exception, which: str) -> Exception:
    """Return an error with the name of the target, such as "targets[3]"."""
    if isinstance(reason, InputError):
        return InputError(f"{which}: {reason.field}", reason.given, reason.allowed)
    if isinstance(reason, OctoplanError):
        return reason.of_set(which)
    reason.add_note(f"the failed target is {which}")
    return reason
