"""The computation at the points of a workspace: settled samples, and plans of probed points."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octoplan.model.arm import Arm
from octoplan.model.compliance import compliance_of
from octoplan.model.extensions.batches import settle_many
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.machine.compiled import Compile
from octoplan.model.support.progress import ProgressLine, check_time
from octoplan.planner.frontends.sweeps.points import Variable
from octoplan.planner.frontends.sweeps.work import Point, Rows
from octoplan.planner.limits import TendonLimits
from octoplan.planner.plan import plan
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import effort
from octoplan.planner.solve.multistart import Multistart
from octoplan.planner.solve.refine import refine
from octoplan.planner.targets.tip import TipPosition

_XYZ = ("xyz",)
VARIABLES: Mapping[str, Variable] = {
    "tip": Variable(_XYZ, "m", "position of the tip in the base frame"),
    "tip_frame": Variable(("xyz", "column"), "1", "frame of the tip: columns t, n, b"),
    "target": Variable(_XYZ, "m", "point that a plan was asked to reach; nan for samples"),
    "tensions": Variable(("tendon",), "N", "tensions in tendon order"),
    "effort": Variable((), "N", "norm of the tensions"),
    "stiffness_min": Variable((), "N/m", "stiffness of the tip along its softest direction"),
    "stiffness_max": Variable((), "N/m", "stiffness of the tip along its stiffest direction"),
    "tip_gain": Variable(
        ("singular_value",), "m/N", "singular values of the derivative of the tip by the tensions"
    ),
    "error": Variable((), "1", "estimated tip error over arm length"),
    "optimality": Variable((), "1", "residual of the first-order conditions of a plan"),
    "settled": Variable((), "1", "whether the arm has a stable shape under the tensions", False),
    "outcome": Variable((), "", "what happened", ""),
}
"""Results at each point."""
LABELS = {
    "xyz": ["x", "y", "z"],
    "column": ["t", "n", "b"],
    "singular_value": ["largest", "middle", "smallest"],
}
# Distance over the arm's length below which a target counts as reached, over the accuracy [-].
REACHED = 10.0
# Relative difference of two efforts that counts as a difference [-].
_SAME_EFFORT = 1e-6
# Number of initial guesses of a plan. In three tapered scenes, 79 of 80 plans from one guess equal
# the plans of a full search; probes that a known tip contradicts are searched in full.
_STARTS = 1


@dataclass(frozen=True)
class WorkspaceJob:
    """The part of a workspace that all points share; sent to workers.

    Attributes
    ----------
    arm, scene, limits
    accuracy : float
        Tip error over arm length.
    least_effort : bool
        Whether samples are planned for the least effort.
    compile : bool or "auto"
    time_limit : float or None
        For each point [s].
    is_probe : bool
        Whether points are sets of tensions, or targets: x, y, z, whether to search in full, and the
        tensions of the nearest tip.
    """

    arm: Arm
    scene: Scene
    limits: TendonLimits
    accuracy: float
    least_effort: bool
    compile: Compile
    time_limit: float | None
    is_probe: bool = False

    def rows(self, points: Sequence[Point]) -> Rows:
        """Return the results at points; a point that fails has the error as `outcome`."""
        with ProgressLine(False):
            if self.is_probe:
                parts = [self._row(partial(self._probe, point)) for point in points]
            else:
                parts = self._samples(np.array(points))
        return {name: np.concatenate([part[name] for part in parts]) for name in VARIABLES}

    def _row(self, compute: Callable[[], Mapping[str, Any]]) -> Rows:
        """Return the row of a point; any error becomes the `outcome`."""
        try:
            values = compute()
        except Exception as reason:
            kind = "" if isinstance(reason, OctoplanError) else f"{type(reason).__name__}: "
            values = {"outcome": f"Failed: {kind}{reason}"}
        # A point that the time limit of the whole call cuts off is not a result.
        check_time()
        row = dict[str, NDArray[Any]]()
        for name, of in VARIABLES.items():
            shape = (self.arm.n_tendons if dim == "tendon" else len(LABELS[dim]) for dim in of.dims)
            row[name] = np.full((1, *shape), of.blank, object if of.blank == "" else None)
        for name, value in values.items():
            row[name][0] = value
        return row

    def _samples(self, tensions: Array) -> list[Rows]:
        """Return the rows of sampled tensions (m, n_tendons)."""
        many = settle_many(
            self.arm,
            tensions,
            self.scene,
            self.accuracy,
            self.compile,
            errors="nan",
            time_limit=self.time_limit,
        )
        rows = []
        for T, tip, problem in zip(tensions, many.tip, many.problems, strict=True):
            if problem:
                # The number of the set is that of a chunk.
                text = problem.partition("]: ")[2] or problem
                rows.append(self._row(partial(dict, outcome=f"Failed: {text}")))
            else:
                rows.append(self._row(partial(self._sample, T, tip)))
        return rows

    def _sample(self, T: Array, tip: Array) -> Mapping[str, Any]:
        """Return the values of a settled sample, or of the plan of least effort for its tip."""
        outcome = "Settled."
        if self.least_effort:
            outcome = "Settled; no plan for this tip has less effort than the sample."
            try:
                found = self._plan(tip)
                gap = float(np.linalg.norm(found.tip - tip)) / self.arm.length
                less = found.effort < effort(T, "2") * (1 - _SAME_EFFORT)
                if found.mode == "exact" and gap <= REACHED * self.accuracy and less:
                    return self._values(found.shape) | {
                        "optimality": _optimality(found),
                        "outcome": "Planned: least effort for the tip of the sample.",
                    }
            except OctoplanError as reason:
                outcome = f"Settled; the plan for this tip failed: {reason}"
        shape = settle(
            self.arm, T, self.scene, self.accuracy, self.compile, time_limit=self.time_limit
        )
        return self._values(shape) | {"outcome": outcome}

    def _probe(self, point: Point) -> Mapping[str, Any]:
        """Return the values at the tip that is nearest to a target."""
        target, in_full, T = np.array(point[:3]), bool(point[3]), np.array(point[4:])
        tolerance = REACHED * self.accuracy * self.arm.length
        found = self._plan(target, None if in_full else _STARTS)
        gap = float(np.linalg.norm(found.tip - target))
        if gap > tolerance:
            other = self._plan_from(found, T)
            if other is not None and math.dist(other.tip, target) < gap - tolerance:
                found = other
                gap = math.dist(found.tip, target)
        shape = found.shape
        outcome = "Reached."
        if gap > tolerance:
            held = ", ".join(found.holding()) or "no limit is active"
            outcome = f"Nearest tip, {1e3 * gap:.4g} mm from the target: {held}."
        if found.solution.stopped:
            outcome = f"Stopped at the time limit, the best so far. {outcome}"
        optimality = np.inf if found.solution.stopped else _optimality(found)
        values = self._values(shape)
        return values | {"target": target, "optimality": optimality, "outcome": outcome}

    def _plan_from(self, missed: Plan, T: Array) -> Plan | None:
        """Return the plan from the tensions of the tip that is nearest to a missed target."""
        stage = Multistart(missed.problem, "nearest")
        with suppress(OctoplanError, np.linalg.LinAlgError):
            optimum = stage.solve_from(T)
            fine = None if optimum is None else refine(optimum)
            if fine is not None:
                found = Plan.of(missed.problem, fine.result(stage.trials))
                found.shape  # noqa: B018  (raises if the arm does not settle)
                return found
        return None

    def _plan(self, target: Array, starts: int | None = _STARTS) -> Plan:
        """Return the plan of least effort for a tip, or the nearest shape to the target."""
        return plan(
            self.arm,
            TipPosition(tuple(target.tolist())),
            self.scene,
            accuracy=self.accuracy,
            starts=starts,
            time_limit=self.time_limit,
            stability_margin=0.0,
            compile=self.compile,
            certify=False,
            **self.limits.keywords,
        )

    def _values(self, shape: Shape) -> dict[str, Any]:
        """Return the values of a settled shape."""
        response, _, _ = compliance_of(shape, self.arm.length, self.accuracy)
        if not response.stable:
            raise OctoplanError("the shape is not stable under constant tensions")
        soft = np.linalg.svd(response.pose_wrench[:3, :3], compute_uv=False)
        can_pull = np.greater(self.limits.upper, self.limits.lower)
        gain = np.linalg.svd(response.pose_tension[:3, can_pull], compute_uv=False)
        with np.errstate(divide="ignore"):
            stiffness = 1 / soft
        return {
            "tip": shape.tip,
            "tip_frame": shape.tip_frame,
            "tensions": shape.tensions,
            "effort": effort(shape.tensions, "2"),
            "stiffness_min": stiffness[0],
            "stiffness_max": stiffness[-1],
            "tip_gain": np.pad(gain, (0, 3 - gain.size)),
            "error": shape.error,
            "settled": True,
        }


def _optimality(found: Plan) -> float:
    """Return the residual of the first-order conditions of a plan."""
    return np.inf if found.optimum is None else found.optimum.residual
