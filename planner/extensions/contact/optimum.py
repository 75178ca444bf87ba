"""Optima of programs of arms in contact, by a trust region."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np
from scipy.optimize import BFGS

from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.paths import Array
from octoplan.model.support.errors import OctoplanError, UnsettledContactError
from octoplan.model.support.progress import OutOfTime, check_time
from octoplan.planner.certificate import Optimality
from octoplan.planner.extensions.contact.kinks import Kink, Kinks, after_step, pieces, with_kink
from octoplan.planner.extensions.contact.load_path import LoadPath
from octoplan.planner.extensions.contact.program import Constraints, TensionProgram
from octoplan.planner.limits import natural_tensions

# Largest number of steps, with failed steps.
_STEPS = 100
# First trust region, in units of the tensions that bend the arm by 1 rad.
_RADIUS = 0.25
# First penalty of violations.
_FIRST_PENALTY = 10.0
# Smallest and largest penalty of violations.
_PENALTIES = (1e-3, 1e5)
# Violations and steps below this count as 0.
_NONE = 1e-7
# Violation over the accuracy with which constraints count as met.
MET = 0.5
# Violations below this are on the way along curved constraints.
_BALANCED = 1e-3
# First length of a probe for kinks, in units of the tensions that bend the arm by 1 rad, and the
# largest number of probes.
_PROBE, _PROBES = 1e-3, 8
# Penalty over the multipliers for which a violation is no descent.
_EXACT = 10.0
# Number of attempts without progress after which the steps end, and the factors of violation and of
# effort that count as progress: most guesses that do not meet the constraints do not come nearer.
_ATTEMPTS, _NEARER, _LIGHTER = 10, 0.9, 0.99
# Number of recent merits; a step may raise the merit up to the largest of these.
_RECENT = 3


@dataclass(frozen=True, eq=False)
class ContactOptimum:
    """The optimum that the steps reach from an equilibrium.

    Attributes
    ----------
    point : Equilibrium
        The equilibrium.
    violation : float
        Norm of the violations; 0 if all constraints are met.
    residual : float
        Of the first-order conditions, scaled.
    lam_x : (n_tendons,)
        The multipliers of limits, above 0 at the upper ones.
    lam_g : (0,) or (1,)
        Multiplier of the stability bound, if the bound costs effort.
    load_path : LoadPath
        Tensions of the steps, without the first and the last.
    refinement : int
        Refinement of the mesh.
    """

    point: Equilibrium
    violation: float
    residual: float
    lam_x: tuple[float, ...]
    lam_g: tuple[float, ...]
    load_path: LoadPath
    refinement: int

    @property
    def is_optimal(self) -> bool:
        """Whether the constraints and the first-order conditions are met."""
        return not self.violation and self.residual < 3 * _NONE

    @property
    def cost(self) -> tuple[float, bool, float]:
        """The order of optima: violation, whether not optimal, effort [N]."""
        return self.violation, not self.is_optimal, float(np.linalg.norm(self.point.tensions))


def optimum(
    program: TensionProgram, begin: Equilibrium, start: Array | None = None, enough: float = 0.0
) -> ContactOptimum:
    """Return the optimum from an equilibrium, or from other tensions.

    With `enough`, the steps end as soon as the violation is at most this. If the constraints cannot
    be met from there, the result is a point of least violation; if the time is over, the last
    iterate. Raises the errors of settling the start.
    """
    at = program.at((begin.tensions if start is None else start) / program.unit, begin)
    path = [at]
    ends = list[Conditions]()
    with suppress(OutOfTime):
        for there, found in _iterates(program, at):
            path.append(there)
            ends = [found] if found else []
            if there.violation <= enough:
                break
    tolerance = max(_NONE, MET * program.problem.accuracy)
    met = [k for k, each in enumerate(path) if each.violation <= tolerance]
    if path[-1].violation > tolerance and met:
        path, ends = path[: met[-1] + 1], []
    at, n = path[-1], program.n
    end = ends[0] if ends else conditions(at)
    load_path = tuple(tuple(each.point.tensions.tolist()) for each in path[1:-1])
    above, below, (stability, *_) = np.split(end.step.multipliers, [n, 2 * n])
    lam_x, yields = tuple((above - below).tolist()), bool(program.least and stability > _NONE)
    violation, lam_g = at.violation * (at.violation > tolerance), (-float(stability),) * yields
    return ContactOptimum(
        at.point, violation, end.residual, lam_x, lam_g, load_path, program.refinement
    )


def _iterates(
    program: TensionProgram, at: Constraints
) -> Iterator[tuple[Constraints, Conditions | None]]:
    """Yield the constraints after each step, and last with the first-order conditions there.

    A step fails if the shape does not settle, or if the merit exceeds the largest recent merit:
    steps along curved constraints violate the constraints a little. The next step is shorter. If
    steps are too short to count, probes find the kinks nearby, or a step of descent.
    """
    natural, n = natural_tensions(program.problem.arm) / program.unit, program.n
    radius, penalty, recent = _RADIUS, _FIRST_PENALTY, [at]
    kinks, progress = Kinks(), Progress.begin(at)
    # The effort's, to be updated to that of the Lagrangian.
    hessian = BFGS("damp_update", init_scale=1.0)
    hessian.initialize(n, "hess")
    for _ in range(_STEPS):
        check_time()
        progress = progress.after(at)
        if progress.attempts > _ATTEMPTS:
            yield from _restored(program, at, max(radius, _RADIUS / 10) * natural)
            return
        step = best_step(at, kinks, hessian.get_matrix(), radius * natural, penalty)
        penalty = step.penalty
        size = float(np.abs(step.change / natural).max())
        if size < _NONE:
            end = probed(program, at)
            if end.beyond is None:
                yield at, end
                return
            radius, kinks = 2 * end.reach, end.kinks
            at, recent = end.beyond, [end.beyond]
            yield at, None
            continue
        most = max(each.merit(penalty) for each in recent) + penalty * _NONE / 1e3
        longer, radius, there = max(radius, 2 * size), size / 4, None
        with suppress(OctoplanError):
            there = program.at(at.tensions + step.change, at.point, step.tangential)
        if there is None or there.merit(penalty) > most:
            continue
        piece = step.piece
        if there.by_tensions.shape == piece.by_tensions.shape:
            lam = step.multipliers[2 * n :][: len(piece.by_tensions)]
            slope = (there.by_tensions - piece.by_tensions).T @ lam
            hessian.update(there.tensions - at.tensions, there.tensions - at.tensions - slope)
        kinks = after_step(kinks, at, there)
        if penalty > _FIRST_PENALTY:
            penalty = max(penalty / 10, _FIRST_PENALTY)
        at, radius, recent = there, longer, [*recent[1 - _RECENT :], there]
        yield at, None


def _restored(
    program: TensionProgram, at: Constraints, radius: Array
) -> Iterator[tuple[Constraints, None]]:
    """Yield points of decreasing violation near a point at which constraints are nearly met.

    Steps along curved constraints leave a small violation.
    """
    while _NONE < at.violation <= _BALANCED:
        check_time()
        there = None
        with suppress(OctoplanError):
            change, tangential, *_ = at.step(np.eye(program.n), radius, _PENALTIES[1])
            there = program.at(at.tensions + change, at.point, tangential)
        if there is None or there.violation > at.violation / 2:
            return
        at = there
        yield at, None


@dataclass(frozen=True)
class Progress:
    """The least violation and effort of the attempts so far, up to factors that count.

    Attributes
    ----------
    violation, effort : float
    attempts : int
        Number of attempts since one of them decreased.
    """

    violation: float
    effort: float
    attempts: int = 0

    @classmethod
    def begin(cls, at: Constraints) -> Progress:
        """Return the progress at the start."""
        return cls(at.violation, float(np.linalg.norm(at.tensions)))

    def after(self, at: Constraints) -> Progress:
        """Return the progress after an attempt that ends at a point."""
        effort = float(np.linalg.norm(at.tensions))
        if at.violation > _BALANCED:
            is_progress = at.violation < _NEARER * self.violation
        else:
            is_progress = self.violation > _BALANCED or effort < _LIGHTER * self.effort
        return (
            Progress(at.violation, effort)
            if is_progress
            else replace(self, attempts=self.attempts + 1)
        )


@dataclass(frozen=True, eq=False)
class Step:
    """A step of least merit.

    Attributes
    ----------
    piece : Constraints
        The linearisation in which the step was found.
    change : (n,)
        Of the scaled tensions.
    tangential : (2 k,)
        The tangential forces after the step.
    multipliers : (m,)
        See Constraints.step.
    penalty : float
        Penalty of the violation.
    left : float
        Violation that remains.
    decrease : float
        Of the merit, by the linearisation and the Hessian.
    """

    piece: Constraints
    change: Array
    tangential: Array
    multipliers: Array
    penalty: float
    left: float
    decrease: float

    @property
    def multiplier(self) -> float:
        """The norm of the multipliers of the constraints whose violation is penalised."""
        return float(np.linalg.norm(self.multipliers[self.piece.violated]))


def best_step(at: Constraints, kinks: Kinks, hessian: Array, radius: Array, penalty: float) -> Step:
    """Return the step of the largest decrease of the merit in the smooth pieces within a radius.

    Raises UnsettledContactError if no step is found.
    """
    steps = list[Step]()
    for piece in pieces(at, kinks, radius):
        with suppress(UnsettledContactError):
            steps.append(steered(at, piece, hessian, radius, penalty))
    if not steps:
        raise UnsettledContactError(1.0, "no step is found")
    most = max(step.penalty for step in steps)
    return max(
        steps, key=lambda step: step.decrease + (most - step.penalty) * (at.violation - step.left)
    )


def steered(
    at: Constraints, piece: Constraints, hessian: Array, radius: Array, penalty: float
) -> Step:
    """Return the step of least merit in a piece, see Constraints.step, with its penalty.

    The penalty is the smallest for which the step removes most of the violation that the largest
    penalty would remove.
    Source: Byrd, Nocedal, Waltz, "Steering exact penalty methods for nonlinear programming",
    Optimization Methods and Software 23 (2008).
    """
    *_, least = piece.step(hessian, radius, _PENALTIES[1])
    while True:
        change, tangential, lam, left = piece.step(hessian, radius, penalty)
        if left <= least + (at.violation - least) / 10 or penalty >= _PENALTIES[1]:
            effort = float(at.tensions @ change + change @ hessian @ change / 2)
            decrease = penalty * (at.violation - left) - effort
            return Step(piece, change, tangential, lam, penalty, left, decrease)
        penalty *= 10


@dataclass(frozen=True, eq=False)
class Conditions:
    """The first-order conditions at a point.

    Attributes
    ----------
    residual : float
        Scaled size of the largest step, with the Hessian of the effort, of the pieces that contain
        the point.
    step : Step
        The best of these steps.
    kinks : Kinks
        The kinks nearby.
    reach : float
        Length of the last probe, in units of the tensions that bend the arm by 1 rad.
    beyond : Constraints or None
        A point of less merit in the direction of the step, found by a probe.
    """

    residual: float
    step: Step
    kinks: Kinks = ()
    reach: float = 0.0
    beyond: Constraints | None = None


def conditions(at: Constraints, kinks: Kinks = ()) -> Conditions:
    """Return the first-order conditions at a point; raises UnsettledContactError without a step."""
    n = at.tensions.size
    steps = list[tuple[float, Step]]()
    for piece in pieces(at, kinks, np.full(n, _NONE)):
        with suppress(UnsettledContactError):
            first = steered(at, piece, np.eye(n), np.ones(n), _PENALTIES[0])
            turned = replace(piece, tangential=first.tangential)
            step = steered(at, turned, np.eye(n), np.ones(n), first.penalty)
            scale = 1 + np.abs(step.multipliers).max()
            steps.append((float(np.abs(step.change).max() / scale), step))
    if not steps:
        raise UnsettledContactError(1.0, "no step is found")
    best = max((step for _, step in steps), key=attrgetter("decrease"))
    return Conditions(max(residual for residual, _ in steps), best, kinks)


def probed(program: TensionProgram, at: Constraints) -> Conditions:
    """Return the first-order conditions at a point that may be at kinks.

    The step is tried over a short distance. If the merit does not decrease as predicted, a kink
    lies between both points, and the conditions are those of the pieces on both sides.
    """
    natural = natural_tensions(program.problem.arm) / program.unit
    reach, kinks = _PROBE, Kinks()
    for _ in range(_PROBES):
        check_time()
        found = conditions(at, kinks)
        step = found.step
        size = float(np.abs(step.change / natural).max())
        if found.residual <= _NONE:
            break
        there, share = None, min(1.0, reach / size)
        with suppress(OctoplanError):
            there = program.at(at.tensions + share * step.change, at.point, step.tangential)
        if there is not None:
            penalty = _EXACT * max(step.penalty, step.multiplier)
            if at.merit(penalty) - there.merit(penalty) >= share * step.decrease / 4:
                return replace(found, reach=reach, beyond=there)
            kinks = with_kink(kinks, Kink.between(at, there))
        reach /= 4
    return found


def first_order(program: TensionProgram, at: Constraints) -> Optimality:
    """Return the first-order conditions at a point."""
    end = probed(program, at)
    if end.beyond is None:
        return Optimality(end.residual)
    saving = np.linalg.norm(at.tensions) - np.linalg.norm(at.tensions + end.step.change)
    return Optimality(end.residual, max(float(program.unit * saving), 0.0))
