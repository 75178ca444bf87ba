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

The last sum is differentiated at once for all definitions that share inner intermediates.
With few intermediates between many unknowns and many residuals, this takes half the operations of
the derivatives of r(y). Source: Gower, Mello, "A new framework for the computation of Hessians",
Optim. Methods Softw. 27 (2012), here by blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Literal, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Places = NDArray[np.int64]
# Returns symbols for an intermediate of an expression, see Intermediates.define.
Name = Callable[[ca.SX], ca.SX]
What = Literal["value", "jacobian", "parameter_jacobian", "hessian"]
# Depth of the expression trees that are compared to find values that are defined already.
_EQUAL_DEPTH = 12


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
        """Return symbols (n,) that represent a quantity (n,) in all later expressions.

        Values with the same `inner` share its derivatives; they must not depend on definitions
        since the first of them.
        """
        since = [k for k, (_, _, of_f) in enumerate(self.definitions) if of_f is inner][:1]
        later = ca.vertcat(ca.SX(0, 1), *(z for k in since for z, _, _ in self.definitions[k:]))
        if inner is not None and ca.depends_on(inner.substituted(value), later):
            raise ValueError("value: must not depend on definitions that share its intermediates")
        z = ca.SX.sym(f"z{len(self.definitions)}", value.numel())
        self.definitions.append((z, ca.densify(value), inner or Intermediates()))
        return z

    def define_all(self, values: Sequence[ca.SX]) -> list[ca.SX]:
        """Return the symbols of several quantities that do not depend on each other.

        One definition of all needs fewer steps of the chain rule than one definition of each.
        """
        ends = np.cumsum([0, *(value.numel() for value in values)]).tolist()
        parts: list[ca.SX] = ca.vertsplit(self.define(ca.vertcat(*values)), ends)
        return parts

    def define_once(self, value: ca.SX) -> ca.SX:
        """Return a constant unchanged, and the symbols of an equal value if there are any."""
        value = ca.densify(value)
        if value.is_constant():
            return value
        for z, f, _ in self.definitions:
            if f.shape == value.shape and ca.is_equal(f, value, _EQUAL_DEPTH):
                return z
        return self.define(value)

    def substituted(self, r: ca.SX, weights: Sequence[tuple[ca.SX, ca.SX]] = ()) -> ca.SX:
        """Substitute the values of all intermediates in an expression."""
        pairs = [*self._pairs(), *weights]
        if not pairs:
            return r
        names, values_of = (list(part) for part in zip(*pairs, strict=True))
        return ca.substitute_inplace(names, values_of, [r], False)[1][0]

    def jacobian(self, r: ca.SX, x: ca.SX) -> ca.SX:
        """Return the expression of dr/dx with r as the last column (n_r, n_x + 1)."""
        return self.substituted(ca.horzcat(self._jacobian(r, x, self._derivatives(x)), r))

    def hessian(self, lam: ca.SX, r: ca.SX, x: ca.SX) -> ca.SX:
        """Return the expression of the Hessian of lam . r in x (n_x, n_x)."""
        upper, weights = self._hessian(lam, r, x, self._derivatives(x))
        return ca.triu2symm(self.substituted(upper, weights))

    def _pairs(self) -> list[tuple[ca.SX, ca.SX]]:
        """Return symbols and values of all intermediates, inner ones before their values."""
        pairs: dict[int, list[tuple[ca.SX, ca.SX]]] = {}
        for members in self._groups():
            inner = self.definitions[members[0]][2]
            for k in members:
                pairs[k] = [self.definitions[k][:2]]
            pairs[members[0]] = [*inner._pairs(), *pairs[members[0]]]
        return [pair for _, each in sorted(pairs.items()) for pair in each]

    def _derivatives(self, x: ca.SX) -> list[_Group]:
        """Return the derivatives of all definitions, by groups with the same inner ones."""
        symbols = self._all(x)
        sizes = self._sizes(x)
        groups = []
        for members in self._groups():
            inner = self.definitions[members[0]][2]
            before = symbols[: sizes[members[0]]]
            values = ca.vertcat(*(self.definitions[k][1] for k in members))
            inside = inner._derivatives(before)
            J = inner._jacobian(values, before, inside)
            groups.append(_Group(members, inner, before, values, inside, J))
        return groups

    def _jacobians(self, x: ca.SX, groups: list[_Group]) -> list[ca.SX]:
        """Return the derivative of each definition by x and the intermediates before."""
        sizes = self._sizes(x)
        result: dict[int, ca.SX] = {}
        for members, _, before, _, _, J in groups:
            if len(members) == 1:
                result[members[0]] = J
                continue
            start = 0
            for k in members:
                stop = start + sizes[k + 1] - sizes[k]
                between = ca.SX(stop - start, sizes[k] - before.numel())
                result[k] = ca.horzcat(J[start:stop, :], between)
                start = stop
        return [J for _, J in sorted(result.items())]

    def _jacobian(self, r: ca.SX, x: ca.SX, groups: list[_Group]) -> ca.SX:
        """Return dr/dx as an expression of x and all intermediates."""
        J = ca.jacobian(r, self._all(x))
        if not groups:
            return J
        by_x = ca.SX.eye(x.numel())
        for each in self._jacobians(x, groups):
            by_x = ca.vertcat(by_x, each @ by_x)
        return J @ by_x

    def _hessian(
        self, lam: ca.SX, r: ca.SX, x: ca.SX, groups: list[_Group]
    ) -> tuple[ca.SX, list[tuple[ca.SX, ca.SX]]]:
        """Return the upper triangle of the Hessian of lam . r by x.

        The result is an expression of x, intermediates and weights L_z. The second result contains
        the symbols and the values of the weights.
        """
        H, gradient = ca.hessian(ca.dot(lam, r), self._all(x))
        H = ca.triu(H)
        jacobians = self._jacobians(x, groups)
        by_first = {group.members[0]: group for group in groups}
        weights = [ca.SX.sym("weight", J.size1()) for J in jacobians]
        values = list[tuple[ca.SX, ca.SX]]()
        for k in reversed(range(len(jacobians))):
            J = jacobians[k]
            n = J.size2()
            values.append((weights[k], gradient[n:]))
            gradient = gradient[:n] + J.T @ weights[k]
            across = H[:n, n:] @ J
            H = H[:n, :n] + across + across.T + J.T @ (ca.triu2symm(H[n:, n:]) @ J)
            if k in by_first:
                members, inner, before, f, inside, _ = by_first[k]
                lam_of = ca.vertcat(*(weights[i] for i in members))
                own, values_inside = inner._hessian(lam_of, f, before, inside)
                H += own
                values += values_inside
            H = ca.triu(H)
        return H, values

    def _groups(self) -> list[list[int]]:
        """Return the indices of definitions with the same inner intermediates, in order."""
        groups: dict[int, list[int]] = {}
        for k, (_, _, inner) in enumerate(self.definitions):
            groups.setdefault(id(inner), []).append(k)
        return list(groups.values())

    def _all(self, x: ca.SX) -> ca.SX:
        """Return x and the symbols of all intermediates."""
        return ca.vertcat(x, *(z for z, _, _ in self.definitions))

    def _sizes(self, x: ca.SX) -> list[int]:
        """Return the number of symbols before each definition, then of all."""
        sizes = [x.numel(), *(z.numel() for z, _, _ in self.definitions)]
        return [int(n) for n in np.cumsum(sizes)]


class _Group(NamedTuple):
    """Definitions with the same inner intermediates.

    Attributes
    ----------
    members : list of int
        Their indices.
    inner : Intermediates
    before, values : symbols, (n,)
        x and the intermediates before the first of them, and the values.
    inside : list of _Group
        Derivatives of the inner definitions.
    jacobian : (n, n_before)
        Derivative of the values, as an expression of `before` and the inner intermediates.
    """

    members: list[int]
    inner: Intermediates
    before: ca.SX
    values: ca.SX
    inside: list[_Group]
    jacobian: ca.SX


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
