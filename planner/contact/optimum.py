"""The optimum that a program of an arm in contact leads to, by a trust region."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import BFGS

from model.equilibrium.linearised import Linearised
from model.errors import OctoplanError
from model.paths import Array
from model.time_limit import check_time
from planner.contact.load_path import LoadPath
from planner.contact.program import Constraints, TensionProgram
from planner.question import natural_tensions

# Steps at most, also those that fail; the first trust region, in tensions that bend by 1 rad.
_STEPS, _RADIUS = 60, 0.25
# Penalties of violations, one after the other; violations and steps that count as 0, and the
# rounding of violations.
_PENALTIES, _NONE, _ROUNDING = (1e1, 1e3, 1e5), 1e-7, 1e-10
# Merits are compared with the largest of so many.
_RECENT = 3


@dataclass(frozen=True, eq=False)
class ContactOptimum:
    """Where a program leads from an equilibrium.

    Attributes
    ----------
    point : Linearised
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

    point: Linearised
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
    def effort(self) -> float:
        """The norm of its tensions [N]."""
        return float(np.linalg.norm(self.point.tensions))


def optimum(
    program: TensionProgram, begin: Linearised, start: Array | None = None
) -> ContactOptimum:
    """Return the optimum that a program leads to from an equilibrium, or from other tensions.

    Where the constraints cannot be met from there, where they are violated least. Raises what
    settling the start does.
    """
    path = [program.at((begin.tensions if start is None else start) / program.unit, begin)]
    for penalty in _PENALTIES:
        path += _descended(program, path[-1], penalty)
        if path[-1].violation < _NONE:
            break
    at, (residual, lam) = path[-1], conditions(path[-1])
    load_path = tuple(tuple(each.point.tensions.tolist()) for each in path[1:-1])
    above, below, (stability, *_) = np.split(lam, [program.n, 2 * program.n])
    lam_x, yields = tuple((above - below).tolist()), bool(program.least and stability > _NONE)
    violation, lam_g = at.violation * (at.violation > _NONE), (-float(stability),) * yields
    return ContactOptimum(at.point, violation, residual, lam_x, lam_g, load_path)


def _descended(program: TensionProgram, at: Constraints, penalty: float) -> list[Constraints]:
    """Return where steps lead from constraints: to the least merit by a penalty, or to a kink.

    A step fails where no shape is settled or the merit is above the last ones: the next is shorter.
    """
    natural, n = natural_tensions(program.task.arm) / program.unit, program.n
    hessian, radius, path = _hessian(n), _RADIUS, [at]
    for _ in range(_STEPS):
        check_time()
        change, tangential, lam = at.step(hessian.get_matrix(), radius * natural, penalty)
        size = float(np.abs(change / natural).max())
        if size < _NONE:
            break
        most = max(each.merit(penalty) for each in path[-_RECENT:]) + penalty * _ROUNDING
        longer, radius = max(radius, 2 * size), size / 4
        with suppress(OctoplanError):
            there = program.at(at.tensions + change, at.point, tangential)
            if there.merit(penalty) <= most:
                before, after = at.by_tensions, there.by_tensions
                if before.shape == after.shape:
                    hessian.update(change, change - (after - before).T @ lam[2 * n :])
                else:
                    hessian = _hessian(n)
                at, radius = there, longer
                path.append(at)
    return path[1:]


def _hessian(n: int) -> BFGS:
    """Return the effort's Hessian (n, n), to be updated to that of the Lagrangian."""
    hessian = BFGS("damp_update", init_scale=1.0)
    hessian.initialize(n, "hess")
    return hessian


def conditions(at: Constraints) -> tuple[float, Array]:
    """Return how far the first-order conditions are from being met, and their multipliers.

    These are by the step with the effort's Hessian, as Constraints has them: the less it is, the
    better the conditions. By a penalty that exceeds the multipliers, where violations can be met.
    """
    n = at.tensions.size
    for penalty in _PENALTIES:
        change, tangential, lam = at.step(np.eye(n), np.ones(n), penalty)
        at, largest = replace(at, tangential=tangential), np.abs(lam).max()
        if largest < penalty / 2:
            break
    return float(np.abs(change).max() / (1 + largest)), lam
