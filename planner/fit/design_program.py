"""The program of a design: numbers of the arm and the tensions of all tasks, at once.

    least  1/2 sum over tasks |T|^2,   such that every task is met, tensions keep to their limits,
           or another objective        and the arm can be made

by sequential quadratic programming (SciPy's SLSQP), with exact first derivatives through the
equilibria of the tasks' shapes. Unknowns z: those of the arm from 0 to 10 between their bounds, so
that steps in them are short, then tensions over the largest one that it begins with. The best point
that meets all tasks is kept on the way.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy

from model import Arm
from model.equilibrium.by_numbers import ByNumbers
from model.equilibrium.forward import STAGES
from model.errors import OctoplanError
from model.paths import Array
from model.time_limit import check_time
from planner.fit.equilibria import Equations
from planner.fit.making import Making, Objective, Reach, tip_along, tip_compliance
from planner.fit.unknowns import Parameters
from planner.plan import Plan
from planner.program.limits import Limits
from planner.program.terms import stations_of, terms_function
from planner.targets import Stiffest
from planner.targets.base import Target

LOG = logging.getLogger(__name__)
Targets = tuple[Target, ...]
_REFINEMENT, _TOLERANCE, _STEPS, _SPAN = 2, 1e-10, 200, 10.0
# What every residual is said to be where there is no such arm, or it does not settle.
_NOWHERE = 10.0
# The residual up to which a task counts as met here; plans are held to their own accuracy.
_MET = 1e-7
# Tensions nearer to a limit than this, over the largest, and inequalities below are held.
_ACTIVE = 1e-6


class Missed(NamedTuple):
    """What a task misses: m residuals that have to be 0, then k that have to be 0 or above.

    Lengths over L, angles in rad; with derivatives by tensions (m + k, n_tendons) and by the
    unknowns (m + k, K).
    """

    m: int
    rows: Array
    by_tensions: Array
    by_numbers: Array


class Tasks:
    """Tasks of an arm, and the shapes in which they were looked at last."""

    def __init__(self, parameters: Parameters, tasks: Sequence[Targets]) -> None:
        self.parameters, self.tasks = parameters, tuple(tasks)
        self._equations = Equations(parameters, "", self._stations, _REFINEMENT, STAGES)
        self.values = parameters.start
        self.shapes: list[ByNumbers] = []

    def _stations(self, arm: Arm, _: dict[str, Any]) -> Array:
        return np.array([s for targets in self.tasks for s in stations_of(arm, targets)])

    def missed(self, values: Array, tensions: Array) -> list[Missed]:
        """Return what each task misses at values (K,) and tensions (n_tasks, n_tendons).

        Raises InputError where there is no such arm, and what `settle` raises.
        """
        check_time()
        setting = self._equations.at(values)
        heres = list(setting.near(tensions, self.shapes, values - self.values))
        lost = [i for i in range(len(self.tasks)) if i >= len(heres) or heres[i] is None]
        again = dict(zip(lost, setting.from_rest(tensions[lost]), strict=True)) if lost else {}
        reached = []
        for i in range(len(self.tasks)):
            here = again[i] if i in again else heres[i]
            if here is None or isinstance(here, OctoplanError):
                raise here or OctoplanError("it jumps")
            reached.append(here)
        nothing = [np.zeros((tensions.shape[1], len(values)))] * len(reached)
        self.values, self.shapes = values, setting.differentiated(reached, nothing)
        poses = setting.poses(reached)
        by_numbers = setting.pose_derivatives(self.shapes)
        rows, first = [], 0
        for i, (targets, by) in enumerate(zip(self.tasks, self.shapes, strict=True)):
            own = slice(first, first + len(stations_of(setting.system.arm, targets)))
            first = own.stop
            by_tensions = by.here.by_tensions[setting.places[own]]
            rows.append(
                _missed(setting.system.arm, targets, poses[i, own], by_tensions, by_numbers[i, own])
            )
        return rows


def _missed(arm: Arm, targets: Targets, poses: Array, by_T: Array, by_numbers: Array) -> Missed:
    """Return what targets miss of poses (S, 7) with derivatives by tensions and numbers."""
    by_T, by_numbers = (own.reshape(-1, own.shape[-1]) for own in (by_T, by_numbers))
    if not targets:
        return Missed(0, np.zeros(0), by_T, by_numbers)
    numbers = np.concatenate([target.parameters(arm) for target in targets])
    equality, inequality, jacobian = (np.array(v) for v in _terms(arm, targets)(poses.T, numbers))
    rows = np.concatenate([equality.ravel(), inequality.ravel()])
    return Missed(equality.size, rows, jacobian @ by_T, jacobian @ by_numbers)


@lru_cache(maxsize=256)
def _terms(arm: Arm, targets: Targets) -> ca.Function:
    """Return poses (7, S), numbers -> equality, inequality, and their derivatives by the poses."""
    terms = terms_function(arm, targets)
    poses, numbers = ca.MX.sym("poses", *terms.size_in(0)), ca.MX.sym("p", terms.size1_in(1))
    equality, _, inequality, _ = terms(poses, numbers, ca.DM(0, 1))
    jacobian = ca.jacobian(ca.vertcat(equality, inequality), ca.vec(poses))
    return ca.Function("missed", [poses, numbers], [equality, inequality, ca.densify(jacobian)])


@dataclass(frozen=True, eq=False)
class Optimum:
    """Values (K,) of the unknowns, tensions (n_tasks, n_tendons) [N], steps taken.

    `missed` is the largest residual that is left, over the arm's length or in rad; `objective` is
    what is least: half the sum of squared tensions [N2], the mean logarithm of compliances, or with
    a minus the reach over the arm's length.
    """

    values: Array
    tensions: Array
    steps: int
    missed: float
    objective: float

    @property
    def cost(self) -> tuple[bool, float]:
        """What the best of several has least of: tasks that are not met, then the objective."""
        lost = self.missed > _MET
        return lost, self.missed if lost else self.objective


class Program:
    """The functions that SLSQP asks for; shapes are settled once for each z."""

    def __init__(
        self,
        parameters: Parameters,
        tasks: Sequence[Targets],
        limits: Limits,
        making: Making,
        values: Array,
        tensions: Array,
        objective: Objective = "effort",
    ) -> None:
        self.parameters, self.making, self.limits = parameters, making, limits
        self.wanted = objective
        self.K, self.shape = len(parameters.unknowns), tensions.shape
        self.unit = max(float(tensions.max()), 1e-9)
        scaled = _SPAN * parameters.shares(values)
        self.start = np.concatenate([scaled, tensions.ravel() / self.unit])
        self.tasks = Tasks(parameters, tasks)
        self._at, self._missed = self.start, self.tasks.missed(*self.split(self.start))
        self._lost = False
        self._told: tuple[Array, float, Array] = (np.zeros(0), 0.0, np.zeros(0))

    def split(self, z: Array) -> tuple[Array, Array]:
        """Return values (K,) and tensions (n_tasks, n_tendons) [N] of z."""
        shares = np.clip(z[: self.K] / _SPAN, 0.0, 1.0)
        T = np.maximum(self.unit * z[self.K :].reshape(self.shape), 0.0)
        return self.parameters.from_shares(shares), T

    def solve(self, fixed: bool = False) -> Optimum:
        """Return the optimum that the start leads to, numbers of the arm `fixed` or not."""
        lower, upper = (
            np.tile(own, self.shape[0]) / self.unit
            for own in (self.limits.lower, self.limits.upper)
        )
        bounds = [(x, x) if fixed else (0.0, _SPAN) for x in self.start[: self.K].tolist()]
        bounds += list(zip(lower.tolist(), upper.tolist(), strict=True))
        constraints = [
            {"type": "eq", "fun": self.equality, "jac": self.equality_jacobian},
            {"type": "ineq", "fun": self.inequality, "jac": self.inequality_jacobian},
        ]
        seen = [self._optimum(self.start, 0)]
        solution = scipy.optimize.minimize(
            self.objective,
            self.start,
            jac=self.objective_jacobian,
            method="SLSQP",
            bounds=bounds,
            constraints=constraints,
            options={"maxiter": _STEPS, "ftol": _TOLERANCE},
            callback=lambda z: seen.append(self._optimum(z, len(seen))),
        )
        LOG.debug("design: %s after %d steps", solution.message, solution.nit)
        seen.append(self._optimum(solution.x, int(solution.nit)))
        return min(seen, key=lambda own: own.cost)

    def _optimum(self, z: Array, steps: int) -> Optimum:
        rows = [np.abs(self.equality(z)), -self.inequality(z), np.zeros(1)]
        missed = float(np.concatenate(rows).max())
        value = self.objective(z) * (self.unit**2 if self.wanted == "effort" else 1.0)
        return Optimum(*self.split(z), steps, missed, value)

    def objective(self, z: Array) -> float:
        """What is least: half the sum of all squared tensions, over the largest to begin with.

        Or the mean logarithm of compliances, or with a minus the reach over the arm's length.
        """
        return self._objective(z)[0]

    def objective_jacobian(self, z: Array) -> Array:
        """Its gradient."""
        return self._objective(z)[1]

    def _objective(self, z: Array) -> tuple[float, Array]:
        if self.wanted == "effort":
            T = z[self.K :]
            return float(T @ T) / 2, np.concatenate([np.zeros(self.K), T])
        if not np.array_equal(z, self._told[0]):
            self._seen(z)
            value, gradient = 0.0, np.zeros(z.size)
            along, (count, n) = np.array(self.wanted.direction), self.shape
            for i, by in enumerate(self.tasks.shapes):
                if isinstance(self.wanted, Reach):
                    if i < count - 1:
                        continue
                    own, each = tip_along(by, along), -1 / by.here.system.arm.length
                    value += each * own.value
                else:
                    own, sign = tip_compliance(by, along), isinstance(self.wanted, Stiffest)
                    each = (1 if sign else -1) / count / own.value
                    value += each * own.value * float(np.log(own.value))
                gradient[: self.K] += each * own.by_numbers * self.parameters.range / _SPAN
                first = self.K + i * n
                gradient[first : first + n] += each * own.by_tensions * self.unit
            self._told = z.copy(), value, gradient
        return self._told[1:]

    def equality(self, z: Array) -> Array:
        """Residuals of all tasks that have to be 0."""
        rows = np.concatenate([own.rows[: own.m] for own in self._seen(z)])
        return rows + _NOWHERE * self._lost

    def inequality(self, z: Array) -> Array:
        """Quantities of all tasks that have to be 0 or above, then what is left to the making."""
        values = self.split(z)[0]
        return np.concatenate([*(own.rows[own.m :] for own in self._seen(z)), *self._room(values)])

    def equality_jacobian(self, z: Array) -> Array:
        """Derivatives of the equalities."""
        return self._jacobian(z, [slice(0, own.m) for own in self._seen(z)])

    def inequality_jacobian(self, z: Array) -> Array:
        """Derivatives of the inequalities."""
        (room,) = self.parameters.derivatives(self._room, self.split(z)[0])
        room = np.hstack(
            [room * self.parameters.range / _SPAN, np.zeros((len(room), z.size - self.K))]
        )
        return np.vstack([self._jacobian(z, [slice(own.m, None) for own in self._seen(z)]), room])

    def _room(self, values: Array) -> list[Array]:
        return [self.making.room(self.parameters.built(values)[0])]

    def _jacobian(self, z: Array, parts: Sequence[slice]) -> Array:
        n, blocks = self.shape[1], []
        for i, (own, part) in enumerate(zip(self._seen(z), parts, strict=True)):
            by_numbers = own.by_numbers[part] * self.parameters.range / _SPAN
            block = np.zeros((len(by_numbers), z.size))
            block[:, : self.K] = by_numbers
            block[:, self.K + i * n : self.K + (i + 1) * n] = own.by_tensions[part] * self.unit
            blocks.append(block)
        return np.vstack(blocks)

    def _seen(self, z: Array) -> list[Missed]:
        """Return what tasks miss at z; where nothing settles, what they missed last."""
        if not np.array_equal(z, self._at):
            self._at = z.copy()
            try:
                self._missed, self._lost = self.tasks.missed(*self.split(z)), False
            except OctoplanError:
                self._lost = True
        return self._missed


def effort_jacobian(parameters: Parameters, values: Array, plans: Sequence[Plan]) -> Array:
    """Return the derivatives (K,) of the root of the sum of squared efforts by the unknowns.

    With every task's tensions chosen anew, half the sum of the squared tensions changes with a
    number p of the arm by the multipliers lambda of the tasks: d/dp = lambda . d(residuals)/dp,
    where T + lambda . d(residuals)/dT = 0 for all tensions within their limits. Source: Fiacco,
    "Introduction to Sensitivity and Stability Analysis in Nonlinear Programming" (1983), 3.4.1.
    """
    T = np.array([np.ravel(own.tensions) for own in plans])
    missed = Tasks(parameters, [own.targets for own in plans]).missed(values, T)
    jacobian = np.zeros(len(values))
    for own, tensions, task in zip(plans, T, missed, strict=True):
        lower, upper = np.array(own.limits.lower), np.array(own.limits.upper)
        free = np.minimum(tensions - lower, upper - tensions) > _ACTIVE * max(tensions.max(), 1e-12)
        held = (np.arange(len(task.rows)) < task.m) | (task.rows <= _ACTIVE)
        by_free = task.by_tensions[held][:, free]
        multipliers = np.linalg.lstsq(by_free.T, -tensions[free], rcond=None)[0]
        jacobian += task.by_numbers[held].T @ multipliers
    return jacobian / max(float(np.linalg.norm(T)), 1e-300)
