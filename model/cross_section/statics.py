"""The balance of a cross-section without loads, by its law, in symbols.

Without loads the wrench of body and tendons vanishes, so that each cross-section is in equilibrium
by itself: its strains follow from the tensions alone. None is twisted, but where tendons turn or
the body shears. The paper's balance is linear in its strains; with an energy Newton steps lead
there, four to seven for ordinary tensions, thirty for a thousand times as much.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.energy import EnergySection, RubberSection
from octoplan.model.cross_section.law import (
    TINY,
    PaperSection,
    body_size,
    join,
    less_rest,
    resultants,
    size,
)
from octoplan.model.cross_section.of_scene import body_numbers, cross_section_of
from octoplan.model.effects import Shear
from octoplan.model.paths import Array
from octoplan.model.rotations import norm
from octoplan.model.scene import Scene
from octoplan.model.stations import Stations, crossing, sides, tendon_offsets

# Where the strains are to be an expression of the tensions, so many steps are written out: enough
# for ordinary ones.
_WRITTEN_OUT = 10
# The energy of a neo-Hookean body is not convex everywhere: the least pivot of its Hessian that a
# step is taken with, over the body's stiffness at rest. That of a linear body is convex, and at
# least as stiff as without tendons.
_LEAST = 1e-3
# What of its stretch a step may take from a neo-Hookean body, and add to it; it may bend it by one
# over the radius: 4 to 7 steps do where an arm curls up, 30 at a thousand times that tension.
_SHRINKS, _GROWS = 0.3, 2.0


@dataclass(frozen=True)
class EnergyStatics:
    """The balance of a cross-section with an energy, as SX expressions of numbers of it.

    These are `pull` (n_pull,), linear in the tensions: here the tensions themselves; and `data`
    (n_data,): what the law takes of the body, then the tendons' paths. Where no section is twisted
    a tendon stays in a plane, so that these are the offsets y_i and y_i' in it.

    Attributes
    ----------
    law : EnergySection
    row, cos, sin
        Which of the paths each tendon has, and the direction (n, b) of its first component.
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
        return body_size(self.law) + self._path_size * (max(self.row) + 1)

    @property
    def _path_size(self) -> int:
        return 4 if self.law.torsion else 2

    def pulls(self, arm: Arm, at: Stations) -> Array:
        """Return maps (N, n_pull, n_tendons) from tensions to pull: 1 for a tendon that crosses."""
        return np.asarray(crossing(arm, at)[:, :, None] * np.eye(arm.n_tendons))

    def data(self, arm: Arm, scene: Scene, at: Stations) -> Array:
        """Return data (N, n_data)."""
        paths = np.vstack([at.y, at.y_rate])
        if self.law.torsion:
            Y = tendon_offsets(arm, at)[:2].reshape(4, at.s.size, -1)
            paths = Y.transpose(0, 2, 1).reshape(-1, at.s.size)
        return np.ascontiguousarray(np.vstack([body_numbers(arm, scene, at), paths]).T)

    def _split(self, data: ca.SX) -> tuple[ca.SX, list[ca.SX]]:
        """Return what the law takes of the body, and each tendon's path (4,) in its directions."""
        n = body_size(self.law)
        paths = ca.reshape(data[n:], -1, self._path_size).T
        if not self.law.torsion:
            paths = ca.vertcat(paths[0, :], 0 * paths[0, :], paths[1, :], 0 * paths[1, :])
        return data[:n], [paths[:, row] for row in self.row]

    def wrench(self, v: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return the wrench of body and tendons at strains v, which vanishes without loads.

        It is the gradient of the energy.
        """
        body, paths = self._split(data)
        result = self.law.body(v, body)
        for j, (cos, sin) in enumerate(zip(self.cos, self.sin, strict=True)):
            turn = ca.SX([[cos, -sin], [sin, cos]])
            path = ca.vec(turn @ ca.reshape(paths[j], 2, 2))
            result += pull[j] * self.law.tendon(v, path)
        return result

    def solve(self, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return the strains v where the wrench vanishes, NaN if a few steps do not lead there."""
        begun, step = self.functions()
        u, w = begun(pull, data)
        for _ in range(_WRITTEN_OUT):
            u, w, last, v = step(u, w, pull, data)
        return ca.if_else(last < self.settled, v, np.nan)

    def functions(self) -> tuple[ca.Function, ...]:
        """Return (pull, data) -> u and w to begin with, from the shape at rest; and a Newton step.

        That is (u, w, pull, data) -> u and w after it, its size, the strains v there. u is (w
        kappa, lambda, shears) with w the section's width, see EnergySection.drawn; w, one after the
        other, are the tendons' unit vectors; the size counts curvatures by the radius.
        """
        law, stretches = self.law, isinstance(self.law, RubberSection)
        u, pull = ca.SX.sym("u", size(law)), ca.SX.sym("pull", self.n_pull)
        data = ca.SX.sym("data", self.n_data)
        body, paths = self._split(data)
        n = 2 + law.torsion
        v = ca.vertcat(u[:n] / law.width(u[n]), u[n:]) if law.extension else u
        hessian, slope = ca.hessian(law.energy(less_rest(law, v, body), body[:4]), u)
        tendons = [_Tendon(*self._tangent(j, u, paths[j]), u) for j in range(self.n_pull)]
        for j, tendon in enumerate(tendons):
            slope += pull[j] * tendon.slope
            hessian += pull[j] * tendon.curvature
        # H = L D L^T with no pivot too small: a step of descent.
        D, L, order = ca.ldl(ca.densify(hessian), False)
        EA, EJ, GI, GA = ca.vertsplit(body[:4])
        stiff = join(law, ca.vertcat(GI, EJ, EJ), EA, ca.vertcat(GA, GA))
        step = ca.ldl_solve(-ca.densify(slope), ca.fmax(D, _LEAST * stiff), L, order)
        radius = 2 * ca.sqrt(EJ / EA)
        bent = radius * ca.norm_inf(step[:n])
        last = bent / (1 + radius * ca.norm_inf(u[:n]))
        last = ca.norm_inf(ca.vertcat(last, step[n:]))
        if stretches:
            change = ca.fmax(-step[n] / _SHRINKS, step[n] / _GROWS)
            step = step / ca.fmax(1, ca.fmax(change, bent) / u[n])
        w = [tendon.w for tendon in tendons]
        after = [u + step, ca.vertcat(*(tendon.turned(step) for tendon in tendons))]
        there = ca.densify(ca.substitute(v, u, after[0]))
        inputs = [u, ca.vertcat(*w), pull, data]
        newton = ca.Function("newton", inputs, [*after, last, there], {"cse": True})
        stretch = 1 / ca.sqrt(1 + 2 * ca.sum1(pull) / EA) if stretches else ca.SX(1)
        rest = ca.vertcat(0, body[4:] if law.curved else ca.SX.zeros(2))
        first = join(law, rest * law.width(stretch), stretch, ca.SX.zeros(2))
        begun = [ca.densify(first), ca.SX.zeros(newton.numel_in(1))]
        return ca.Function("begun", [pull, data], begun, {"cse": True}), newton

    def _tangent(self, j: int, u: ca.SX, path: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return what of the tangent of tendon j depends on u, and the square of the rest.

        In the frame of t, d and t x d, where without torsion a tendon stays in the plane of t, d.
        """
        cos, sin = self.cos[j], self.sin[j]
        turn = ca.SX([[1, 0, 0], [0, cos, sin], [0, -sin, cos]])
        bend, nu = (turn @ each for each in self.law.twist(u))
        c = self.law.drawn(bend, nu, self.law.width(nu[0]), path)
        moving = [i for i in range(3) if ca.depends_on(c[i], u)]
        still = [i for i in range(3) if i not in moving]
        return c[moving], ca.sumsqr(c[still]) + TINY


class _Tendon:
    """A tendon of 1 N: its tangent c at u, and what Newton's method needs of |c|.

    Steps are those of a primal-dual method: w is c / |c| in equilibrium, and within the unit ball
    on the way there, which keeps the Hessian of |c| bounded where c is short.
    """

    def __init__(self, c: ca.SX, rest: ca.SX, u: ca.SX) -> None:
        self.c, self.length = c, ca.sqrt(ca.sumsqr(c) + rest)
        self.w = w = ca.SX.sym("w", c.numel())
        self.unit, self.along = c / self.length, ca.jacobian(c, u)
        self.slope = self.along.T @ self.unit
        across = ca.SX.eye(c.numel()) - (w @ self.unit.T + self.unit @ w.T) / 2
        bent = ca.jacobian(self.along.T @ w, u)
        self.curvature = self.along.T @ (across / self.length) @ self.along + bent

    def turned(self, step: ca.SX) -> ca.SX:
        """Return w after a step of the strains, within the unit ball."""
        change = self.along @ step
        w = (self.c + change - self.w * ca.dot(self.unit, change)) / self.length
        return w / ca.fmax(1, ca.fabs(w) if w.numel() == 1 else norm(w))


@dataclass(frozen=True)
class PaperStatics:
    """The paper's balance, linear in the strains; `pull` are the resultants of the tendons.

    (K + sum T y^2 (1 - d d^T)) omega = sum T y t x d, E A q = - sum T t . c; see PaperSection. Data
    are what the law takes of the body.
    """

    law: PaperSection
    is_explicit: ClassVar[bool] = True

    @property
    def n_pull(self) -> int:
        """The size of pull: six resultants, nine where sections may be twisted."""
        return 9 if self.law.torsion else 6

    @property
    def n_data(self) -> int:
        """The size of data."""
        return body_size(self.law)

    def pulls(self, arm: Arm, at: Stations) -> Array:
        """See EnergyStatics.pulls."""
        (n, b), (n_rate, b_rate), _ = tendon_offsets(arm, at)
        rows = crossing(arm, at), *resultants(n, b, n_rate, b_rate)[1 : self.n_pull]
        return np.stack(rows, axis=1)

    def data(self, arm: Arm, scene: Scene, at: Stations) -> Array:
        """See EnergyStatics.data."""
        return np.ascontiguousarray(body_numbers(arm, scene, at).T)

    def wrench(self, v: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See EnergyStatics.wrench."""
        moment, force = self.law.tendons(v, pull)
        return self.law.body(v, data) + join(self.law, moment, force[0], force[1:])

    def functions(self) -> tuple[ca.Function, ...]:
        """Return (pull, data) -> strains."""
        pull, data = ca.SX.sym("pull", self.n_pull), ca.SX.sym("data", self.n_data)
        v = ca.densify(self.solve(pull, data))
        return (ca.Function("balance", [pull, data], [v], {"cse": True}),)

    def solve(self, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See EnergyStatics.solve: bending, then torsion, of which all others follow."""
        v, n = ca.SX.sym("v", size(self.law)), int(self.law.torsion)
        wrench = self.wrench(v, pull, data)
        D, rest = ca.jacobian(wrench, v), ca.substitute(wrench, v, 0 * v)
        bends, turns, others = slice(n, n + 2), slice(0, n), slice(n + 2, None)
        result = ca.SX.zeros(v.numel())
        (a, b, c, d), (e, f) = ca.vertsplit(ca.vec(D[bends, bends].T)), ca.vertsplit(rest[bends])
        result[bends] = ca.vertcat(b * f - d * e, c * e - a * f) / (a * d - b * c)
        for part in (turns, others):
            result[part] = -(rest[part] + D[part, :] @ result) / ca.diag(D)[part]
        return result


ClosedStatics = EnergyStatics | PaperStatics


def closed_statics(scene: Scene, arm: Arm) -> ClosedStatics:
    """Return the statics of an arm's cross-sections in a scene, but for its loads."""
    twisted = any(arm.turns) or scene.has(Shear)
    law = cross_section_of(scene, arm.is_curved, twisted)
    if isinstance(law, PaperSection):
        return PaperStatics(law)
    assert isinstance(law, EnergySection)
    row, n = arm.offset_of, arm.n_tendons
    cos, sin = (tuple(each.tolist()) for each in sides(arm))
    if law.torsion:
        row, cos, sin = tuple(range(n)), (1.0,) * n, (0.0,) * n
    return EnergyStatics(law, row, cos, sin)
