"""The balance of a cross-section without loads, in symbols.

Without loads the wrench of body and tendons vanishes, and the strains of each cross-section follow
from the tensions alone. Cross-sections twist only if tendons turn around the midline or the body
shears. The paper's balance is linear in the strains. With an energy, Newton's method converges in
four to seven steps under ordinary tensions, and in thirty under a thousandfold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import (
    STIFFNESS_SIZE,
    TINY,
    EnergySection,
    PaperSection,
    RubberSection,
    body_parameters,
    body_size,
    cross_section_of,
    elastic_strains,
    join,
    resultants,
    size,
)
from octoplan.model.effects.sections import Shear
from octoplan.model.mesh import Stations, crossing, tendon_directions, tendon_offsets
from octoplan.model.paths import Array
from octoplan.model.rotations import norm
from octoplan.model.scene import Scene

# Number of Newton steps in a symbolic solution; sufficient for ordinary tensions.
_WRITTEN_OUT = 10
# Smallest pivot of the Hessian of the energy, over the stiffness of the body at rest: the energy of
# a neo-Hookean body is not convex everywhere.
_LEAST_PIVOT = 1e-3
# Largest relative decrease of the stretch of a neo-Hookean body in one Newton step.
_MAX_DECREASE = 0.3
# Largest relative increase of the stretch of a neo-Hookean body in one Newton step.
_MAX_INCREASE = 2.0


@dataclass(frozen=True)
class EnergyStatics:
    """The balance of a cross-section with an energy, as SX expressions.

    The arguments are `pull` (n_pull,), here the tensions, and `data` (n_data,), the numbers of the
    body and of the paths of the tendons. Without twist each tendon stays in a plane, and its path
    consists of the offset y and its derivative in this plane.

    Attributes
    ----------
    law : EnergySection
    row : tuple of int
        Index of the path of each tendon.
    cos, sin : tuple of float
        Components along n and b of the direction of the first component of each path.
    settled : float
        Tolerance of the last step, relative to the strains.
    is_explicit : bool
        Whether the strains are a short expression of pull and data.
    """

    law: EnergySection
    row: tuple[int, ...]
    cos: tuple[float, ...]
    sin: tuple[float, ...]
    settled: float = 1e-9
    is_explicit: ClassVar[bool] = False

    @property
    def n_pull(self) -> int:
        """The size of pull: the number of tendons."""
        return len(self.row)

    @property
    def n_data(self) -> int:
        """The size of data."""
        return body_size(self.law) + self._path_size * (max(self.row) + 1)

    @property
    def _path_size(self) -> int:
        return 4 if self.law.torsion else 2

    def resultant_maps(self, arm: Arm, at: Stations) -> Array:
        """Return maps (N, n_pull, n_tendons) from tensions to pull: 1 for a tendon that crosses."""
        return np.asarray(crossing(arm, at)[:, :, None] * np.eye(arm.n_tendons))

    def data(self, arm: Arm, scene: Scene, at: Stations) -> Array:
        """Return data (N, n_data)."""
        paths = np.vstack([at.y, at.y_rate])
        if self.law.torsion:
            Y = tendon_offsets(arm, at)[:2].reshape(4, at.s.size, -1)
            paths = Y.transpose(0, 2, 1).reshape(-1, at.s.size)
        return np.ascontiguousarray(np.vstack([body_parameters(arm, scene, at), paths]).T)

    def _split(self, data: ca.SX) -> tuple[ca.SX, list[ca.SX]]:
        """Return the numbers of the body, and the path (4,) of each tendon in its directions."""
        n = body_size(self.law)
        paths = ca.reshape(data[n:], -1, self._path_size).T
        if not self.law.torsion:
            paths = ca.vertcat(paths[0, :], 0 * paths[0, :], paths[1, :], 0 * paths[1, :])
        return data[:n], [paths[:, row] for row in self.row]

    def wrench(self, v: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return the wrench of body and tendons at strains v, the gradient of the energy."""
        body, paths = self._split(data)
        result = self.law.body(v, body)
        for j, (cos, sin) in enumerate(zip(self.cos, self.sin, strict=True)):
            turn = ca.SX([[cos, -sin], [sin, cos]])
            path = ca.vec(turn @ ca.reshape(paths[j], 2, 2))
            result += pull[j] * self.law.tendon(v, path)
        return result

    def solve(self, pull: ca.SX, data: ca.SX) -> ca.SX:
        """Return the strains v at which the wrench vanishes; NaN if a few steps do not converge."""
        begun, step = self.functions()
        u, w = begun(pull, data)
        for _ in range(_WRITTEN_OUT):
            u, w, last, v = step(u, w, pull, data)
        return ca.if_else(last < self.settled, v, np.nan)

    def functions(self) -> tuple[ca.Function, ...]:
        """Return the functions of the initial values and of a Newton step.

        Initial values are (pull, data) -> u, w. A step is (u, w, pull, data) -> u, w, size of the
        step, strains v. The unknowns u are (bend, lambda, shears) with bend = kappa times the width
        of the section, see EnergySection.tangent_of_bend. The vectors w of all tendons are those of
        _Tendon. The size of a step has curvatures times the radius.
        """
        law = self.law
        stretches = isinstance(law, RubberSection)
        u = ca.SX.sym("u", size(law))
        pull = ca.SX.sym("pull", self.n_pull)
        data = ca.SX.sym("data", self.n_data)
        body, paths = self._split(data)
        n = 2 + law.torsion
        v = ca.vertcat(u[:n] / law.width(u[n]), u[n:]) if law.extension else u
        energy = law.energy(elastic_strains(law, v, body), body[:STIFFNESS_SIZE])
        hessian, slope = ca.hessian(energy, u)
        tendons = [_Tendon(*self._tangent(j, u, paths[j]), u) for j in range(self.n_pull)]
        for j, tendon in enumerate(tendons):
            slope += pull[j] * tendon.slope
            hessian += pull[j] * tendon.curvature
        # A descent step: H = L D L^T with pivots of at least _LEAST_PIVOT.
        D, L, order = ca.ldl(ca.densify(hessian), False)
        EA, EJn, EJb, GI, GA = ca.vertsplit(body[:STIFFNESS_SIZE])
        stiff = join(law, ca.vertcat(GI, EJn, EJb), EA, ca.vertcat(GA, GA))
        step = ca.ldl_solve(-ca.densify(slope), ca.fmax(D, _LEAST_PIVOT * stiff), L, order)
        radius = 2 * ca.sqrt(ca.fmax(EJn, EJb) / EA)
        bent = radius * ca.norm_inf(step[:n])
        last = bent / (1 + radius * ca.norm_inf(u[:n]))
        last = ca.norm_inf(ca.vertcat(last, step[n:]))
        if stretches:
            change = ca.fmax(-step[n] / _MAX_DECREASE, step[n] / _MAX_INCREASE)
            step = step / ca.fmax(1, ca.fmax(change, bent) / u[n])
        w = [tendon.w for tendon in tendons]
        after = [u + step, ca.vertcat(*(tendon.turned(step) for tendon in tendons))]
        there = ca.densify(ca.substitute(v, u, after[0]))
        inputs = [u, ca.vertcat(*w), pull, data]
        newton = ca.Function("newton", inputs, [*after, last, there], {"cse": True})
        stretch = 1 / ca.sqrt(1 + 2 * ca.sum1(pull) / EA) if stretches else ca.SX(1)
        rest = ca.vertcat(0, body[STIFFNESS_SIZE:] if law.curved else ca.SX.zeros(2))
        first = join(law, rest * law.width(stretch), stretch, ca.SX.zeros(2))
        begun = [ca.densify(first), ca.SX.zeros(newton.numel_in(1))]
        return ca.Function("begun", [pull, data], begun, {"cse": True}), newton

    def _tangent(self, j: int, u: ca.SX, path: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the components of the tangent of tendon j that depend on u, and the squared rest.

        Components are along t, d and t x d. Without torsion a tendon stays in the plane of t and d.
        """
        cos = self.cos[j]
        sin = self.sin[j]
        turn = ca.SX([[1, 0, 0], [0, cos, sin], [0, -sin, cos]])
        bend, nu = (turn @ each for each in self.law.twist(u))
        c = self.law.tangent_of_bend(bend, nu, self.law.width(nu[0]), path)
        moving = [i for i in range(3) if ca.depends_on(c[i], u)]
        still = [i for i in range(3) if i not in moving]
        return c[moving], ca.sumsqr(c[still]) + TINY


class _Tendon:
    """A tendon under 1 N: its tangent c at u, and the derivatives of |c| for Newton's method.

    The method is primal-dual: the dual w stays in the unit ball, and is c / |c| in equilibrium. The
    dual keeps the Hessian of |c| bounded if c is short.
    """

    def __init__(self, c: ca.SX, rest: ca.SX, u: ca.SX) -> None:
        self.c = c
        self.length = ca.sqrt(ca.sumsqr(c) + rest)
        self.w = w = ca.SX.sym("w", c.numel())
        self.unit = c / self.length
        self.along = ca.jacobian(c, u)
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
    """The paper's balance, linear in the strains; `pull` contains the resultants of the tendons.

    (K + sum T y^2 (1 - d d^T)) omega = sum T y t x d, E A q = - sum T t . c; see PaperSection. The
    argument `data` contains the numbers of the body.
    """

    law: PaperSection
    is_explicit: ClassVar[bool] = True

    @property
    def n_pull(self) -> int:
        """The size of pull: six resultants, nine with torsion."""
        return 9 if self.law.torsion else 6

    @property
    def n_data(self) -> int:
        """The size of data."""
        return body_size(self.law)

    def resultant_maps(self, arm: Arm, at: Stations) -> Array:
        """See EnergyStatics.resultant_maps."""
        (n, b), (n_rate, b_rate), _ = tendon_offsets(arm, at)
        rows = crossing(arm, at), *resultants(n, b, n_rate, b_rate)[1 : self.n_pull]
        return np.stack(rows, axis=1)

    def data(self, arm: Arm, scene: Scene, at: Stations) -> Array:
        """See EnergyStatics.data."""
        return np.ascontiguousarray(body_parameters(arm, scene, at).T)

    def wrench(self, v: ca.SX, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See EnergyStatics.wrench."""
        moment, force = self.law.tendons(v, pull)
        return self.law.body(v, data) + join(self.law, moment, force[0], force[1:])

    def functions(self) -> tuple[ca.Function, ...]:
        """Return (pull, data) -> strains."""
        pull = ca.SX.sym("pull", self.n_pull)
        data = ca.SX.sym("data", self.n_data)
        v = ca.densify(self.solve(pull, data))
        return (ca.Function("balance", [pull, data], [v], {"cse": True}),)

    def solve(self, pull: ca.SX, data: ca.SX) -> ca.SX:
        """See EnergyStatics.solve: solve for bending, then torsion, then stretch and shears."""
        v = ca.SX.sym("v", size(self.law))
        n = int(self.law.torsion)
        wrench = self.wrench(v, pull, data)
        D = ca.jacobian(wrench, v)
        rest = ca.substitute(wrench, v, 0 * v)
        bending = slice(n, n + 2)
        torsion = slice(0, n)
        others = slice(n + 2, None)
        result = ca.SX.zeros(v.numel())
        a, b, c, d = ca.vertsplit(ca.vec(D[bending, bending].T))
        e, f = ca.vertsplit(rest[bending])
        result[bending] = ca.vertcat(b * f - d * e, c * e - a * f) / (a * d - b * c)
        for part in (torsion, others):
            result[part] = -(rest[part] + D[part, :] @ result) / ca.diag(D)[part]
        return result


ClosedStatics = EnergyStatics | PaperStatics


def closed_statics(scene: Scene, arm: Arm) -> ClosedStatics:
    """Return the statics of the cross-sections of an arm in a scene without its loads."""
    twisted = any(arm.angle_paths) or scene.has(Shear)
    law = cross_section_of(scene, arm.is_curved, twisted)
    if isinstance(law, PaperSection):
        return PaperStatics(law)
    assert isinstance(law, EnergySection)
    row = arm.offset_of
    n = arm.n_tendons
    cos, sin = (tuple(each.tolist()) for each in tendon_directions(arm))
    if law.torsion:
        row = tuple(range(n))
        cos = (1.0,) * n
        sin = (0.0,) * n
    return EnergyStatics(law, row, cos, sin)
