"""Kernels: functions of a few unknowns and parameters, with their derivatives.

A kernel may define intermediates: quantities z_1 to z_K, each a function of the unknowns y and the
intermediates before. The residuals r are functions of y and all intermediates. CasADi
differentiates each definition separately, and the chain rule joins the derivatives: for Jacobians
from the first intermediate to the last, because there are as many residuals as unknowns,

    dz_k/dy = f_y + f_z dz/dy,        z_k = f(y, z), z all intermediates before,

and for Hessians from the last to the first. With a definition z = f(x), x all symbols before, and
the remaining function L(x, z),

    L'(x)  <-  L_x + L_z f_x
    L''(x) <-  L_xx + L_xz f_x + f_x^T L_zx + f_x^T L_zz f_x + sum_k L_z,k f_k,xx.

With few intermediates between many unknowns and many residuals, this takes half the operations of
the derivatives of r(y). Source: Gower, Mello, "A new framework for the computation of Hessians",
Optim. Methods Softw. 27 (2012), here by blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Places = NDArray[np.int64]
# Returns symbols for an intermediate of an expression, see Intermediates.define.
Name = Callable[[ca.SX], ca.SX]
What = Literal["value", "jacobian", "parameter_jacobian", "hessian"]


class Intermediates:
    """Intermediates of a function: quantities that depend on unknowns x and intermediates before.

    Attributes
    ----------
    definitions : list of (z (n,), f (n,), Intermediates)
        Symbols of a quantity, its value, and the intermediates of this value.
    """

    def __init__(self) -> None:
        self.definitions: list[tuple[ca.SX, ca.SX, Intermediates]] = []

    def define(self, value: ca.SX, inner: Intermediates | None = None) -> ca.SX:
        """Return symbols (n,) that represent a quantity (n,) in all later expressions."""
        z = ca.SX.sym(f"z{len(self.definitions)}", value.numel())
        self.definitions.append((z, ca.densify(value), inner or Intermediates()))
        return z

    def substituted(self, r: ca.SX, weights: Sequence[tuple[ca.SX, ca.SX]] = ()) -> ca.SX:
        """Substitute the values of all intermediates in an expression."""
        values = [(z, inner.substituted(f)) for z, f, inner in self.definitions]
        pairs = [*values, *weights]
        if not pairs:
            return r
        names, values_of = (list(part) for part in zip(*pairs, strict=True))
        return ca.substitute_inplace(names, values_of, [r], False)[1][0]

    def jacobian(self, r: ca.SX, x: ca.SX) -> ca.SX:
        """Return the expression of dr/dx with r as the last column (n_r, n_x + 1)."""
        J = ca.jacobian(r, self._all(x))
        by_x = ca.SX.eye(x.numel())
        for k, (_, f, inner) in enumerate(self.definitions):
            by_x = ca.vertcat(by_x, inner.jacobian(f, self._all(x, k))[:, :-1] @ by_x)
        return self.substituted(ca.horzcat(J @ by_x if self.definitions else J, r))

    def hessian(self, lam: ca.SX, r: ca.SX, x: ca.SX) -> ca.SX:
        """Return the expression of the Hessian of lam . r in x (n_x, n_x)."""
        H, gradient = ca.hessian(ca.dot(lam, r), self._all(x))
        weights = []
        for k, (z, f, inner) in reversed(list(enumerate(self.definitions))):
            before = self._all(x, k)
            weight = ca.SX.sym("weight", z.numel())
            n = before.numel()
            weights.append((weight, gradient[n:]))
            J = inner.jacobian(f, before)[:, :-1]
            across = H[:n, n:] @ J
            H = H[:n, :n] + across + across.T + J.T @ (H[n:, n:] @ J)
            H = ca.triu2symm(ca.triu(H + inner.hessian(weight, f, before)))
            gradient = gradient[:n] + J.T @ weight
        return self.substituted(H, weights)

    def _all(self, x: ca.SX, count: int | None = None) -> ca.SX:
        """Return x and the symbols of the first `count` intermediates, by default of all."""
        return ca.vertcat(x, *(z for z, _, _ in self.definitions[:count]))


class Kernel:
    """Residuals r (SX) of unknowns y and parameters, with their derivatives.

    Attributes
    ----------
    parameters : dict of (rows, columns)
        Symbols of the parameters, by name.
    c : (n_c,)
        All parameters, each column by column.
    slices : dict of slice
        Slice of each parameter in c.
    r : (n_r,)
        Residuals as expressions of y and c alone.
    value : casadi.Function
        y, c -> r.
    derivative : callable
        Returns the function of a derivative, and rows and columns of its nonzeros; cached.
        "jacobian": y, c -> nonzeros of dr/dy, r. "parameter_jacobian": y, c -> nonzeros of dr/dc.
        "hessian": y, c, lam -> nonzeros of the Hessian of lam . r in y.
    """

    def __init__(
        self,
        name: str,
        y: ca.SX,
        parameters: Mapping[str, ca.SX],
        r: ca.SX,
        intermediates: Intermediates | None = None,
    ) -> None:
        self.name = name
        self.y = y
        self.parameters = dict(parameters)
        self.c = ca.vertcat(ca.SX(0, 1), *(ca.vec(each) for each in self.parameters.values()))
        self.slices = dict[str, slice]()
        start = 0
        for key, each in self.parameters.items():
            self.slices[key] = slice(start, start + each.numel())
            start += each.numel()
        self._intermediates = intermediates or Intermediates()
        self._r = ca.densify(r)
        self.derivative = cache(self._differentiated)
        self.r = self._intermediates.substituted(self._r)
        self.value = ca.Function(name, [y, self.c], [self.r], {"cse": True})

    def part(self, name: str, rows: slice) -> Kernel:
        """Return the kernel of some of the residuals."""
        return Kernel(name, self.y, self.parameters, self._r[rows], self._intermediates)

    def with_parameters_as_variables(self) -> Kernel:
        """Return the same residuals with the parameters as unknowns behind y."""
        y = ca.vertcat(self.y, self.c)
        return Kernel(f"{self.name}_of_all", y, {}, self._r, self._intermediates)

    def _differentiated(self, what: What) -> tuple[ca.Function, Places, Places]:
        """Return the function of a derivative, and rows and columns of its nonzeros."""
        lam = ca.SX.sym("lam", self.r.numel())
        also = list[ca.SX]()
        if what == "jacobian":
            whole = self._intermediates.jacobian(self._r, self.y)
            A = whole[:, :-1]
            also = [ca.densify(whole[:, -1])]
        elif what == "parameter_jacobian":
            A = ca.jacobian(self.r, self.c)
        else:
            A = self._intermediates.hessian(lam, self._r, self.y)
        rows, columns = (np.array(v, dtype=np.int64) for v in A.sparsity().get_triplet())
        # Skip common-subexpression elimination: it saves 10 % of the operations but doubles the
        # build time, and evaluations are no faster.
        inputs = [self.y, self.c, lam][: 2 + (what == "hessian")]
        # CasADi returns the nonzeros of a matrix with one row as a row.
        values = ca.vec(A.nz[:])
        return ca.Function(f"{self.name}_{what}", inputs, [values, *also]), rows, columns
