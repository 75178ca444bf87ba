"""Optima of programs of arms in contact, by a trust region."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import BFGS

from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.paths import Array
from octoplan.model.support.errors import OctoplanError
from octoplan.model.support.progress import OutOfTime, check_time
from octoplan.planner.certificate import Optimality
from octoplan.planner.extensions.contact.load_path import LoadPath
from octoplan.planner.extensions.contact.program import Constraints, TensionProgram
from octoplan.planner.limits import natural_tensions

# Largest number of steps, with failed steps.
_STEPS = 100
# First trust region, in units of the tensions that bend the arm by 1 rad.
_RADIUS = 0.25
# Smallest and largest penalty of violations. With smaller penalties the stability margin, whose
# linearisation holds only nearby, is violated again and again.
_PENALTIES = (10.0, 1e5)
# Violations and steps below this count as 0.
_NONE = 1e-7
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
    """

    point: Equilibrium
    violation: float
    residual: float
    lam_x: tuple[float, ...]
    lam_g: tuple[float, ...]
    load_path: LoadPath

    @property
    def is_optimal(self) -> bool:
        """Whether the constraints and the first-order conditions are met."""
        return not self.violation and self.residual < 3 * _NONE

    @property
    def cost(self) -> tuple[float, bool, float]:
        """The order of optima: violation, whether not optimal, effort [N]."""
        return self.violation, not self.is_optimal, float(np.linalg.norm(self.point.tensions))


def optimum(
    program: TensionProgram, begin: Equilibrium, start: Array | None = None
) -> ContactOptimum:
    """Return the optimum from an equilibrium, or from other tensions.

    If the constraints cannot be met from there, the result is a point of least violation, or a
    kink; if the time is over, the last iterate. Raises the errors of settling the start.
    """
    at = program.at((begin.tensions if start is None else start) / program.unit, begin)
    path, n = [at], program.n
    with suppress(OutOfTime):
        for there in _iterates(program, at):
            path.append(there)
    at = path[-1]
    residual, lam, _ = conditions(at)
    load_path = tuple(tuple(each.point.tensions.tolist()) for each in path[1:-1])
    above, below, (stability, *_) = np.split(lam, [n, 2 * n])
    lam_x, yields = tuple((above - below).tolist()), bool(program.least and stability > _NONE)
    violation, lam_g = at.violation * (at.violation > _NONE), (-float(stability),) * yields
    return ContactOptimum(at.point, violation, residual, lam_x, lam_g, load_path)


def _iterates(program: TensionProgram, at: Constraints) -> Iterator[Constraints]:
    """Yield the constraints after each step, until steps are too short to count.

    A step fails if the shape does not settle, or if the merit exceeds the largest recent merit:
    steps along curved constraints violate the constraints a little. The next step is then shorter.
    """
    natural, n = natural_tensions(program.task.arm) / program.unit, program.n
    radius, penalty, recent = _RADIUS, _PENALTIES[0], [at]
    # The effort's, to be updated to that of the Lagrangian.
    hessian = BFGS("damp_update", init_scale=1.0)
    hessian.initialize(n, "hess")
    for _ in range(_STEPS):
        check_time()
        region = hessian.get_matrix(), radius * natural
        # A penalty larger than is needed would keep steps as short as constraints are straight.
        least = max(penalty / 10, _PENALTIES[0])
        change, tangential, lam, penalty = steered(at, *region, least)
        size = float(np.abs(change / natural).max())
        if size < _NONE:
            break
        most = max(each.merit(penalty) for each in recent) + penalty * _NONE / 1e3
        longer, radius, there = max(radius, 2 * size), size / 4, None
        with suppress(OctoplanError):
            there = program.at(at.tensions + change, at.point, tangential)
        if there is None or there.merit(penalty) > most:
            continue
        if there.by_tensions.shape == at.by_tensions.shape:
            slope = (there.by_tensions - at.by_tensions).T @ lam[2 * n :]
            hessian.update(there.tensions - at.tensions, there.tensions - at.tensions - slope)
        at, radius, recent = there, longer, [*recent[1 - _RECENT :], there]
        yield at


def steered(
    at: Constraints, hessian: Array, radius: Array, penalty: float
) -> tuple[Array, Array, Array, float]:
    """Return the step of least merit, see Constraints.step, and its penalty.

    The penalty is the smallest for which the step removes most of the violation that the largest
    penalty would remove.
    Source: Byrd, Nocedal, Waltz, "Steering exact penalty methods for nonlinear programming",
    Optimization Methods and Software 23 (2008).
    """
    *_, least = at.step(hessian, radius, _PENALTIES[1])
    while True:
        change, tangential, lam, left = at.step(hessian, radius, penalty)
        if left <= least + (at.violation - least) / 10 or penalty >= _PENALTIES[1]:
            return change, tangential, lam, penalty
        penalty *= 10


def conditions(at: Constraints) -> tuple[float, Array, Array]:
    """Return the residual of the first-order conditions, the multipliers, and the step (n,).

    The residual is the size of the step with the Hessian of the effort; see Constraints.step.
    """
    n = at.tensions.size
    change, tangential, *_, penalty = steered(at, np.eye(n), np.ones(n), _PENALTIES[0])
    change, _, lam, _ = replace(at, tangential=tangential).step(np.eye(n), np.ones(n), penalty)
    return float(np.abs(change).max() / (1 + np.abs(lam).max())), lam, change


def first_order(program: TensionProgram, at: Constraints) -> Optimality:
    """Return the residual of the first-order conditions, and the effort that the step saves [N]."""
    residual, _, change = conditions(at)
    saving = np.linalg.norm(at.tensions) - np.linalg.norm(at.tensions + change)
    return Optimality(residual, max(float(program.unit * saving), 0.0))
