"""Equations that are sums of small kernels, each repeated over the arm, and their derivatives.

A kernel is a function of a few unknowns and numbers; a term is a kernel with the places of its
unknowns and rows in the whole. The derivatives of all repetitions are added up in the sparse
Jacobian and Hessian, in CasADi's symbols: by `map` and a constant matrix.

What a kernel computes on the way, it may name: of unknowns y, intermediate quantities z_1 to z_K
one after the other, of all these residuals r. CasADi differentiates each step by itself, and the
chain rule puts the steps together from the last to the first, for Jacobians and Hessians alike.
With z = f(x) a step, x all that comes before, and L the rest as a function of both,

    L'(x)  <-  L_x + L_z f_x
    L''(x) <-  L_xx + L_xz f_x + f_x^T L_zx + f_x^T L_zz f_x + sum_k L_z,k f_k,xx.

Where few quantities carry the effect of many, that takes half as many operations as derivatives of
the whole. Source: Gower, Mello, "A new framework for the computation of Hessians", Optim. Methods
Softw. 27 (2012), here by blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from model.machine.buffered import Buffered
from model.machine.compiled import built, kernels
from model.paths import Array

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
        """Return dr/dx (n_r, n_x) as an expression of x and other symbols."""
        J = ca.jacobian(r, self._all(x))
        for k, (_, f, through) in reversed(list(enumerate(self.steps))):
            before = self._all(x, k)
            n = before.numel()
            J = J[:, :n] + J[:, n:] @ through.jacobian(f, before)
        return self.resolved(J)

    def hessian(self, lam: ca.SX, r: ca.SX, x: ca.SX) -> ca.SX:
        """Return the Hessian of lam . r in x (n_x, n_x), an expression of x and other symbols."""
        H, gradient = ca.hessian(ca.dot(lam, r), self._all(x))
        weights = []
        for k, (z, f, through) in reversed(list(enumerate(self.steps))):
            before, weight = self._all(x, k), ca.SX.sym("weight", z.numel())
            n = before.numel()
            weights.append((weight, gradient[n:]))
            J = through.jacobian(f, before)
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
    """

    def __init__(
        self, name: str, y: ca.SX, c: ca.SX, r: ca.SX, through: Steps | None = None
    ) -> None:
        self.name, self.y, self.c = name, y, c
        self._through, self._r = through or Steps(), ca.densify(r)
        self._derivatives: dict[What, tuple[ca.Function, Places, Places]] = {}
        self.r = self._through.resolved(self._r)
        self.value = ca.Function(name, [y, c], [self.r], {"cse": True})

    def derivative(self, what: What) -> tuple[ca.Function, Places, Places]:
        """Return a function for the nonzeros of a derivative, and the place of each; made once.

        y, c -> dr/dy or dr/dc; y, c, lam -> the Hessian of lam . r in y.
        """
        if what not in self._derivatives:
            self._derivatives[what] = self._differentiated(what)
        return self._derivatives[what]

    def in_numbers(self) -> Kernel:
        """Return the same residuals with the numbers among the unknowns, behind the others."""
        y, none = ca.vertcat(self.y, self.c), ca.SX.sym("none", 0)
        return Kernel(f"{self.name}_in_numbers", y, none, self._r, self._through)

    def _differentiated(self, what: What) -> tuple[ca.Function, Places, Places]:
        lam = ca.SX.sym("lam", self.r.numel())
        if what == "jacobian":
            A = self._through.jacobian(self._r, self.y)
        elif what == "by_numbers":
            A = ca.jacobian(self.r, self.c)
        else:
            A = self._through.hessian(lam, self._r, self.y)
        rows, columns = (np.array(v, dtype=np.int64) for v in A.sparsity().get_triplet())
        # What is there twice, a tenth of the operations, stays: to look for it takes as long as all
        # else that is built, and evaluations take no longer.
        inputs = [self.y, self.c, lam][: 2 + (what == "hessian")]
        values = A.nz[:] if rows.size else ca.SX(0, 1)
        return ca.Function(f"{self.name}_{what}", inputs, [values]), rows, columns


