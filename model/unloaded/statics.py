"""The strains of a cross-section without loads, in closed form, by the laws of model.cross_section.

Without loads the wrench of body and tendons vanishes, so that each cross-section is in equilibrium
by itself and none is twisted: its strains follow from the tensions alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import casadi as ca
import numpy as np

from model.anchorage import Material
from model.arm import Arm
from model.cross_section import cross_section_of
from model.cross_section.energy import EnergySection, RubberSection
from model.cross_section.law import TINY, join, less_rest
from model.cross_section.paper import PaperSection, resultants
from model.paths import Array
from model.rotations import norm
from model.scene import Scene
from model.stations import Stations, crossing, resists, sides, tendon_offsets

# Where the strains are to be an expression of the tensions, so many steps are written out: enough
# for ordinary ones. Numbers take as many as they need; see model.unloaded.sections.
_STEPS = 10
# The energy of a neo-Hookean body is not convex everywhere: the least pivot of its Hessian that a
# step is taken with, over the body's stiffness at rest. That of a linear body is convex, and at
# least as stiff as without tendons.
_LEAST = 1e-3
# What of its stretch a step may take from a neo-Hookean body, add to it, and bend it by (curvature
# times radius): 4 to 7 steps do where an arm curls up, 30 at a thousand times that tension.
_SHRINKS, _GROWS, _BENDS = 0.3, 2.0, 1.0


@dataclass(frozen=True)
class EnergyStatics:
    """The balance of a cross-section with an energy, as SX expressions of numbers of it.

    These are `pull` (n_pull,), linear in the tensions: here the tensions themselves; and `data`
    (n_data,) of body and tendon paths: E A, E J and G I first, then curvature at rest about n and
    b, if there is any, then the offsets y_i and y_i'.

    Attributes
    ----------
    law : EnergySection
    row, cos, sin
        Which of the offsets y_i each tendon has, and its direction (n, b).
    settled : float
        A section is in equilibrium where the last step is below it, relative to its strains.
    is_explicit : bool
        Whether strains are a short expression of pull and data.
    """

    law: EnergySection
    row: tuple[int, ...]
    cos: tuple[float, ...]
    sin: tuple[float, ...]
    settled: float = 1e-9
    is_explicit: ClassVar[bool] = False

    @property
    def n_pull(self) -> int:
        """The size of pull: a tension for each tendon."""
        return len(self.row)

    @property
    def n_data(self) -> int:
        """The size of data."""
        return self._first + 2 * (max(self.row) + 1)

    @property
    def _first(self) -> int:
        """Place of the offsets among the data."""
        return 3 + 2 * self.law.curved

    @property
    def is_rubber(self) -> bool:
        """Whether the section shrinks as it stretches."""
        return isinstance(self.law, RubberSection)

    def pulls(self, arm: Arm, at: Stations) -> Array:
        """Return maps (N, n_pull, n_tendons) from tensions to pull: 1 for a tendon that crosses."""
        return np.asarray(crossing(arm, at)[:, :, None] * np.eye(arm.n_tendons))

    def data(self, material: Material, at: Stations) -> Array:
        """Return data (N, n_data)."""
        parts = resists(material, at.area), at.rest, at.y, at.y_rate
        return np.ascontiguousarray(np.vstack(parts).T)

    def offset(self, j: int, data: ca.SX) -> ca.SX:
        """Return the offset of tendon j and its derivative (2,)."""
        i = self._first + self.row[j]
        return ca.vertcat(data[i], data[i + (self.n_data - self._first) // 2])

    def wrench(self, v: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return the wrench of body and tendons at strains v, which vanishes without loads.

        It is the gradient of the energy.
        """
        result = self.law.body(v, self._body(data))
        for j, side in enumerate(zip(self.cos, self.sin, strict=True)):
            path = ca.vec(ca.vertcat(*side) @ self.offset(j, data).T)
            result += pull[j] * self.law.tendon(v, path)
        return result

    def solve(self, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return the strains v where the wrench vanishes, NaN if a few steps do not lead there."""
        begun, step = self.functions()
        u, w = begun(pull, data)
        for _ in range(_STEPS):
            u, w, size, v = step(u, w, pull, data)
        return ca.if_else(size < self.settled, v, np.nan)

    def functions(self) -> tuple[ca.Function, ...]:
        """Return (pull, data) -> u and w to begin with, from the shape at rest; and `step`."""
        pull, data = ca.SX.sym("pull", self.n_pull), ca.SX.sym("data", self.n_data)
        stretch = 1 / ca.sqrt(1 + 2 * ca.sum1(pull) / data[0]) if self.is_rubber else ca.SX(1)
        rest = data[3:5] if self.law.curved else ca.SX.zeros(2)
        u = ca.vertcat(rest * self.law.width(stretch), stretch)[: 2 + self.law.extension]
        begun = [ca.densify(u), ca.vec(ca.SX.zeros(1 + self.is_rubber, self.n_pull))]
        return ca.Function("begun", [pull, data], begun, {"cse": True}), self.step()

    def step(self) -> ca.Function:
        """Return (u, w, pull, data) -> u and w after a Newton step, its size, the strains v there.

        w (1 or 2, n_pull), one column here, are the tendons' unit vectors; the size counts
        curvatures by the radius.
        """
        extension, rubber = self.law.extension, self.is_rubber
        u, W = ca.SX.sym("u", 2 + extension), ca.SX.sym("w", (1 + rubber) * self.n_pull)
        w = ca.reshape(W, 1 + rubber, self.n_pull)
        pull, data = ca.SX.sym("pull", self.n_pull), ca.SX.sym("data", self.n_data)
        body = self._body(data)
        resisted = less_rest(self.law, self.strains(u), body)
        hessian, slope = ca.hessian(self.law.energy(resisted, body[:4]), u)
        tendons = [_Tendon(*self.tangent(j, u, data), u, w[:, j]) for j in range(w.shape[1])]
        for j, tendon in enumerate(tendons):
            slope += pull[j] * tendon.slope
            hessian += pull[j] * tendon.curvature
        stiff = ca.vertcat(data[1], data[1], data[0])[: u.numel()] * (_LEAST if rubber else 1.0)
        step = _solve_symmetric(hessian, -slope, stiff)
        radius = 2 * ca.sqrt(data[1] / data[0])
        size = radius * ca.norm_inf(step[:2]) / (1 + radius * ca.norm_inf(u[:2]))
        if extension:
            size = ca.fmax(size, ca.fabs(step[2]))
        if rubber:
            change = ca.fmax(-step[2] / _SHRINKS, step[2] / _GROWS)
            change = ca.fmax(change, radius * ca.norm_inf(step[:2]) / _BENDS)
            step = step / ca.fmax(1, change / u[2])
        turned = ca.horzcat(*(tendon.turned(step) for tendon in tendons))
        after = u + step
        results = [after, ca.vec(turned), size, ca.densify(self.strains(after))]
        return ca.Function("newton", [u, W, pull, data], results, {"cse": True})

    def strains(self, u: ca.SX) -> ca.SX:
        """Return the strains v of u = (w kappa, lambda), w the section's width; see drawn."""
        return ca.vertcat(u[:2] / self.law.width(u[2]), u[2]) if self.law.extension else u

    def _body(self, data: ca.SX) -> ca.SX:
        """Return what the law takes of the body."""
        return ca.vertcat(data[:3], 0, data[3 : self._first])

    def tangent(self, j: int, u: ca.SX, data: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return what of the tangent of tendon j depends on u, and the square of the rest.

        In the frame of t, d and t x d, where without torsion a tendon stays in the plane of t, d.
        """
        cos, sin = self.cos[j], self.sin[j]
        bend = ca.vertcat(0, u[0] * cos + u[1] * sin, u[1] * cos - u[0] * sin)
        nu = ca.vertcat(u[2] if self.law.extension else ca.SX(1), 0, 0)
        y, y_rate = ca.vertsplit(self.offset(j, data))
        c = self.law.drawn(bend, nu, self.law.width(nu[0]), ca.vertcat(y, 0, y_rate, 0))
        moving = [i for i in range(3) if ca.depends_on(c[i], u)]
        still = [i for i in range(3) if i not in moving]
        return c[moving], ca.sumsqr(c[still]) + TINY


class _Tendon:
    """A tendon of 1 N: its tangent c at u, and what Newton's method needs of |c|."""

    def __init__(self, c: ca.SX, rest: ca.SX, u: ca.SX, w: ca.SX) -> None:
        self.c, self.w, self.length = c, w, ca.sqrt(ca.sumsqr(c) + rest)
        self.unit, self.along = c / self.length, ca.jacobian(c, u)
        self.slope = self.along.T @ self.unit
        across = ca.SX.eye(c.numel()) - (w @ self.unit.T + self.unit @ w.T) / 2
        held = ca.SX.sym("w", c.numel())
        bent = ca.substitute(ca.jacobian(self.along.T @ held, u), held, w)
        self.curvature = self.along.T @ (across / self.length) @ self.along + bent

    def turned(self, step: ca.SX) -> ca.SX:
        """Return w after a step of the strains, within the unit ball."""
        moved = self.along @ step
        w = (self.c + moved - self.w * ca.dot(self.unit, moved)) / self.length
        size = ca.fabs(w) if w.numel() == 1 else norm(w)
        return w / ca.fmax(1, size)


def _solve_symmetric(A: ca.SX, right: ca.SX, least: ca.SX) -> ca.SX:
    """Return A^-1 right for a small symmetric A (n, n) and right (n,), by A = L D L^T.

    Pivots below `least` (n,) are raised to it.
    """
    n = A.shape[0]
    L, D = ca.SX.eye(n), [ca.SX(0)] * n
    for j in range(n):
        D[j] = A[j, j] - sum((L[j, k] ** 2 * D[k] for k in range(j)), ca.SX(0))
        D[j] = ca.fmax(D[j], least[j])
        for i in range(j + 1, n):
            inner = sum((L[i, k] * L[j, k] * D[k] for k in range(j)), ca.SX(0))
            L[i, j] = (A[i, j] - inner) / D[j]
    x = ca.vertsplit(right)
    for i in range(n):
        x[i] -= sum((L[i, k] * x[k] for k in range(i)), ca.SX(0))
    x = [row / d for row, d in zip(x, D, strict=True)]
    for i in reversed(range(n)):
        x[i] -= sum((L[k, i] * x[k] for k in range(i + 1, n)), ca.SX(0))
    return ca.vertcat(*x)


@dataclass(frozen=True)
class PaperStatics:
    """The paper's balance, linear in the strains; `pull` are the six resultants of the tendons.

    (K + sum T y2 (1 - d d^T)) omega = sum T y t x d, E A q = - sum T t . c; see PaperSection.
    """

    law: PaperSection
    n_pull: int = field(default=6, init=False)
    is_explicit: ClassVar[bool] = True

    @property
    def n_data(self) -> int:
        """The size of data."""
        return 3 + 2 * self.law.curved

    def pulls(self, arm: Arm, at: Stations) -> Array:
        """See EnergyStatics.pulls."""
        n, b = tendon_offsets(arm, at)[0]
        return np.stack([crossing(arm, at), *resultants(n, b)[1:]], axis=1)

    def data(self, material: Material, at: Stations) -> Array:
        """See EnergyStatics.data."""
        return np.ascontiguousarray(np.vstack([resists(material, at.area), at.rest]).T)

    def wrench(self, v: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See EnergyStatics.wrench."""
        moment, along = self.law.tendons(v, pull)
        body = self.law.body(v, ca.vertcat(data[:3], 0, data[3:]))
        return body + join(self.law, moment, along, ca.SX.zeros(2))

    def functions(self) -> tuple[ca.Function, ...]:
        """Return (pull, data) -> strains."""
        pull, data = ca.SX.sym("pull", self.n_pull), ca.SX.sym("data", self.n_data)
        v = ca.densify(self.solve(pull, data))
        return (ca.Function("balance", [pull, data], [v], {"cse": True}),)

    def solve(self, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See EnergyStatics.solve: curvatures, of which the stretch follows."""
        n = 2 + self.law.extension
        v = ca.SX.sym("v", n)
        wrench = self.wrench(v, pull, data)
        D, rest = ca.jacobian(wrench, v), ca.substitute([wrench], [v], [ca.SX.zeros(n)])[0]
        bend = -ca.inv_minor(D[:2, :2]) @ rest[:2]
        return ca.vertcat(bend, (-rest[2:] - D[2:, :2] @ bend) / ca.diag(D)[2:])


ClosedStatics = EnergyStatics | PaperStatics


def closed_statics(scene: Scene, arm: Arm) -> ClosedStatics:
    """Return the statics of a scene without loads, for an arm's tendons."""
    law = cross_section_of(scene, arm.is_curved, torsion=False)
    if isinstance(law, PaperSection):
        return PaperStatics(law)
    assert isinstance(law, EnergySection)
    cos, sin = sides(arm)
    return EnergyStatics(law, arm.offset_of, tuple(cos.tolist()), tuple(sin.tolist()))
