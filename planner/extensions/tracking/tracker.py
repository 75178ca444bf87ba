"""Tracking of a moving target: tensions of least effort, one bounded step after another.

Each step takes up to three iterations of sequential quadratic programming. An iteration linearises
the program of a plan on its coarse mesh, solves a small conic program
(octoplan.planner.extensions.tracking.step_program), and settles the arm near the last shape on a
mesh of the accuracy of the plan. The difference of both meshes, the defect, corrects the program
of the next iteration, as in octoplan.planner.solve.refine.

Source: Diehl, Bock, Schloeder, Findeisen, Nagy, Allgoewer, "Real-time optimization and nonlinear
model predictive control of processes governed by differential-algebraic equations", J. Process
Control 12 (2002).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.loads import has_complementarity, is_path_dependent
from octoplan.model.paths import Array
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.checks import kind, positive
from octoplan.model.support.errors import Described, InputError
from octoplan.model.support.machine.compiled import Compile, checked_compile
from octoplan.model.tendons import strokes
from octoplan.planner.extensions.tracking.iteration import Iterate, Iteration, StabilityRow
from octoplan.planner.extensions.tracking.reasons import STABILITY, StepLimits, limit_names
from octoplan.planner.extensions.tracking.step_program import LinearRows, StepSolution
from octoplan.planner.extensions.tracking.tracked_step import TrackedStep
from octoplan.planner.extensions.trajectory.question import Rates
from octoplan.planner.extensions.warm_start import jump
from octoplan.planner.limits import natural_tensions
from octoplan.planner.plan_result import Plan
from octoplan.planner.planning_problem import check_targets
from octoplan.planner.program_instance import ProgramInstance
from octoplan.planner.solution import STABILITY_TOLERANCE
from octoplan.planner.targets.base import Target
from octoplan.planner.targets.target_set import TargetSet

# Largest number of iterations of a step.
ITERATIONS = 3
# Largest change of a tension in a step, over the tension that bends the arm by 1 rad [-].
LARGEST_CHANGE = 0.5
# Change of the tensions in an iteration, over the largest tension, after which the error of the
# tensions is below 1e-5 [-]. The error is about the square of the change.
_SMALL_CHANGE = 1e-3
# Reason for which a step is shortened.
_BRANCH_ENDS = "the branch of equilibria, which ends nearby"
# Number of times that a step to an unstable shape, or beyond rates of strokes, is shortened.
_HALVINGS = 5
# Relative distance of a change from its limit below which the limit is active [-].
_HELD_RTOL = 1e-6
# Relative excess of a stroke rate that counts as rounding [-].
_RATE_RTOL = 1e-9


@dataclass(frozen=True, eq=False)
class _Advance:
    """The end of a step.

    Attributes
    ----------
    end : Iterate
    solution : StepSolution or None
        Of the last conic program.
    iterations : int
    converged : bool
        Whether the last iteration changed the tensions by little.
    reason : str
        Reason for which the step was shortened, otherwise empty.
    """

    end: Iterate
    solution: StepSolution | None
    iterations: int
    converged: bool
    reason: str

    def shortened(self, end: Iterate, reason: str) -> _Advance:
        """Return a step that ends earlier."""
        return replace(self, end=end, converged=False, reason=reason)


class Tracker:
    """Tensions of least effort for a moving target, in bounded time per step.

    A tracker has a state: the tensions and the shape of its last step, at first those of the plan.
    Each step moves the arm on from this shape. Use one tracker in one thread at a time.

    A step changes each tension by at most half of the tension that bends the arm by 1 rad, or by
    less with `rate_max`. The arm stays on its branch of stable equilibria: a step that would leave
    the branch is shortened. If a target cannot be met in one step, the step ends as near to the
    target as found, and its outcome names the reason. Repeat the target to continue.

    Parameters
    ----------
    plan : Plan
        A plan that reaches its targets, without obstacles and contact. Its limits, norm, accuracy
        and stability margin apply to all steps.
    rate : float
        Number of steps per second [Hz]; required with limits of rates.
    rate_max : float, or one for each tendon
        Largest rate of tensions [N/s]; (n_tendons,), or one row for each section. No limit unless
        given.
    stroke_rate_max : float
        Largest rate of tendon lengths [m/s]; no limit unless given.
    compile : bool or "auto"
        Whether to use machine code, see settle; as in the plan unless given.

    Raises
    ------
    InputError
        For a plan that misses its targets, for plans with obstacles, contact, base joints or a
        stiffness, and for other unsuitable arguments.
    CompilerError
        If `compile` is True and no compiler works.
    OctoplanError
        If the arm does not settle near the shape of the plan.
    """

    def __init__(
        self,
        plan: Plan,
        *,
        rate: float | None = None,
        rate_max: Any = None,
        stroke_rate_max: float | None = None,
        compile: Compile | None = None,  # noqa: A002  (the name that scripts use)
    ) -> None:
        _check_plan(plan)
        problem = plan.problem
        if compile is not None:
            problem = replace(problem, machine_code=checked_compile(compile))
        rates = Rates.of(plan.arm, rate_max, stroke_rate_max)
        self._limits = _step_limits(plan.arm, rate, rates)
        instance = ProgramInstance(problem, problem.options.replace(modes=0))
        code = problem.machine_code
        shape = settle(
            plan.arm, plan.tensions, problem.scene, problem.accuracy, code, near=plan.shape
        )
        self._iteration = Iteration(instance, shape, self._limits.largest)
        self._last = self._iteration.first(shape)
        self._stability: StabilityRow | None = None
        if not self._iteration.has_reserve(shape):
            self._stability = self._iteration.stability_row(shape)
        # Find the multipliers, and the optimum on the mesh of the tracker.
        self._moved(problem.target_set.numbers)

    @property
    def tensions(self) -> Array:
        """The tensions of the last step, in the shape of `Plan.tensions` [N]."""
        return self._iteration.instance.arm.by_section(self._last.tensions)

    @property
    def shape(self) -> Shape:
        """The shape of the last step."""
        return self._last.shape

    def step(self, target: Target | Iterable[Target]) -> TrackedStep:
        """Return the tensions for a target, and move on to them.

        Parameters
        ----------
        target : Target, or several
            Of the same kind as the targets of the plan.

        Raises
        ------
        InputError
            For targets of another kind. The tracker then keeps its state.

        Notes
        -----
        A step raises no error if the arm cannot follow: the step is shortened, and
        `TrackedStep.held_back` names the reason.
        """
        numbers = self._numbers(target)
        begin = self._last
        return self._result(begin, self._moved(numbers), numbers)

    def _moved(self, numbers: Array) -> _Advance:
        """Move on to the end of a step for the parameters of targets, and return the step."""
        begin = self._last
        advance = self._within_stroke_rates(begin, self._advanced(numbers))
        if self._iteration.has_reserve(advance.end.shape):
            self._stability = None
        else:
            advance = self._stable(begin, advance)
            self._stability = self._iteration.stability_row(advance.end.shape)
        self._last = advance.end
        return advance

    def _numbers(self, target: Target | Iterable[Target]) -> Array:
        """Return the parameters of targets; raise InputError for targets of another kind."""
        instance = self._iteration.instance
        known = instance.target_set
        each = check_targets(instance.arm, target)
        given = TargetSet(instance.arm, each)
        is_alike = (
            [type(one) for one in each] == [type(one) for one in known.each]
            and given.stations == known.stations
            and given.tendons == known.tendons
            and given.terms == known.terms
        )
        if not is_alike:
            names = ", ".join(type(one).__name__ for one in each)
            kinds = ", ".join(type(one).__name__ for one in known.each)
            allowed = f"like the targets of the plan: {kinds}"
            if names == kinds:
                allowed += ", with equal terms; return numbers that change from `parameters`"
            raise InputError("target", Described(names), allowed)
        return given.numbers

    def _advanced(self, numbers: Array) -> _Advance:
        """Return the last iterate of a step for the parameters of targets."""
        begin = self._last
        instance = self._iteration.instance
        lower = np.array(instance.limits.lower)
        upper = np.array(instance.limits.upper)
        change = self._limits.change
        box = (
            np.maximum(lower, begin.tensions - change),
            np.minimum(upper, begin.tensions + change),
        )
        at = begin
        solution: StepSolution | None = None
        is_shortened = False
        for count in range(1, ITERATIONS + 1):
            following, solution, is_shortened = self._iteration.next(
                at, numbers, box, self._further_limits(begin, at)
            )
            if following is None or solution is None:
                return _Advance(at, solution, count, False, _BRANCH_ENDS)
            size = float(np.abs(following.tensions).max())
            moved = float(np.abs(following.tensions - at.tensions).max())
            at = following
            is_near = (
                self._miss(at.shape, numbers) <= instance.problem.accuracy or solution.miss > 0
            )
            if is_near and moved <= _SMALL_CHANGE * size and not is_shortened:
                return _Advance(at, solution, count, True, "")
        reason = _BRANCH_ENDS if is_shortened else ""
        return _Advance(at, solution, ITERATIONS, False, reason)

    def _further_limits(self, begin: Iterate, at: Iterate) -> LinearRows:
        """Return stability and rates of strokes at an iterate, linearised in the tensions."""
        n = begin.tensions.size
        values = np.zeros(0)
        jacobian = np.zeros((0, n))
        lower = np.zeros(0)
        upper = np.zeros(0)
        if self._stability is not None:
            value, slope, tensions = self._stability
            values = np.array([value + slope @ (at.tensions - tensions)])
            jacobian = slope[None]
            # The plan may be less stable than the margin of steps.
            lower = np.array([min(self._iteration.margin, value)])
            upper = np.array([np.inf])
        if np.isfinite(self._limits.stroke):
            L = self._iteration.instance.arm.length
            change = (at.shape.tendon_lengths - begin.shape.tendon_lengths) / L
            largest = np.full(n, self._limits.stroke / L)
            values = np.append(values, change)
            jacobian = np.vstack([jacobian, at.shape.equilibrium.length_tension / L])
            lower = np.append(lower, -largest)
            upper = np.append(upper, largest)
        return LinearRows(values, jacobian, lower, upper)

    def _stable(self, begin: Iterate, advance: _Advance) -> _Advance:
        """Return a step that ends at a stable shape, shortened if necessary."""
        iteration = self._iteration
        margin = iteration.margin - STABILITY_TOLERANCE
        if iteration.is_stable(advance.end.shape, margin):
            return advance
        if not iteration.is_stable(begin.shape, margin):
            # The plan is less stable than the margin of steps.
            margin = 0.0
        reason = STABILITY.format(iteration.margin)
        for halving in range(_HALVINGS + 1):
            end = iteration.between(begin, advance.end.tensions, 0.5**halving)
            if end is not None and iteration.is_stable(end.shape, margin):
                return advance if halving == 0 else advance.shortened(end, reason)
        return advance.shortened(begin, reason)

    def _within_stroke_rates(self, begin: Iterate, advance: _Advance) -> _Advance:
        """Return a step within the rates of strokes, shortened if necessary."""
        largest = self._limits.stroke
        for count in range(_HALVINGS if np.isfinite(largest) else 0):
            change = advance.end.shape.tendon_lengths - begin.shape.tendon_lengths
            fastest = float(np.abs(change).max())
            if fastest <= largest * (1 + _RATE_RTOL):
                return advance
            # The first share leaves a small excess, as strokes are not linear in the tensions. The
            # square of a later share ends within the rate.
            share = (largest / fastest) ** (1 if count == 0 else 2)
            end = self._iteration.between(begin, advance.end.tensions, share)
            reason = "the largest rate of strokes"
            advance = advance.shortened(begin if end is None else end, reason)
        return advance

    def _miss(self, shape: Shape, numbers: Array) -> float:
        """Return the largest residual of the targets, lengths over the arm's length."""
        equality, soft, inequality = self._iteration.terms(shape, numbers)
        return float(np.abs([*equality, *soft, *np.minimum(inequality, 0.0)]).max(initial=0.0))

    def _result(self, begin: Iterate, advance: _Advance, numbers: Array) -> TrackedStep:
        """Return the result of a step."""
        instance = self._iteration.instance
        arm = instance.arm
        shape = advance.end.shape
        T = shape.tensions
        limits = instance.limits
        misses = np.concatenate(self._iteration.terms(shape, numbers))
        terms = instance.target_set.terms
        names = [name for each in terms.names[:3] for name in each]
        misses[terms.count :] = np.minimum(misses[terms.count :], 0.0)
        residuals = {
            name: float(
                np.linalg.norm([x for x, one in zip(misses, names, strict=True) if one == name])
            )
            for name in dict.fromkeys(names)
        }
        # NaN is not reached.
        reached = all(value <= instance.problem.accuracy for value in residuals.values())
        reasons = [] if reached else self._reasons(begin, advance)
        # Limits of the change keep the effort from its minimum.
        held = np.any(np.abs(T - begin.tensions) >= (1 - _HELD_RTOL) * self._limits.change)
        stroke_reserve = None
        if limits.strokes is not None:
            taken = strokes(shape, limits.stroke_zero)
            least, most = np.array(limits.strokes)
            stroke_reserve = arm.by_section(np.minimum(taken - least, most - taken))
        lengths = {name for name, unit in terms.units.items() if unit == "L"}
        return TrackedStep(
            tensions=arm.by_section(T),
            shape=shape,
            residuals={
                name: value * (arm.length if name in lengths else 1.0)
                for name, value in residuals.items()
            },
            reached=reached,
            tension_reserve=arm.by_section(np.array(limits.upper) - T),
            pull_reserve=np.inf if limits.total is None else limits.total - float(T.sum()),
            stroke_reserve=stroke_reserve,
            reasons=tuple(reasons),
            optimal=advance.converged and not held,
            jump=jump(begin.tensions, T),
            iterations=advance.iterations,
            units=terms.units,
        )

    def _reasons(self, begin: Iterate, advance: _Advance) -> list[str]:
        """Return the names of the limits that hold the arm back in a step."""
        if advance.reason:
            return [advance.reason]
        names = list[str]()
        if advance.solution is not None:
            names = limit_names(
                self._iteration.instance,
                self._limits,
                advance.solution,
                begin.tensions,
                advance.end.tensions,
            )
        if not names and not advance.converged:
            names.append(f"the largest number of iterations, {ITERATIONS}")
        return names