class Tangent(Kernel):
    """The derivative of a kernel along changes of some of its unknowns, and of its numbers.

    Attributes
    ----------
    of : Kernel
    change_of : (n_y,) of int
        Place of each unknown's change among all unknowns, which begin with those of `of`; -1 for
        unknowns that stay.
    """

    def __init__(self, name: str, of: Kernel, rows: tuple[int, ...], by_numbers: bool) -> None:
        self.of, n = of, of.y.numel()
        change = ca.SX.sym("change", len(rows))
        numbers = ca.SX.sym("numbers", of.c.numel() * by_numbers)
        self.change_of = np.full(n, -1, dtype=np.int64)
        self.change_of[list(rows)] = n + np.arange(len(rows))
        self._dy = ca.SX.zeros(n)
        self._dy[list(rows)] = change
        self._dc = numbers if by_numbers else ca.SX.zeros(of.c.numel())
        super().__init__(
            name, ca.vertcat(of.y, change), ca.vertcat(of.c, numbers), self._along(of.r)
        )

    def _differentiated(self, what: What) -> tuple[ca.Function, Places, Places]:
        """See Kernel: (J', J), and (H', H; H, 0)."""
        if what == "by_numbers":
            return super()._differentiated(what)
        lam, symmetric = ca.SX.sym("lam", self.r.numel()), what == "hessian"
        function, i, j = self.of.derivative(what)
        whole = function(*[self.of.y, self.of.c, lam][: 2 + symmetric])
        changed = ca.sparsify(self._along(whole))
        kept = np.array(changed.sparsity().row(), dtype=np.int64)
        also = np.flatnonzero(self.change_of[j] >= 0)
        across, change = whole[also.tolist()], self.change_of[j[also]]
        rows, columns = [i[kept], i[also]], [j[kept], change]
        values = [changed.nz[:] if kept.size else ca.SX(0, 1), across]
        if symmetric:
            rows, columns, values = [*rows, change], [*columns, i[also]], [*values, across]
        inputs = [self.y, self.c, lam][: 2 + symmetric]
        # What the kernel's own share, their derivatives share already.
        result = ca.Function(f"{self.name}_{what}", inputs, [ca.densify(ca.vertcat(*values))])
        return result, np.concatenate(rows), np.concatenate(columns)

    def _along(self, r: ca.SX) -> ca.SX:
        """Return the derivative of an expression along the changes."""
        return ca.jtimes(r, self.of.y, self._dy) + ca.jtimes(r, self.of.c, self._dc)


def tangent(kernel: Kernel) -> Tangent:
    """Return the derivative of a kernel along changes of all its unknowns and numbers."""
    every = tuple(range(kernel.y.numel()))
    return built(Tangent, f"{kernel.name}_tangent", kernel, every, True)


def mode(kernel: Kernel, rows: tuple[int, ...]) -> Tangent:
    """Return the derivative of a kernel along changes of some of its unknowns, by their rows."""
    return built(Tangent, f"{kernel.name}_mode", kernel, rows, False)


@dataclass(frozen=True, eq=False)
class Term:
    """A kernel repeated N times.

    Attributes
    ----------
    kernel : Kernel
    unknowns : (n_y, N)
        Place of each of its unknowns among all.
    rows : (n_r, N)
        Place of each of its residuals among all.
    """

    kernel: Kernel
    unknowns: Places
    rows: Places

    @property
    def count(self) -> int:
        """How often the kernel is repeated."""
        return int(self.unknowns.shape[1])

    @property
    def n_numbers(self) -> int:
        """How many numbers all repetitions have together."""
        return int(self.kernel.c.numel() * self.count)


class Equations:
    """The sum of terms: residuals g (n_g,) of unknowns x (n_x,) and numbers p (n_p,).

    The numbers are those of the terms, one after the other, each column by column. With
    `machine_code` the kernels are compiled; then nothing can be differentiated by CasADi.

    Attributes
    ----------
    value : Sum
        Of (x, p): g.
    jacobian, by_numbers : Sum
        Of (x, p): dg/dx (n_g, n_x), dg/dp (n_g, n_p).
    hessian : Sum
        Of (x, p, lam): the Hessian of lam . g in x (n_x, n_x), all of it.
    """

    def __init__(self, n_x: int, n_g: int, terms: list[Term], machine_code: bool = False) -> None:
        self.machine_code = machine_code
        self.n_x, self.n_g, self.terms = n_x, n_g, [term for term in terms if term.count]
        ends = np.cumsum([0, *(term.n_numbers for term in self.terms)])
        self.slices = [slice(a, b) for a, b in pairwise(ends.tolist())]
        self.n_p = int(ends[-1])
        names = (term.kernel.name for term in self.terms)
        self._numbers = dict(zip(names, self.slices, strict=True))
        self.value, self.jacobian = Sum(self, "value", (n_g, 1)), Sum(self, "jacobian", (n_g, n_x))
        self.by_numbers = Sum(self, "by_numbers", (n_g, self.n_p))
        self.hessian = Sum(self, "hessian", (n_x, n_x))

    def numbers_of(self, name: str) -> slice:
        """Return where the numbers of a kernel, by its name, are among all."""
        return self._numbers[name]

    def in_numbers(self) -> Equations:
        """Return the same equations with the numbers among the unknowns, behind the others."""
        terms = []
        for term, of in zip(self.terms, self.slices, strict=True):
            values = np.arange(of.start, of.stop).reshape((-1, term.count), order="F")
            places = np.vstack([term.unknowns, self.n_x + values])
            terms.append(Term(term.kernel.in_numbers(), places, term.rows))
        return Equations(self.n_x + self.n_p, self.n_g, terms)

    def along_numbers(self, x: Array, p: Array, change: Array) -> Array:
        """Return the derivatives of residuals (n_g, K) along changes of the numbers (n_p, K)."""
        nonzeros = self.by_numbers(x, p)
        J = csr_array((nonzeros, self.by_numbers.triplet), (self.n_g, self.n_p))
        return np.asarray(J @ change)


