"""The program of a scene whose poses are an explicit function of the tensions.

In the paper's balance without loads strains are closed forms; as printed, eqs. (10) and (11) are
integrated from the tip to the base. The tensions are the only unknowns of the mechanics. Closed
forms are derived step by step, by kernels that may be compiled; those as printed as a whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from model.arm import Arm
from model.effects import Extension, PrintedStatics
from model.equilibrium.forward import Known
from model.forward import ExplicitMap, explicit_map
from model.machine.buffered import Buffered
from model.machine.compiled import kernels
from model.paths import Array
from model.scene import Scene
from model.stations import Counts
from model.unloaded.closed_form import ClosedForm, strain_function
from model.unloaded.condensed_steps import CondensedSteps
from model.unloaded.statics import closed_statics
from planner.avoidance.rows import Avoidance
from planner.program.program import Objective, Rows, split
from planner.program.reduced import Reduced
from planner.program.statement import Statement
from planner.targets.base import Target

# By stages of the elements: as printed, and in closed form.
_PRINTED = {1: "rk4", 2: "rk4", 3: "rk6"}
_CLOSED = {1: "magnus2", 2: "magnus4", 3: "magnus6"}


@dataclass(frozen=True, eq=False)
class Expressions:
    """A program in symbols, all SX or all MX: unknowns, parameters, values and derivatives.

    See program.Program.
    """

    x: Any
    p: Any
    f: Any
    g: Any
    gradient: Any
    jacobian: Any
    sigma: Any
    lam: Any
    hessian: Any


class Explicit:
    """Unknowns are tensions, peak, lack; parameters those of the objective, then the units."""

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        targets: tuple[Target, ...],
        statement: Statement,
        stations: tuple[float, ...],
        machine_code: bool = False,
    ) -> None:
        schemes = _PRINTED if scene.has(PrintedStatics) else _CLOSED
        mesh = (schemes[statement.stages], statement.refinement, stations)
        forward = explicit_map(arm, scene, *mesh)
        rows = _slimmest(arm, forward.stretch_at, forward.stretch_active) * scene.has(Extension)
        self.objective, n = Objective(arm, targets, statement, len(rows)), arm.n_tendons
        self.n_free = n + self.objective.n_peak + self.objective.n_lack
        self.sizes = (self.objective.n_numbers, n)
        nodes = [forward.mesh.node(s) for s in stations]
        if isinstance(forward, ClosedForm):
            steps = CondensedSteps(forward, nodes, machine_code)
            # What keeps clear changes its structure often: a compiler takes longer than it saves.
            compiled = machine_code and not any(isinstance(own, Avoidance) for own in targets)
            found = _by_steps(steps, self.objective, _stretch(forward, rows), compiled)
        else:
            found = _by_casadi(forward, self.objective, nodes, rows)
        self.x, self.p, self.f, self.g = found.x, found.p, found.f, found.g
        self.gradient, self.jacobian = found.gradient, found.jacobian
        self.sigma, self.lam, self.hessian = found.sigma, found.lam, found.hessian

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

    def forget(self, near: Known | None = None) -> None:
        """See Condensed.forget: nothing is kept."""

    @property
    def stands(self) -> bool:
        """See Condensed.stands: without loads nothing topples."""
        return True

    def apart(self) -> Explicit:
        """See Condensed.apart: there is no memory."""
        return self

    def first(self, a: Array, p: Array) -> Reduced:
        """See Condensed.first."""
        f, gradient, g, J = self._calls[1](a, p)
        return Reduced(a, float(f[0, 0]), gradient.ravel(), g.ravel(), J.T)

    def at(self, x: Array, p: Array) -> Reduced:
        """See Condensed.at: there are no other unknowns."""
        return self.first(x, p)

    def curvature(self, here: Reduced, p: Array, sigma: float, lam: Array) -> tuple[Array, Array]:
        """See Condensed.curvature."""
        return self.second(here.x, p, sigma, lam), np.zeros(self.n_free)

    def follow(self, here: Reduced, change: Array, p: Array) -> Array:
        """See Condensed.follow."""
        return here.x + change

    def second(self, a: Array, p: Array, sigma: float, lam: Array) -> Array:
        """See Condensed.second."""
        return self._calls[2](a, p, np.array([sigma]), lam)[0]

    def stability(self, x: Array, tensions: Array, near: Known | None = None) -> float:
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


def _by_steps(
    steps: CondensedSteps, objective: Objective, stretch: ca.Function, machine_code: bool
) -> Expressions:
    """Return the program of an objective that sees poses of a closed form, and its stretch."""
    n, n_free = steps.n, steps.n + objective.n_peak + objective.n_lack
    outer = _outer(objective, n, stretch)
    value, first, second = kernels(outer, machine_code)
    x, p = ca.MX.sym("x", n_free), ca.MX.sym("p", value.numel_in(1))
    unit = p[objective.n_numbers :]
    T = x[:n] * unit
    poses, slopes = steps.first(T)
    f, g = value(x, p, steps.poses(T))
    others = ca.MX(slopes.shape[0], n_free - n)
    across = ca.vertcat(ca.MX.eye(n_free), ca.horzcat(slopes @ ca.diag(unit), others))
    by_all, rows_by_all = first(x, p, poses)
    sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", g.numel())
    weights, hessian = second(x, p, poses, sigma, lam)
    bent = ca.diag(unit) @ steps.second(T, weights) @ ca.diag(unit)
    whole = across.T @ hessian @ across + ca.diagcat(bent, ca.MX(n_free - n, n_free - n))
    gradient, jacobian = across.T @ by_all, rows_by_all @ across
    return Expressions(x, p, f, g, gradient, jacobian, sigma, lam, ca.densify(whole))


def _outer(objective: Objective, n: int, stretch: ca.Function) -> tuple[ca.Function, ...]:
    """Return (x, p, poses) -> f, g; gradient of f, Jacobian of g, both in (x, poses).

    And, with sigma and lam, the Lagrangian's gradient in the poses (7, K), Hessian in (x, poses).
    """
    n_peak, n_numbers = objective.n_peak, objective.n_numbers
    x = ca.SX.sym("x", n + n_peak + objective.n_lack)
    p, poses = ca.SX.sym("p", n_numbers + n), ca.SX.sym("poses", 7, objective.terms.size2_in(0))
    T, last = x[:n] * p[n_numbers:], n + n_peak
    parts = (T, x[n:last], x[last:], p[:n_numbers], poses, stretch(T), ca.SX(0, 1))
    f, g = objective.function.expand().call(parts, True)
    y, sigma, lam = ca.vertcat(x, ca.vec(poses)), ca.SX.sym("sigma"), ca.SX.sym("lam", g.numel())
    hessian, gradient = ca.hessian(sigma * f + ca.dot(lam, g), y)
    weights = ca.reshape(ca.densify(gradient[x.numel() :]), *poses.shape)
    first = [ca.densify(ca.gradient(f, y)), ca.densify(ca.jacobian(g, y))]
    at, cse = [x, p, poses], {"cse": True}
    return (
        ca.Function("outer_value", at, [f, ca.densify(g)], cse),
        ca.Function("outer_first", at, first, cse),
        ca.Function("outer_second", [*at, sigma, lam], [weights, ca.densify(hessian)], cse),
    )


def _stretch(forward: ClosedForm, rows: list[int]) -> ca.Function:
    """Return tensions -> 1 + q (r,) at some places of a closed form."""
    T = ca.SX.sym("T", forward.arm.n_tendons)
    strain = strain_function(closed_statics(forward.scene, forward.arm))
    found = [
        1 + strain(ca.sparsify(ca.DM(forward.maps[i])) @ T, ca.DM(forward.data[i]))[3] for i in rows
    ]
    return ca.Function("stretch", [T], [ca.vertcat(ca.SX(0, 1), *found)], {"cse": True})


def _by_casadi(
    forward: ExplicitMap, objective: Objective, nodes: list[int], rows: list[int]
) -> Expressions:
    """Return the program of an objective that sees the poses at some nodes, derived as a whole."""
    n = forward.function.numel_in(0)
    sizes = (objective.n_numbers, n)
    x, p = ca.SX.sym("x", n + objective.n_peak + objective.n_lack), ca.SX.sym("p", sum(sizes))
    given, unit = split(p, sizes)
    T, last = x[:n] * unit, n + objective.n_peak
    poses, stretch = forward.function.expand()(T)[:2]
    least = stretch[rows].T if rows else ca.SX(0, 1)
    parts = (T, x[n:last], x[last:], given, poses[:, nodes], least, ca.SX(0, 1))
    f, g = objective.function.expand().call(parts, True)
    sigma, lam = ca.SX.sym("sigma"), ca.SX.sym("lam", g.numel())
    hessian = ca.hessian(sigma * f + ca.dot(lam, g), x)[0]
    return Expressions(x, p, f, g, ca.gradient(f, x), ca.jacobian(g, x), sigma, lam, hessian)


def _slimmest(arm: Arm, s: Array, active: Counts) -> list[int]:
    """Return, for each segment with tendons, where its body is slimmest and 1 + q least."""
    radius = arm.radius.evaluate(s, arm.length)[0]
    rows = []
    for count in np.unique(active[active > 0]):
        inside = np.flatnonzero(active == count)
        rows.append(int(inside[np.argmin(radius[inside])]))
    return rows