def _check_plan(plan: Any) -> None:
    """Raise InputError for plans that cannot be tracked."""
    kind("plan", plan, Plan, "a Plan")
    scene = plan.scene
    problem = plan.problem
    in_contact = has_complementarity(scene) or is_path_dependent(scene)
    of_contact = any(target.plan_strategy for target in plan.targets)
    among_obstacles = problem.environment or plan.solution.avoidance is not None
    checks = (
        (in_contact or of_contact, "a plan in contact", "a plan in free space"),
        (among_obstacles, "a plan with obstacles or clearance", "a plan without them"),
        (problem.placement is not None, "a plan with base joints", "a plan with a fixed base"),
        (
            problem.target_set.requests,
            "a plan for a stiffness",
            "a plan for other targets, whose shapes need no stiffness",
        ),
    )
    for is_refused, given, allowed in checks:
        if is_refused:
            raise InputError("plan", Described(given), allowed)
    if plan.mode != "exact" or not plan.reached:
        given = "a plan that misses its targets"
        raise InputError("plan", Described(given), "a plan that reaches them")


def _step_limits(arm: Arm, rate: float | None, rates: Rates) -> StepLimits:
    """Return the largest changes in a step; raise InputError for limits of rates without `rate`."""
    each = np.array(rates.tension)
    if rate is None and np.isfinite([*each, rates.stroke]).any():
        raise InputError("rate", None, "the number of steps per second [Hz] beside limits of rates")
    steps = 1.0 if rate is None else positive("rate", rate)
    return StepLimits(each / steps, LARGEST_CHANGE * natural_tensions(arm), rates.stroke / steps)
