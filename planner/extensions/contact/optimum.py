"""The optimum that a program of an arm in contact leads to, by a trust region."""

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
from octoplan.planner.extensions.contact.load_path import LoadPath
from octoplan.planner.extensions.contact.program import Constraints, TensionProgram
from octoplan.planner.limits import natural_tensions

# Steps at most, also those that fail; the first trust region, in tensions that bend by 1 rad.
_STEPS, _RADIUS = 100, 0.25
# The least and the largest penalty of violations: less of it lets a margin of stability, which is
# linear nearby alone, be violated again and again. Violations and steps that count as 0.
_PENALTIES, _NONE = (10.0, 1e5), 1e-7
# Merits are compared with the largest of so many.
_RECENT = 3


@dataclass(frozen=True, eq=False)
class ContactOptimum:
    """Where a program leads from an equilibrium.

    Attributes
    ----------
    point : Equilibrium
        The equilibrium.
    violation : float
        The norm of the violations; 0 where all are met.
    residual : float
        Of the first-order conditions, scaled.
    lam_x : (n_tendons,)
        The multipliers of limits, above 0 at the upper ones.
    lam_g : (0,) or (1,)
        That of the stability it is held to, where that costs effort.
    load_path : LoadPath
        The tensions by which it was come to, without those it begins with and its own.
    """

    point: Equilibrium
    violation: float
    residual: float
    lam_x: tuple[float, ...]
    lam_g: tuple[float, ...]
    load_path: LoadPath

    @property
    def is_optimal(self) -> bool:
        """Whether all is met, and tensions are least nearby."""
        return not self.violation and self.residual < 3 * _NONE

    @property
    def cost(self) -> tuple[float, bool, float]:
        """What is compared: violations, whether tensions are not least nearby, effort [N]."""
        return self.violation, not self.is_optimal, float(np.linalg.norm(self.point.tensions))


def optimum(
    program: TensionProgram, begin: Equilibrium, start: Array | None = None
) -> ContactOptimum:
    """Return the optimum that a program leads to from an equilibrium, or from other tensions.

    Where the constraints cannot be met from there, where they are violated least, or a kink; out of
    time, the last iterate. Raises what settling the start does.
    """
    at = program.at((begin.tensions if start is None else start) / program.unit, begin)
    path, n = [at], program.n
    with suppress(OutOfTime):
        for there in _iterates(program, at):
            path.append(there)
    at = path[-1]
    residual, lam = conditions(at)
    load_path = tuple(tuple(each.point.tensions.tolist()) for each in path[1:-1])
    above, below, (stability, *_) = np.split(lam, [n, 2 * n])
    lam_x, yields = tuple((above - below).tolist()), bool(program.least and stability > _NONE)
    violation, lam_g = at.violation * (at.violation > _NONE), (-float(stability),) * yields
    return ContactOptimum(at.point, violation, residual, lam_x, lam_g, load_path)


def _iterates(program: TensionProgram, at: Constraints) -> Iterator[Constraints]:
    """Yield where steps lead from constraints at tensions, until they are too short to count.

    A step fails where no shape is settled, or where the merit is above the largest of the last
    ones, as steps along curved constraints violate these a little; the next is shorter then.
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
    """Return the step of least merit, see Constraints.step, and the penalty that it is by.

    The least from one on by which most of the violations go that any penalty would take away.
    Source: Byrd, Nocedal, Waltz, "Steering exact penalty methods for nonlinear programming",
    Optimization Methods and Software 23 (2008).
    """
    *_, least = at.step(hessian, radius, _PENALTIES[1])
    while True:
        change, tangential, lam, left = at.step(hessian, radius, penalty)
        if left <= least + (at.violation - least) / 10 or penalty >= _PENALTIES[1]:
            return change, tangential, lam, penalty
        penalty *= 10


def conditions(at: Constraints) -> tuple[float, Array]:
    """Return how far the first-order conditions are from being met, and their multipliers.

    These are by the step with the effort's Hessian, as Constraints has them: the less it is, the
    better the conditions.
    """
    n = at.tensions.size
    change, tangential, *_, penalty = steered(at, np.eye(n), np.ones(n), _PENALTIES[0])
    change, _, lam, _ = replace(at, tangential=tangential).step(np.eye(n), np.ones(n), penalty)
    return float(np.abs(change).max() / (1 + np.abs(lam).max())), lam
