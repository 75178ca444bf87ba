"""The program of a design: numbers of the arm and the tensions of all tasks, at once.

    least  1/2 sum over tasks |T|^2    such that every task is met, tensions keep to their limits,
                                       and the arm can be made

by sequential quadratic programming (SciPy's SLSQP), with exact first derivatives. Unknowns z: those
of the arm from 0 to 10 between their bounds, so that steps in them are short, then tensions over
the largest one that it begins with. The best point that meets all tasks is kept on the way.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from model.errors import OctoplanError
from model.paths import Array
from planner.design.making import Making
from planner.design.tasks import Missed, Targets, Tasks
from planner.program.limits import Limits
from planner.unknowns.parameters import Parameters

LOG = logging.getLogger(__name__)
_REFINEMENT, _TOLERANCE, _STEPS = 2, 1e-10, 200
# What every residual is said to be where there is no such arm, or it does not settle.
_NOWHERE = 10.0
# The residual up to which a task counts as met here; plans are held to their own accuracy.
_MET = 1e-7
_SPAN = 10.0


@dataclass(frozen=True, eq=False)
class Optimum:
    """Values (K,) of the unknowns, tensions (n_tasks, n_tendons) [N], steps taken.

    `missed` is the largest residual that is left, over the arm's length or in rad.
    """

    values: Array
    tensions: Array
    steps: int
    missed: float

    @property
    def cost(self) -> tuple[bool, float]:
        """What the best of several has least of: tasks that are not met, then effort."""
        lost = self.missed > _MET
        return lost, self.missed if lost else float(np.linalg.norm(self.tensions))


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
    ) -> None:
        self.parameters, self.making, self.limits = parameters, making, limits
        self.K, self.shape = len(parameters.unknowns), tensions.shape
        self.unit = max(float(tensions.max()), 1e-9)
        scaled = _SPAN * (values - parameters.lower) / parameters.range
        self.start = np.concatenate([scaled, tensions.ravel() / self.unit])
        self.tasks = Tasks(parameters, tasks, _REFINEMENT)
        self._at, self._missed = self.start, self.tasks.missed(*self.split(self.start))
        self._lost = False

    def split(self, z: Array) -> tuple[Array, Array]:
        """Return values (K,) and tensions (n_tasks, n_tendons) [N] of z."""
        of = self.parameters
        share = np.clip(z[: self.K] / _SPAN, 0.0, 1.0)
        T = np.maximum(self.unit * z[self.K :].reshape(self.shape), 0.0)
        return of.lower + of.range * share, T

    def solve(self) -> Optimum:
        """Return the optimum that the start leads to."""
        count = self.shape[0]
        lower, upper = (
            np.tile(own, count) / self.unit for own in (self.limits.lower, self.limits.upper)
        )
        bounds = [(0.0, _SPAN)] * self.K
        bounds += list(zip(lower.tolist(), upper.tolist(), strict=True))
        constraints = [
            {"type": "eq", "fun": self.match, "jac": self.match_slopes},
            {"type": "ineq", "fun": self.margin, "jac": self.margin_slopes},
            {"type": "ineq", "fun": self.room, "jac": self.room_slopes},
        ]
        seen = [self._optimum(self.start, 0)]
        found = minimize(
            self.effort,
            self.start,
            jac=self.effort_slopes,
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
        lacks = np.concatenate([np.abs(self.match(z)), -self.margin(z), -self.room(z), [0.0]])
        return Optimum(*self.split(z), steps, float(lacks.max()))

    def effort(self, z: Array) -> float:
        """Half the sum of all squared tensions, over the largest to begin with."""
        return float(z[self.K :] @ z[self.K :]) / 2

    def effort_slopes(self, z: Array) -> Array:
        """Its gradient."""
        return np.concatenate([np.zeros(self.K), z[self.K :]])

    def match(self, z: Array) -> Array:
        """Residuals of all tasks that have to be 0."""
        missed = self._seen(z)
        lost = _NOWHERE * self._lost
        return np.concatenate([own.match for own in missed]) + lost

    def margin(self, z: Array) -> Array:
        """Quantities of all tasks that have to be 0 or above."""
        return np.concatenate([own.margin for own in self._seen(z)])

    def match_slopes(self, z: Array) -> Array:
        """Derivatives of match."""
        return self._slopes(z, [slice(0, own.match.size) for own in self._seen(z)])

    def margin_slopes(self, z: Array) -> Array:
        """Derivatives of margin."""
        return self._slopes(z, [slice(own.match.size, None) for own in self._seen(z)])

    def room(self, z: Array) -> Array:
        """What is left to the limits of making."""
        return self._room_of(self.split(z)[0])

    def room_slopes(self, z: Array) -> Array:
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

    def _slopes(self, z: Array, rows: Sequence[slice]) -> Array:
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
