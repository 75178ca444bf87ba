"""The program of a scene whose poses are an explicit function of the tensions.

In the paper's balance without loads strains are closed forms; as printed, eqs. (10) and (11) are
integrated from the tip to the base. The tensions are the only unknowns of the mechanics.
"""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from model.arm import Arm
from model.effects import Extension, PrintedStatics
from model.forward import explicit_map
from model.machine.buffered import Buffered
from model.paths import Array
from model.scene import Scene
from model.stations import Counts
from planner.program.condensed import First
from planner.program.program import Objective, Rows, split
from planner.program.statement import Statement
from planner.targets.base import Target

# By stages of the elements: as printed, and in closed form.
_PRINTED = {1: "rk4", 2: "rk4", 3: "rk6"}
_CLOSED = {1: "magnus2", 2: "magnus4", 3: "magnus6"}


class Explicit:
    """Unknowns are tensions, peak, lack; parameters those of the objective, then the units."""

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        targets: tuple[Target, ...],
        statement: Statement,
        stations: tuple[float, ...],
    ) -> None:
        schemes = _PRINTED if scene.has(PrintedStatics) else _CLOSED
        mesh = (schemes[statement.stages], statement.refinement, stations)
        forward = explicit_map(arm, scene, *mesh)
        rows = _slimmest(arm, forward.stretch_at, forward.stretch_active) * scene.has(Extension)
        self.objective = Objective(arm, targets, statement, len(rows))
        n = arm.n_tendons
        self.n_free = n + self.objective.n_peak + self.objective.n_lack
        self.sizes = (self.objective.n_numbers, n)
        self.x, self.p = ca.SX.sym("x", self.n_free), ca.SX.sym("p", sum(self.sizes))
        given, unit = split(self.p, self.sizes)
        T, last = self.x[:n] * unit, n + self.objective.n_peak
        poses, stretch = forward.function.expand()(T)[:2]
        seen = poses[:, [forward.mesh.node(s) for s in stations]]
        least = stretch[rows].T if rows else ca.SX(0, 1)
        parts = (T, self.x[n:last], self.x[last:], given, seen, least, ca.SX(0, 1))
        self.f, self.g = self.objective.function.expand().call(parts, True)
        self.sigma, self.lam = ca.SX.sym("sigma"), ca.SX.sym("lam", self.g.numel())
        self.gradient, self.jacobian = ca.gradient(self.f, self.x), ca.jacobian(self.g, self.x)
        self.hessian = ca.hessian(self.sigma * self.f + ca.dot(self.lam, self.g), self.x)[0]

    @property
    def rows(self) -> tuple[Rows, ...]:
        """What the rows of the constraints are, in order."""
        return self.objective.rows

    @property
    def program(self) -> Explicit:
        """The program: what is explicit has no mechanics apart from it."""
        return self

    @property
    def condensed(self) -> Explicit:
        """The same: there are no states."""
        return self

    def numbers(self, target: Array) -> Array:
        """Return the parameters of the mechanics: none."""
        return np.zeros(0)

    @cached_property
    def first_function(self) -> ca.Function:
        """x, p -> f, gradient, g, Jacobian."""
        found = [ca.densify(v) for v in (self.f, self.gradient, self.g, self.jacobian)]
        return ca.Function("first", [self.x, self.p], found)

    @cached_property
    def second_function(self) -> ca.Function:
        """x, p, sigma, lam -> Hessian."""
        given = [self.x, self.p, self.sigma, self.lam]
        return ca.Function("second", given, [ca.densify(self.hessian)])

    @cached_property
    def _calls(self) -> tuple[Buffered, Buffered, Buffered]:
        """The value, the first derivatives and the Hessian, called without overhead."""
        value = ca.Function("value", [self.x, self.p], [self.f, ca.densify(self.g)])
        return Buffered(value), Buffered(self.first_function), Buffered(self.second_function)

    def value(self, a: Array, p: Array) -> tuple[float, Array]:
        """Return objective and constraints."""
        f, g = self._calls[0](a, p)
        return float(f[0, 0]), g.ravel()

    def values(self, x: Array, p: Array) -> Array:
        """Return the constraints at unknowns x."""
        return self.first(x, p).g

    def multipliers(self, a: Array, p: Array, lam_x: Array, lam_g: Array) -> tuple[Array, Array]:
        """See Condensed.multipliers: there are no states."""
        return lam_x, lam_g

    def forget(self) -> None:
        """See Condensed.forget: nothing is kept."""

    def first(self, a: Array, p: Array) -> First:
        """See Condensed.first."""
        f, gradient, g, J = self._calls[1](a, p)
        return First(float(f[0, 0]), gradient.ravel(), g.ravel(), J.T)

    def second(self, a: Array, p: Array, sigma: float, lam: Array) -> Array:
        """See Condensed.second."""
        return self._calls[2](a, p, np.array([sigma]), lam)[0]

    def stability(self, x: Array, tensions: Array) -> float:
        """See Collocated.stability: nothing topples without loads."""
        return np.inf

    def moved_by_loads(self, tensions: Array) -> float:
        """See Collocated.moved_by_loads: there are none."""
        return 0.0

    def unknowns(self, a: Array, tensions: Array, p: Array) -> Array:
        """Return all unknowns: those before the states, where there are none."""
        lack = self.objective.n_lack
        if lack:
            g = self.first(a, p).g
            a[self.n_free - lack :] = np.maximum(-g[self.objective.lack_rows], 0.0)
        return a


def _slimmest(arm: Arm, s: Array, active: Counts) -> list[int]:
    """Return, for each segment with tendons, where its body is slimmest and 1 + q least."""
    radius = arm.radius.evaluate(s, arm.length)[0]
    rows = []
    for count in np.unique(active[active > 0]):
        inside = np.flatnonzero(active == count)
        rows.append(int(inside[np.argmin(radius[inside])]))
    return rows
