"""Measure the verified error of an arm in a scene over time, for settling and planning."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.verification import verify
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.forward import checked_accuracy, collocation_map
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.checks import is_several, whole
from octoplan.model.support.errors import ConvergenceError, InputError, OctoplanError
from octoplan.model.support.machine.compiled import Compile
from octoplan.model.support.progress import track, with_progress
from octoplan.model.support.text import TextRepr, plotted
from octoplan.planner.certificate import Optimality, certify
from octoplan.planner.plan import plan
from octoplan.planner.plan_result import Plan
from octoplan.planner.targets import Target, TipPosition

# Accuracies that are compared unless others are given.
ACCURACIES = (1e-2, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-10)
# Largest time of the recommended accuracy, relative to the fastest accuracy.
ACCEPTED_SLOWDOWN = 2.0
# Accuracies of the reference, tried in this order: contact and friction end before the finest.
_REFERENCES = (1e-11, 1e-10, 1e-9, 1e-8)
# Substeps of the verification agree to this multiple of the reference accuracy.
_VERIFIED = 10.0


@dataclass(frozen=True)
class AccuracyPoint:
    """Time and error of one accuracy.

    Attributes
    ----------
    accuracy : float
        The requested accuracy.
    error : float
        Verified error, see AccuracyStudy; NaN if the call failed.
    seconds : float
        Processor time of the call [s], median of the repeats; NaN if the call failed.
    problem : str
        Error or outcome of a call that failed; empty otherwise.
    """

    accuracy: float
    error: float
    seconds: float
    problem: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class AccuracyStudy(TextRepr):
    """Verified errors over time of settling and planning, for an arm in a scene.

    Attributes
    ----------
    arm : Arm
    scene : Scene
    settling : tuple of AccuracyPoint
        Settling the tensions. The error is the distance of the tip from the reference tip, over L.
    planning : tuple of AccuracyPoint
        Planning the targets, with certificate. The error is the largest residual of the targets at
        the tensions of the plan, settled and verified to `reference`: lengths over L, angles in
        rad.
    reference : float
        Accuracy of the reference: smaller errors are not resolved.
    reference_scheme : str
        The method of the reference.
    """

    arm: Arm
    scene: Scene
    settling: tuple[AccuracyPoint, ...]
    planning: tuple[AccuracyPoint, ...]
    reference: float
    reference_scheme: str

    @property
    def recommended(self) -> float | None:
        """The finest accuracy that costs little time; None if no accuracy succeeded.

        Settling and planning each take at most ACCEPTED_SLOWDOWN times as long as with the fastest
        accuracy, and both errors are at most the accuracy. If no accuracy is that fast, the
        accuracy with the smallest slowdown. A curve without any success is ignored.
        """
        slowdowns = {
            point.accuracy: max(slowdown(curve, point.accuracy) for curve in self._curves.values())
            for point in self.settling
            if all(self._is_met(curve, point.accuracy) for curve in self._curves.values())
        }
        fast = [a for a, factor in slowdowns.items() if factor <= ACCEPTED_SLOWDOWN]
        return min(fast) if fast else min(slowdowns, key=lambda a: slowdowns[a], default=None)

    @property
    def recommendation(self) -> str:
        """The recommended accuracy in one sentence, with the reason, times and errors."""
        best = self.recommended
        if best is None:
            return "No accuracy is recommended: no error is below the requested accuracy."
        parts = []
        for name, curve in self._curves.items():
            point = next(point for point in curve if point.accuracy == best)
            parts.append(
                f"{name} takes {duration(point.seconds)}, {slowdown(curve, best):.2g} times the "
                f"fastest, with an error of {point.error:.1e}"
            )
        fast = all(slowdown(each, best) <= ACCEPTED_SLOWDOWN for each in self._curves.values())
        reason = f"at most {ACCEPTED_SLOWDOWN:g} times the time of the fastest"
        reason = f"the finest that takes {reason}" if fast else f"the cheapest; none takes {reason}"
        return f"Use accuracy = {best:.0e}, {reason}: {'; '.join(parts)}."

    @property
    def problems(self) -> tuple[str, ...]:
        """The failures, one sentence for each kind."""
        curves = (("settling", self.settling), ("planning", self.planning))
        found: dict[str, list[str]] = {}
        for name, curve in curves:
            for point in curve:
                if point.problem:
                    found.setdefault(f"{name} failed: {point.problem}", []).append(
                        f"{point.accuracy:.0e}"
                    )
        return tuple(f"accuracy {', '.join(steps)}: {text}" for text, steps in found.items())

    @property
    def _curves(self) -> dict[str, tuple[AccuracyPoint, ...]]:
        """The curves that have at least one success, by name."""
        curves = {"settling": self.settling, "planning": self.planning}
        return {
            name: curve
            for name, curve in curves.items()
            if any(not point.problem for point in curve)
        }

    def _is_met(self, curve: tuple[AccuracyPoint, ...], accuracy: float) -> bool:
        """Return whether a call succeeded with an error of at most the accuracy."""
        allowed = max(accuracy, self.reference)
        return any(point.accuracy == accuracy and point.error <= allowed for point in curve)

    def plot(self, ax: Any = None) -> Any:
        """Draw errors over times. Return a new Figure, or the given axes."""
        return plotted(self, ax)


def slowdown(curve: tuple[AccuracyPoint, ...], accuracy: float) -> float:
    """Return the time of an accuracy relative to the fastest of the curve; NaN if it failed."""
    times = {point.accuracy: point.seconds for point in curve if not point.problem}
    return times.get(accuracy, math.nan) / min(times.values(), default=math.nan)


def duration(seconds: float) -> str:
    """Return a time as text, in ms or s."""
    return f"{1e3 * seconds:.3g} ms" if seconds < 0.9995 else f"{seconds:.3g} s"


@with_progress
def accuracy_study(
    arm: Arm,
    scene: Scene | None,
    tensions: Any,
    target: Target | tuple[Target, ...] | None = None,
    tension_max: Any = np.inf,
    *,
    accuracies: Any = ACCURACIES,
    repeats: int = 5,
    planning: bool = True,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    progress: bool | None = None,
    **options: Any,
) -> AccuracyStudy:
    """Settle and plan with several accuracies; return verified errors and times.

    The reference is the settled shape at 1e-11, or the finest accuracy that the arm settles to,
    corrected by an integrator of another kind and order (`reference_scheme`).

    Parameters
    ----------
    arm, scene, tensions
        See settle.
    target : Target, or several
        Targets of the plans; the default is the position of the tip under `tensions`.
    tension_max : float, or one for each tendon
        See plan.
    accuracies : sequence of float
        Accuracies from 1e-12 to 0.1.
    repeats : int
        Number of timed settles for each accuracy. Plans are timed once, after a first plan.
    planning : bool
        Whether to plan, too.
    compile : bool or "auto"
        See settle.
    progress : bool
        See plan.
    **options
        Further arguments of plan.

    Raises
    ------
    InputError
        If an argument is not allowed.
    OctoplanError
        If the arm does not settle; see settle.
    """
    repeats = whole("repeats", repeats, 1)
    if not is_several(accuracies) or not len(accuracies):
        raise InputError("accuracies", accuracies, "at least one number, in a list")
    steps = sorted({checked_accuracy(each) for each in accuracies}, reverse=True)
    shape, reference = reference_shape(arm, tensions, scene)
    tip, scheme = verified_tip(shape, reference)
    goal = TipPosition(tuple(map(float, tip))) if target is None else target
    planned = partial(plan, arm, goal, scene, tension_max, compile=compile, **options)
    unreachable = _missed(planned) if planning else ""
    is_planned = planning and not unreachable
    calls = list(product(("settling", "planning")[: 1 + is_planned], steps))
    points: dict[str, list[AccuracyPoint]] = {"settling": [], "planning": []}
    for name, accuracy in track("accuracies measured", calls):
        if name == "settling":
            points[name].append(
                _measured(
                    accuracy,
                    partial(settle, arm, tensions, scene, accuracy, compile),
                    lambda found: math.dist(found.tip, tip) / arm.length,
                    repeats,
                )
            )
        else:
            points[name].append(
                _measured(
                    accuracy,
                    partial(planned, accuracy=accuracy),
                    lambda found: _plan_error(found, reference),
                    repeats=1,
                )
            )
    if unreachable:
        points["planning"] = [AccuracyPoint(a, math.nan, math.nan, unreachable) for a in steps]
    return AccuracyStudy(
        shape.arm,
        shape.scene,
        settling=tuple(points["settling"]),
        planning=tuple(points["planning"]),
        reference=reference,
        reference_scheme=scheme,
    )


def _missed(planned: Callable[[], Plan]) -> str:
    """Return the outcome of a plan whose target is out of reach; "" for other plans.

    At accuracies coarser than the distance such a target counts as reached, which says nothing
    about the cost of accuracy.
    """
    try:
        found = planned()
    except InputError:
        raise
    except OctoplanError:
        return ""
    return found.outcome if found.mode == "nearest" and not found.reached else ""


def _measured(
    accuracy: float, call: Callable[[], Any], error: Callable[[Any], float], repeats: int
) -> AccuracyPoint:
    """Return the time and the error of a call; the first call builds functions, untimed."""
    try:
        found = call()
        if isinstance(found, Plan) and not found.reached:
            return AccuracyPoint(accuracy, math.nan, math.nan, found.outcome)
        off = error(found)
        seconds = [processor_time(call) for _ in range(repeats)]
    except OctoplanError as reason:
        return AccuracyPoint(accuracy, math.nan, math.nan, str(reason))
    return AccuracyPoint(accuracy, off, float(np.median(seconds)))


def processor_time(call: Callable[[], object]) -> float:
    """Return the processor time of a call [s]; timeit would be the reported source of warnings."""
    begin = time.process_time()
    call()
    return time.process_time() - begin


def _plan_error(found: Plan, accuracy: float) -> float:
    """Return the largest residual of the targets at the verified shape of a plan's tensions."""
    problem = replace(found.problem, accuracy=accuracy)
    tensions = np.ravel(found.tensions)
    shape = settle(found.arm, found.tensions, found.scene, accuracy)
    checked = certify(problem, tensions, lambda: shape, lambda: Optimality(0.0))
    if checked.problem:
        raise OctoplanError(checked.problem)
    return max(checked.equality.values(), default=0.0)


def reference_shape(
    arm: Arm, tensions: Any, scene: Scene | None, accuracies: tuple[float, ...] = _REFERENCES
) -> tuple[Shape, float]:
    """Return the shape at the first of some accuracies that the arm settles to, and the accuracy.

    Raises the errors of settle.
    """
    for accuracy in accuracies[:-1]:
        try:
            return settle(arm, tensions, scene, accuracy), accuracy
        except ConvergenceError:
            continue
    return settle(arm, tensions, scene, accuracies[-1]), accuracies[-1]


def verified_tip(shape: Shape, accuracy: float) -> tuple[Array, str]:
    """Return the tip (3,) [m] after a check by another integrator, and its name.

    Collocation is solved on the mesh of the shape, and corrected by the defects of initial value
    integration. The printed equations have no collocation: the tip is that of the shape.
    """
    if shape.scene.has(PrintedStatics):
        return shape.tip, shape.scheme
    forward = collocation_map(shape.arm, shape.scene, shape.refinement)
    point = forward.solve(shape.tensions, shape.collocated)
    check, _ = verify(point, _VERIFIED * accuracy)
    return check.poses[-1, 4:].copy(), "collocation and initial value integration"
