"""Several nonlinear programs solved as one, with common variables.

    minimise    sum f_k(x_k, z) + f_0(z)
    subject to  g_k(x_k, z) within bounds           the constraints of each program
                c(x_1, ..., x_N, z) within bounds   the coupling constraints

The variables are x_1, ..., x_N, z; the rows are the constraints of the programs, then c. Jacobian
and Hessian are block-diagonal except for the columns of z and the rows of c.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import casadi as ca
import numpy as np

from octoplan.model.paths import Array
from octoplan.model.support.machine.functions import BufferedFunction
from octoplan.planner.program import Nlp
from octoplan.planner.program_instance import Bounds
from octoplan.planner.solution import SolverResult
from octoplan.planner.solve.ipopt import Options, nlp_solver, run_solver


class Part(NamedTuple):
    """Objective and constraints of one program, with derivatives by its variables (x_k, z).

    For the coupling, objective and Hessian depend on z, and the Jacobian is by all
    variables.
    """

    f: ca.MX
    gradient: ca.MX
    g: ca.MX
    jacobian: ca.MX
    hessian: ca.MX


class SideBySide:
    """N programs as one, in CasADi symbols.

    Build the parts from the symbols, then pass them to `stated`.

    Attributes
    ----------
    x, p, sigma, lam : casadi.MX
        Variables, parameters, and the factors of objective and constraints in the Hessian.
    unknowns, multipliers : list of casadi.MX
        Variables of each program, then the common ones; multipliers of the constraints of each
        program, then of the coupling.
    ends : list of int
        Index of the first variable of each program, then of the common variables.
    """

    def __init__(
        self, sizes: Sequence[int], rows: Sequence[int], common: int, coupled: int, n_p: int
    ) -> None:
        self.ends = np.cumsum([0, *sizes]).tolist()
        last = np.cumsum([0, *rows]).tolist()
        self.x = ca.MX.sym("x", self.ends[-1] + common)
        self.lam = ca.MX.sym("lam", last[-1] + coupled)
        self.p = ca.MX.sym("p", n_p)
        self.sigma = ca.MX.sym("sigma")
        self.unknowns = ca.vertsplit(self.x, [*self.ends, self.x.numel()])
        self.multipliers = ca.vertsplit(self.lam, [*last, self.lam.numel()])
        self._solvers = dict[tuple[tuple[str, object], ...], BufferedFunction]()

    def stated(self, parts: Sequence[Part], coupling: Part) -> Self:
        """Assemble the program and the derivatives from parts, for CasADi's solvers."""
        f, gradient, g, jacobian, hessian = zip(*parts, strict=True)
        n = self.ends[-1]
        common = self.x.numel() - n
        ends = [[0, each.numel() - common, each.numel()] for each in gradient]
        gradients = zip(*map(ca.vertsplit, gradient, ends), strict=True)
        jacobians = zip(*map(ca.horzsplit, jacobian, ends), strict=True)
        blocks = map(ca.blocksplit, hessian, ends, ends)
        hessians = zip(*([*top, *bottom] for top, bottom in blocks), strict=True)
        by_own, by_common = gradients
        slope = ca.vertcat(*by_own, coupling.gradient + sum(by_common))
        by_own, by_common = jacobians
        J = ca.vertcat(ca.horzcat(ca.diagcat(*by_own), ca.vertcat(*by_common)), coupling.jacobian)
        by_own, across, _, by_common = hessians
        H = ca.horzcat(ca.diagcat(*by_own), ca.vertcat(*across))
        corner = ca.horzcat(ca.MX(common, n), coupling.hessian + sum(by_common))
        whole = [ca.MX(coupling.f + sum(f)), ca.vertcat(*g, coupling.g)]
        upper = ca.triu(ca.vertcat(H, corner))
        symbols = self.x, self.p, self.sigma, self.lam
        self.nlp = Nlp(*symbols, whole[0], slope, whole[1], J, upper)
        self.values = ca.Function("values", [self.x, self.p], whole)
        return self

    def split(self, x: Array) -> list[Array]:
        """Return the variables (size,) of each program, then the common variables."""
        return np.split(x, self.ends[1:])

    def solve(
        self,
        options: Options,
        x: Array,
        p: Array,
        bounds: Bounds,
        multipliers: tuple[Array, Array] | None = None,
    ) -> SolverResult:
        """Solve from variables x by ipopt, with options for a cold or a warm start."""
        key = tuple(options.items())
        if key not in self._solvers:
            self._solvers[key] = nlp_solver(self.nlp, options)
        return run_solver(self._solvers[key], x, p, bounds, multipliers)


def joined(
    each: Sequence[Bounds], common: tuple[Array, Array], coupled: tuple[Array, Array]
) -> Bounds:
    """Return the joint bounds from bounds of each program, of common variables and of coupling."""
    lbx, ubx, lbg, ubg = (list(item) for item in zip(*each, strict=True))
    pairs = (lbx, common[0]), (ubx, common[1]), (lbg, coupled[0]), (ubg, coupled[1])
    return tuple(np.concatenate([*item, last]) for item, last in pairs)  # type: ignore[return-value]
