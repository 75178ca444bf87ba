"""Kernels: functions of a few unknowns and numbers, with their derivatives.

What a kernel computes on the way, it may name: of unknowns y, intermediate quantities z_1 to z_K
one after the other, of all these residuals r. CasADi differentiates each step by itself, and the
chain rule puts the steps together: for Jacobians from the first to the last, as residuals are as
many as unknowns and most depend on all of what a step carries on,

    dz_k/dy = f_y + f_z dz/dy,        z_k = f(y, z), z all quantities before,

and for Hessians from the last to the first. With z = f(x) a step, x all that comes before, and L
the rest as a function of both,

    L'(x)  <-  L_x + L_z f_x
    L''(x) <-  L_xx + L_xz f_x + f_x^T L_zx + f_x^T L_zz f_x + sum_k L_z,k f_k,xx.

Where few quantities carry the effect of many, that takes half as many operations as derivatives of
the whole. Source: Gower, Mello, "A new framework for the computation of Hessians", Optim. Methods
Softw. 27 (2012), here by blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Places = NDArray[np.int64]
What = Literal["value", "jacobian", "by_numbers", "hessian"]


class Steps:
    """What a function computes on the way: quantities of its unknowns x and those before.

    Attributes
    ----------
    steps : list of (z (n,), f (n,), Steps)
        Symbols of a quantity, its value, and what that computes on the way.
    """

    def __init__(self) -> None:
        self.steps: list[tuple[ca.SX, ca.SX, Steps]] = []

    def name(self, value: ca.SX, through: Steps | None = None) -> ca.SX:
        """Return the symbols (n,) of a quantity (n,), to be used in its place."""
        z = ca.SX.sym(f"z{len(self.steps)}", value.numel())
        self.steps.append((z, ca.densify(value), through or Steps()))
        return z

    def resolved(self, r: ca.SX, weights: Sequence[tuple[ca.SX, ca.SX]] = ()) -> ca.SX:
        """Return an expression with the values of what it names in its place."""
        values = [(z, through.resolved(f)) for z, f, through in self.steps]
        pairs = [*values, *weights]
        if not pairs:
            return r
        names, values_of = (list(part) for part in zip(*pairs, strict=True))
        return ca.substitute_inplace(names, values_of, [r], False)[1][0]

    def jacobian(self, r: ca.SX, x: ca.SX) -> ca.SX:
        """Return dr/dx, and as the last column r, (n_r, n_x + 1) as an expression of symbols."""
        J, by_x = ca.jacobian(r, self._all(x)), ca.SX.eye(x.numel())
        for k, (_, f, through) in enumerate(self.steps):
            by_x = ca.vertcat(by_x, through.jacobian(f, self._all(x, k))[:, :-1] @ by_x)
        return self.resolved(ca.horzcat(J @ by_x if self.steps else J, r))

    def hessian(self, lam: ca.SX, r: ca.SX, x: ca.SX) -> ca.SX:
        """Return the Hessian of lam . r in x (n_x, n_x), an expression of x and other symbols."""
        H, gradient = ca.hessian(ca.dot(lam, r), self._all(x))
        weights = []
        for k, (z, f, through) in reversed(list(enumerate(self.steps))):
            before, weight = self._all(x, k), ca.SX.sym("weight", z.numel())
            n = before.numel()
            weights.append((weight, gradient[n:]))
            J = through.jacobian(f, before)[:, :-1]
            across = H[:n, n:] @ J
            H = H[:n, :n] + across + across.T + J.T @ (H[n:, n:] @ J)
            H = ca.triu2symm(ca.triu(H + through.hessian(weight, f, before)))
            gradient = gradient[:n] + J.T @ weight
        return self.resolved(H, weights)

    def _all(self, x: ca.SX, count: int | None = None) -> ca.SX:
        """Return x and the symbols of so many first steps, all unless told."""
        return ca.vertcat(x, *(z for z, _, _ in self.steps[:count]))


class Kernel:
    """Residuals r (SX) of unknowns y and numbers c, with their derivatives.

    Attributes
    ----------
    r : (n_r,)
        Residuals as expressions of y and c alone.
    value : casadi.Function
        y, c -> r.
    derivative : callable
        What -> a function for the nonzeros of a derivative, and the place of each; made once. Of
        y, c -> dr/dy, and besides its nonzeros r, or dr/dc; y, c, lam -> the Hessian of lam . r in
        y.
    """

    def __init__(
        self, name: str, y: ca.SX, c: ca.SX, r: ca.SX, through: Steps | None = None
    ) -> None:
        self.name, self.y, self.c = name, y, c
        self._through, self._r = through or Steps(), ca.densify(r)
        self.derivative = cache(self._differentiated)
        self.r = self._through.resolved(self._r)
        self.value = ca.Function(name, [y, c], [self.r], {"cse": True})

    def part(self, name: str, rows: slice) -> Kernel:
        """Return the kernel of some of the residuals."""
        return Kernel(name, self.y, self.c, self._r[rows], self._through)

    def in_numbers(self) -> Kernel:
        """Return the same residuals with the numbers among the unknowns, behind the others."""
        y, none = ca.vertcat(self.y, self.c), ca.SX.sym("none", 0)
        return Kernel(f"{self.name}_in_numbers", y, none, self._r, self._through)

    def _differentiated(self, what: What) -> tuple[ca.Function, Places, Places]:
        lam, also = ca.SX.sym("lam", self.r.numel()), list[ca.SX]()
        if what == "jacobian":
            whole = self._through.jacobian(self._r, self.y)
            A, also = whole[:, :-1], [ca.densify(whole[:, -1])]
        elif what == "by_numbers":
            A = ca.jacobian(self.r, self.c)
        else:
            A = self._through.hessian(lam, self._r, self.y)
        rows, columns = (np.array(v, dtype=np.int64) for v in A.sparsity().get_triplet())
        # What is there twice, a tenth of the operations, stays: to look for it takes as long as all
        # else that is built, and evaluations take no longer.
        inputs = [self.y, self.c, lam][: 2 + (what == "hessian")]
        # Of a matrix of one row CasADi gives them in a row.
        values = ca.vec(A.nz[:])
        return ca.Function(f"{self.name}_{what}", inputs, [values, *also]), rows, columns
