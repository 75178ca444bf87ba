"""The functions of a program in contact, in symbols: what nodes, targets and held objects add."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model.arm import Arm
from model.cross_section.law import CrossSection, size
from model.machine.buffered import Buffered
from model.obstacles.base import SIZE, with_gradient
from model.rotations import unit_matrix
from model.transcription.collocation import gauss
from model.transcription.kernel import Kernel, Places
from model.transcription.layout import POSE, Layout
from model.transcription.terms import Equations, Term
from model.transcription.touch import TOUCH, gap_function
from planner.program.states import mode_terms
from planner.program.terms import Same, term_names, terms_function
from planner.solve.ipopt import COLD, WARM, named, nlp_solver
from planner.targets.base import Target

# The weight of soft residuals beside effort, and of slacks where targets cannot be met.
NEAREST = 1e6
# By how much cones are blunt at their tips, over the size of the wrench.
_BLUNT = 1e-7
_WAY: dict[str, Any] = COLD | {"max_iter": 50, "obj_scaling_factor": 1.0, "mu_init": 1e-2}


@dataclass(frozen=True)
class Structure:
    """What the program's functions depend on; numbers are parameters.

    Attributes
    ----------
    of : Layout
    seen : tuple of int
        The nodes that targets look at.
    holds : tuple of (int, int)
        Which of the obstacles are held, and the size of the wrench on each.
    kinds : tuple
        The targets' structures.
    modes : int
        1 where the least stable mode is among the unknowns.
    """

    of: Layout
    seen: tuple[int, ...]
    holds: tuple[tuple[int, int], ...]
    kinds: tuple[object, ...]
    modes: int
    arm: Arm
    given: Same = field(compare=False)

    @property
    def tangential(self) -> Places:
        """The places of tangential forces (holds, N, 3) among the unknowns."""
        n, N = len(self.holds), self.of.elements
        return self.of.n_x + np.arange(3 * n * N).reshape(n, N, 3)

    @property
    def mode(self) -> int:
        """Where the mode begins among the unknowns; its eigenvalue comes last."""
        return int(self.of.n_x + self.tangential.size)

    @property
    def n_y(self) -> int:
        """How many unknowns there are before slacks."""
        return self.mode + self.modes * (self.of.n_states + 1)


class Functions:
    """The functions of a structure."""

    def __init__(self, of: Structure) -> None:
        self.of = of
        arm, targets = of.arm, of.given.value
        lay, law, m = of.of, of.of.form.law, of.of.form.stages
        N, K, at = lay.elements, lay.form.contacts, lay.first
        terms = list(lay.equations.terms)
        inside = np.repeat(lay.inside.T, K, axis=0)
        after = np.repeat(lay.nodes[1:, :POSE], K, axis=0)
        own = lay.touches[1:].reshape(N * K, 2)
        row = lay.n_states
        both = row + np.arange(2 * N * K).reshape(2, N * K)
        unknowns = at + np.hstack([inside, after, own[:, :1]]).T
        terms.append(Term(_complementary(law, m), unknowns, both))
        row += 2 * N * K
        self.wrenches, self.cones = list[slice](), list[slice]()
        for i, (j, n) in enumerate(of.holds):
            touch = at + lay.touches[:, j]
            beyond = np.append(touch[2:, 1], touch[-1, 1])
            pressing = np.stack([touch[1:, 0], touch[:-1, 1], touch[1:, 1], beyond])
            unknowns = np.vstack(
                [at + lay.inside, at + lay.nodes[1:, :POSE].T, pressing, of.tangential[i].T]
            )
            shared = np.repeat(np.arange(row, row + n)[:, None], N, axis=1)
            each = row + n + np.arange(2 * N).reshape(2, N)
            terms.append(Term(_grip(law, m, n), unknowns, np.vstack([shared, each])))
            self.wrenches.append(slice(row, row + n))
            self.cones.append(slice(row + n, row + n + N))
            row += n + 2 * N
        self.first_mode = row
        if of.modes:
            terms += mode_terms(lay, np.arange(lay.n_x), of.mode, row)
            row += lay.n_states + 1
        self.equations = Equations(of.n_y, row, terms)
        self.names = term_names(arm, targets)[2]
        self._symbols(arm, targets)

    def _symbols(self, arm: Any, targets: tuple[Target, ...]) -> None:
        of, eq = self.of, self.equations
        terms = terms_function(arm, targets)
        n_held = sum(n for _, n in of.holds)
        n_eq, n_in = int(terms.numel_out(0)), int(terms.numel_out(2))
        self.n_slack = n_held + n_eq + n_in
        z = ca.MX.sym("z", of.n_y + self.n_slack)
        sizes = [z.numel(), eq.n_g, eq.n_p, terms.numel_in(1), 1]
        p = ca.MX.sym("p", sum(sizes))
        unit, row_unit, numbers, given, weight = ca.vertsplit(p, np.cumsum([0, *sizes]).tolist())
        y, slack = (z * unit)[: of.n_y], z[of.n_y :]
        places = of.of.first + of.of.nodes[list(of.seen), :POSE]
        poses = ca.reshape(y[places.ravel().tolist()], POSE, len(of.seen))
        equality, soft, inequality, _ = terms(poses, given, ca.MX(0, 1))
        n = of.of.n_tendons
        f = ca.sumsqr(z[:n]) / 2 + NEAREST / 2 * ca.sumsqr(soft) + weight / 2 * ca.sumsqr(slack)
        f += 1e-9 * ca.sumsqr(z[of.of.n_x : of.mode])
        held = [k for own in self.wrenches for k in range(own.start, own.stop)]
        shift = ca.DM(ca.Sparsity.triplet(eq.n_g, n_held, held, list(range(n_held))), 1.0)
        outer = ca.vertcat(equality, inequality) + slack[n_held:]
        outer = ca.vertcat(outer, ca.sum1(z[:n]))
        own = eq.value(y, numbers) / row_unit + shift @ slack[:n_held]
        self.n_g = eq.n_g + n_eq + n_in + 1
        self.inequalities = slice(eq.n_g + n_eq, eq.n_g + n_eq + n_in)
        sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", self.n_g)

        def scaled(values: ca.MX, at: ca.Sparsity, by_row: ca.MX, by_column: ca.MX) -> ca.MX:
            i, j = at.get_triplet()
            return ca.MX(at, values * ca.vec(by_row[i]) * ca.vec(by_column[j]))

        (by_x, in_x), (second, in_second) = eq.jacobian, eq.hessian
        inner = ca.horzcat(
            scaled(by_x(y, numbers), in_x, 1 / row_unit, unit[: of.n_y]),
            shift,
            ca.MX(eq.n_g, n_eq + n_in),
        )
        J = ca.vertcat(inner, ca.jacobian(outer, z))
        H = scaled(
            second(y, numbers, lam[: eq.n_g] / row_unit), in_second, unit[: of.n_y], unit[: of.n_y]
        )
        none = ca.MX(self.n_slack, self.n_slack)
        H = ca.diagcat(H, none) + ca.hessian(sigma * f + ca.dot(lam[eq.n_g :], outer), z)[0]
        gradient = ca.densify(ca.gradient(f, z))
        g = ca.vertcat(own, outer)
        nlp, exact = {"x": z, "p": p, "f": f, "g": g}, ca.triu(H)
        derivatives = named((z, p, sigma, lam), (f, gradient), (g, J), exact)
        self.solver = nlp_solver(nlp, derivatives, _WAY)
        self.warm = nlp_solver(nlp, derivatives, WARM | {"obj_scaling_factor": 1.0})
        self.first = Buffered(ca.Function("first", [z, p], [gradient, ca.densify(g), J.nz[:]]))
        self.places = np.array(J.sparsity().row()), np.array(J.sparsity().colind())


functions = lru_cache(maxsize=16)(Functions)


@lru_cache(maxsize=32)
def _complementary(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of a node that may touch: gap over L, gap times force over its unit.

    Unknowns: strains of the element before, q, u, P; numbers of a touch, L, unit of force.
    """
    v, q, u, P = ca.SX.sym("v", size(law) * m), ca.SX.sym("q", 4), ca.SX.sym("u", 3), ca.SX.sym("P")
    c = ca.SX.sym("c", TOUCH + 2)
    gap = gap_function(law, m)(v, ca.vertcat(q, u), c[:TOUCH])[0] / c[TOUCH]
    return Kernel(
        "complementary", ca.vertcat(v, q, u, P), c, ca.vertcat(gap, gap * P / c[TOUCH + 1])
    )


