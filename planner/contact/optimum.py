"""The optimum that a program of an arm in contact leads to, by a trust region."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from model.equilibrium.linearised import Linearised
from model.errors import OctoplanError
from model.paths import Array
from model.time_limit import check_time
from planner.contact.load_path import LoadPath
from planner.contact.program import Constraints, Step, TensionProgram
from planner.program.limits import natural_tensions

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
    step : Step
        The one that goes on from there, whose multipliers are those of the optimum.
    yields : bool
        Whether the stability that it is held to costs effort.
    load_path : LoadPath
        The tensions by which it was come to, without those it begins with and its own.
    """

    point: Linearised
    violation: float
    step: Step
    yields: bool
    load_path: LoadPath

    @property
    def is_optimal(self) -> bool:
        """Whether all is met, and tensions are least nearby."""
        return not self.violation and self.step.residual < 3 * _NONE

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
    at, step = path[-1], conditions(path[-1])
    violation = at.violation if at.violation > _NONE else 0.0
    load_path = tuple(tuple(each.point.tensions.tolist()) for each in path[1:-1])
    yields = program.least > 0 and step.lam_stability < -_NONE
    return ContactOptimum(at.point, violation, step, yields, load_path)


def _descended(program: TensionProgram, at: Constraints, penalty: float) -> list[Constraints]:
    """Return where steps lead from constraints: to the least merit by a penalty, or to a kink.

    A step fails where no shape is settled or the merit is above the last ones: the next is shorter.
    """
    natural = natural_tensions(program.task.arm) / program.unit
    hessian, radius, path = np.eye(program.n), _RADIUS, [at]
    for _ in range(_STEPS):
        check_time()
        step = at.step(hessian, radius * natural, penalty)
        size = float(np.abs(step.change / natural).max())
        if size < _NONE:
            break
        most = max(each.merit(penalty) for each in path[-_RECENT:]) + penalty * _ROUNDING
        there = None
        with suppress(OctoplanError):
            there = program.at(at.tensions + step.change, at.point, step.tangential)
        if there is None or there.merit(penalty) > most:
            radius = size / 4
            continue
        radius = max(radius, 2 * size)
        hessian, at = _updated(hessian, at, there, step), there
        path.append(at)
    return path[1:]


def conditions(at: Constraints) -> Step:
    """Return the step by the effort's Hessian: the less it is, the better first-order conditions.

    By a penalty that exceeds the multipliers, where violations can be met.
    """
    for penalty in _PENALTIES:
        step = at.step(np.eye(at.tensions.size), np.ones(at.tensions.size), penalty)
        at = replace(at, tangential=step.tangential)
        if np.abs(step.multipliers).max() < penalty / 2:
            break
    return step


def _updated(hessian: Array, at: Constraints, there: Constraints, step: Step) -> Array:
    """Return the Hessian of the Lagrangian after a step, by BFGS's formula as Powell damped it."""
    before, after, s = at.by_tensions, there.by_tensions, step.change
    if before.shape != after.shape:
        return np.eye(s.size)
    y = s - (after - before).T @ step.multipliers[2 * s.size :]
    Bs = hessian @ s
    curved, bent = s @ y, s @ Bs
    damped = 1.0 if curved >= 0.2 * bent else 0.8 * bent / (bent - curved)
    r = damped * y + (1 - damped) * Bs
    return np.asarray(hessian + np.outer(r, r) / (s @ r) - np.outer(Bs, Bs) / bent)