class Sum:
    """What the kernels of equations add up to: the nonzeros of the residuals or of a derivative."""

    def __init__(self, of: Equations, what: What, shape: tuple[int, int]) -> None:
        self._of, self._what, self._shape = of, what, shape

    @property
    def places(self) -> ca.Sparsity:
        """Where the nonzeros are."""
        return self._placed[0]

    @cached_property
    def triplet(self) -> tuple[Places, Places]:
        """Rows and columns of the nonzeros."""
        rows, columns = (np.array(part, dtype=np.int64) for part in self.places.get_triplet())
        return rows, columns

    @cached_property
    def _placed(self) -> tuple[ca.Sparsity, list[Places]]:
        """Where the nonzeros are, and to which of them each term's add."""
        of, what = self._of, self._what
        if what == "value":
            return ca.Sparsity.dense(of.n_g), [term.rows for term in of.terms]
        rows, columns = [], []
        for term, numbers in zip(of.terms, of.slices, strict=True):
            _, i, j = term.kernel.derivative(what)
            values = np.arange(numbers.start, numbers.stop).reshape((-1, term.count), order="F")
            rows.append((term.unknowns if what == "hessian" else term.rows)[i])
            columns.append((values if what == "by_numbers" else term.unknowns)[j])
        return _sparse(rows, columns, self._shape)

    def __call__(self, *value: Array) -> Array:
        """Return the nonzeros by x and p, and lam for the Hessian. Raises CompilerError."""
        values = np.concatenate([part.ravel() for part in self._each(*value)])
        return np.bincount(self._added, values, self.places.nnz()).astype(float, copy=False)

    @cached_property
    def function(self) -> ca.Function:
        """The same as an expression, for CasADi's solvers. Raises CompilerError."""
        at, arguments = self._added, self._each.function.mx_in()
        add = ca.Sparsity(self.places.nnz(), at.size, list(range(at.size + 1)), at.tolist())
        values = ca.vertcat(*(ca.vec(part) for part in self._each.function.call(arguments)))
        return ca.Function(self._what, arguments, [ca.DM(add, 1.0) @ values])

    @cached_property
    def _added(self) -> Places:
        """Where each value of the kernels is added."""
        return np.concatenate([np.zeros(0, np.int64), *(at.ravel("F") for at in self._placed[1])])

    @cached_property
    def _each(self) -> Buffered:
        """The values of the kernels: a result of each, whose columns are repetitions."""
        of, what = self._of, self._what
        sizes = [("x", of.n_x), ("p", of.n_p), ("lam", of.n_g)]
        arguments = [ca.MX.sym(name, size) for name, size in sizes[: 3 if what == "hessian" else 2]]
        terms = [term.kernel for term in of.terms]
        functions = kernels(
            [each.value if what == "value" else each.derivative(what)[0] for each in terms],
            of.machine_code,
        )
        results = [
            f.map(term.count)(*self._arguments_of(k, arguments))
            for k, (f, term) in enumerate(zip(functions, of.terms, strict=True))
        ]
        return Buffered(ca.Function(f"{what}_of_kernels", arguments, results))

    def _arguments_of(self, k: int, arguments: list[ca.MX]) -> list[ca.MX]:
        """Return a term's unknowns, numbers and any multipliers, repetitions as columns."""
        (x, p, *lam), term = arguments, self._of.terms[k]
        gathered = [x[term.unknowns.ravel("F").tolist()], p[self._of.slices[k]]]
        gathered += [weights[term.rows.ravel("F").tolist()] for weights in lam]
        return [ca.reshape(values, -1, term.count) for values in gathered]


def _sparse(
    rows: list[Places], columns: list[Places], shape: tuple[int, int]
) -> tuple[ca.Sparsity, list[Places]]:
    """Return the sparsity of a matrix with entries at rows and columns, and where each one is."""
    keys = [(j * shape[0] + i).astype(np.int64) for i, j in zip(rows, columns, strict=True)]
    order, index = np.unique(np.concatenate([key.ravel("F") for key in keys]), return_inverse=True)
    ends = np.searchsorted(order, np.arange(shape[1] + 1) * shape[0])
    places = ca.Sparsity(*shape, ends.tolist(), (order % shape[0]).tolist())
    cuts = np.cumsum([key.size for key in keys])[:-1]
    parts = np.split(index, cuts)
    return places, [
        part.reshape(key.shape, order="F") for part, key in zip(parts, keys, strict=True)
    ]