@lru_cache(maxsize=32)
def _grip(law: CrossSection, m: int, n: int) -> Kernel:
    """Return the kernel of what a node adds to the n numbers of the wrench on an object.

    Then what its cone spares, and how far the tangential force leans. Unknowns: strains of the
    element before, q, u, P there, p before, there and beyond, tangential force. Numbers: the
    obstacle's, shares of these, 1 where the second is a shift, friction, size, lever.
    """
    v, q, u = ca.SX.sym("v", size(law), m), ca.SX.sym("q", 4), ca.SX.sym("u", 3)
    pressing, f, c = ca.SX.sym("P", 4), ca.SX.sym("f", 3), ca.SX.sym("c", SIZE + 8)
    body, shares, (moves, mu, unit, lever) = (
        c[:SIZE],
        c[SIZE : SIZE + 4],
        ca.vertsplit(c[SIZE + 4 :]),
    )
    end = v @ ca.DM(gauss(m).at(1.0))
    at = u + moves * pressing[2] * (unit_matrix(q) @ law.twist(end)[1])
    d, normal = with_gradient()(at, body)
    N = ca.dot(shares, pressing)
    total = f - N * normal
    moment = ca.cross(at - d * normal - body[:3], total) / lever
    wrench = ca.vertcat(total, moment)[:n] / unit
    cone = (mu * N - ca.sqrt(ca.sumsqr(f) + (_BLUNT * unit) ** 2)) / unit + _BLUNT
    y = ca.vertcat(ca.vec(v), q, u, pressing, f)
    return Kernel("grip", y, c, ca.vertcat(wrench, cone, ca.dot(normal, f) / unit))
