"""The program of a design: numbers of the arm and the tensions of all tasks, at once.

    least  1/2 sum over tasks |T|^2,   such that every task is met, tensions keep to their limits,
           or another objective        and the arm can be made

by sequential quadratic programming (SciPy's SLSQP), with exact first derivatives. Unknowns z: those
of the arm from 0 to 10 between their bounds, so that steps in them are short, then tensions over
the largest one that it begins with. The best point that meets all tasks is kept on the way.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from model.errors import OctoplanError
from model.paths import Array
from planner.design.making import Making
from planner.design.objective import Objective, Reach, Slopes, tip_along, tip_compliance
from planner.design.tasks import Missed, Targets, Tasks
from planner.program.limits import Limits
from planner.targets import Stiffest
from planner.unknowns.parameters import Parameters

LOG = logging.getLogger(__name__)
REFINEMENT, _TOLERANCE, _STEPS = 2, 1e-10, 200
# What every residual is said to be where there is no such arm, or it does not settle.
_NOWHERE = 10.0
# The residual up to which a task counts as met here; plans are held to their own accuracy.
_MET = 1e-7
_SPAN = 10.0


@dataclass(frozen=True, eq=False)
class Optimum:
    """Values (K,) of the unknowns, tensions (n_tasks, n_tendons) [N], steps taken.

    `missed` is the largest residual that is left, over the arm's length or in rad; `objective` is
    what is least.
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
        self.asked = objective
        self.K, self.shape = len(parameters.unknowns), tensions.shape
        self.unit = max(float(tensions.max()), 1e-9)
        scaled = _SPAN * (values - parameters.lower) / parameters.range
        self.start = np.concatenate([scaled, tensions.ravel() / self.unit])
        self.tasks = Tasks(parameters, tasks, REFINEMENT)
        self._at, self._missed = self.start, self.tasks.missed(*self.split(self.start))
        self._lost = False
        self._known: tuple[Array, list[tuple[int, float, Slopes]]] = (np.zeros(0), [])

    def split(self, z: Array) -> tuple[Array, Array]:
        """Return values (K,) and tensions (n_tasks, n_tendons) [N] of z."""
        of = self.parameters
        share = np.clip(z[: self.K] / _SPAN, 0.0, 1.0)
        T = np.maximum(self.unit * z[self.K :].reshape(self.shape), 0.0)
        return of.lower + of.range * share, T

    def solve(self, fixed: bool = False) -> Optimum:
        """Return the optimum that the start leads to, numbers of the arm `fixed` or not."""
        count = self.shape[0]
        lower, upper = (
            np.tile(own, count) / self.unit for own in (self.limits.lower, self.limits.upper)
        )
        bounds = [(x, x) if fixed else (0.0, _SPAN) for x in self.start[: self.K].tolist()]
        bounds += list(zip(lower.tolist(), upper.tolist(), strict=True))
        constraints = [
            {"type": "eq", "fun": self.equality, "jac": self.equality_jacobian},
            {"type": "ineq", "fun": self.inequality, "jac": self.inequality_jacobian},
            {"type": "ineq", "fun": self.room, "jac": self.room_jacobian},
        ]
        seen = [self._optimum(self.start, 0)]
        found = scipy.optimize.minimize(
            self.objective,
            self.start,
            jac=self.objective_jacobian,
            method="SLSQP",
            bounds=bounds,
            constraints=constraints,
            options={"maxiter": _STEPS, "ftol": _TOLERANCE},
            callback=lambda z: seen.append(self._optimum(z, len(seen))),
        )
        LOG.debug("design: %s after %d steps", found.message, found.nit)
        seen.append(self._optimum(found.x, int(found.nit)))
        return min(seen, key=lambda own: own.cost)

    def _optimum(self, z: Array, steps: int) -> Optimum:
        lacks = np.concatenate(
            [np.abs(self.equality(z)), -self.inequality(z), -self.room(z), [0.0]]
        )
        return Optimum(*self.split(z), steps, float(lacks.max()), self.objective(z))

    def objective(self, z: Array) -> float:
        """What is least: half the sum of all squared tensions, over the largest to begin with.

        Or the mean logarithm of compliances, or with a minus the reach over the arm's length.
        """
        if self.asked == "effort":
            return float(z[self.K :] @ z[self.K :]) / 2
        return sum(weight * self._told(own) for _, weight, own in self._wanted(z))

    def objective_jacobian(self, z: Array) -> Array:
        """Its gradient."""
        found = np.concatenate([np.zeros(self.K), z[self.K :] * (self.asked == "effort")])
        if self.asked == "effort":
            return found
        n = self.shape[1]
        for i, weight, own in self._wanted(z):
            each = weight * (1.0 if isinstance(self.asked, Reach) else 1 / own.value)
            found[: self.K] += each * own.by_numbers * self.parameters.range / _SPAN
            found[self.K + i * n : self.K + (i + 1) * n] += each * own.by_tensions * self.unit
        return found

    def _told(self, own: Slopes) -> float:
        return own.value if isinstance(self.asked, Reach) else float(np.log(own.value))

    def _wanted(self, z: Array) -> list[tuple[int, float, Slopes]]:
        """Return what the objective is of: shapes by number, their weights, and quantities."""
        if not np.array_equal(z, self._known[0]):
            self._seen(z)
            self._known = z.copy(), self._quantities()
        return self._known[1]

    def _quantities(self) -> list[tuple[int, float, Slopes]]:
        if isinstance(self.asked, Reach):
            last, length = self.shape[0] - 1, self.tasks.shape(0).here.system.arm.length
            along = np.array(self.asked.direction)
            return [(last, -1 / length, tip_along(self.tasks.shape(last), along))]
        assert not isinstance(self.asked, str)
        sign = 1.0 if isinstance(self.asked, Stiffest) else -1.0
        along, count = np.array(self.asked.direction), self.shape[0]
        shapes = [self.tasks.shape(i) for i in range(count)]
        return [(i, sign / count, tip_compliance(by, along)) for i, by in enumerate(shapes)]

    def equality(self, z: Array) -> Array:
        """Residuals of all tasks that have to be 0."""
        missed = self._seen(z)
        lost = _NOWHERE * self._lost
        return np.concatenate([own.equality for own in missed]) + lost

    def inequality(self, z: Array) -> Array:
        """Quantities of all tasks that have to be 0 or above."""
        return np.concatenate([own.inequality for own in self._seen(z)])

    def equality_jacobian(self, z: Array) -> Array:
        """Derivatives of the equalities."""
        return self._jacobian(z, [slice(0, own.equality.size) for own in self._seen(z)])

    def inequality_jacobian(self, z: Array) -> Array:
        """Derivatives of the inequalities."""
        return self._jacobian(z, [slice(own.equality.size, None) for own in self._seen(z)])

    def room(self, z: Array) -> Array:
        """What is left to the limits of making."""
        return self._room_of(self.split(z)[0])

    def room_jacobian(self, z: Array) -> Array:
        """Derivatives of room."""
        values = self.split(z)[0]
        found = np.zeros((self._room_of(values).size, z.size))
        for k, stencil in enumerate(self.parameters.stencils(values, "")):
            for near in stencil:
                found[:, k] += near.weight * self.making.room(near.arm)
        found[:, : self.K] *= self.parameters.range / _SPAN
        return found

    def _room_of(self, values: Array) -> Array:
        return self.making.room(self.parameters.built(values, "")[0])

    def _jacobian(self, z: Array, rows: Sequence[slice]) -> Array:
        n, blocks = self.shape[1], []
        for i, (own, part) in enumerate(zip(self._seen(z), rows, strict=True)):
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
