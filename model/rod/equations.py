"""Equations that are sums of small kernels, each repeated over the arm, and their derivatives.

A term is a kernel (octoplan.model.rod.kernels) with the places of its unknowns and rows
in the whole. The derivatives of all repetitions are added up in the sparse Jacobian and Hessian, in
numbers, and for CasADi's solvers in its symbols, by `map` and a constant matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np
from scipy.sparse import csr_array

from octoplan.model.paths import Array
from octoplan.model.rod.kernels import Kernel, Places, What
from octoplan.model.support.machine.compiled import kernels
from octoplan.model.support.machine.functions import (
    FEW,
    BatchFunction,
    BufferedFunction,
    VectorInterpreter,
    cached,
)


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


# Kernel name -> parameter name -> values (size, N) of its repetitions.
ParameterValues = dict[str, dict[str, Array]]


class Equations:
    """The sum of terms: residuals g (n_g,) of unknowns x (n_x,) and parameters p (n_p,).

    The parameters are those of the terms, one after the other, each repetition by repetition. With
    `machine_code` the kernels are compiled; then nothing can be differentiated by CasADi.

    Attributes
    ----------
    value : AssembledValue
        Of (x, p): g.
    jacobian, parameter_jacobian : AssembledValue
        Of (x, p): dg/dx and as a last column g (n_g, n_x + 1); dg/dp (n_g, n_p).
    hessian : AssembledValue
        Of (x, p, lam): the Hessian of lam . g in x (n_x, n_x), all of it.
    """

    def __init__(self, n_x: int, n_g: int, terms: list[Term], machine_code: bool = False) -> None:
        self.machine_code = machine_code
        self.n_x = n_x
        self.n_g = n_g
        self.terms = [term for term in terms if term.count]
        ends = np.cumsum([0, *(term.kernel.c.numel() * term.count for term in self.terms)])
        self.slices = [slice(a, b) for a, b in pairwise(ends.tolist())]
        self.n_p = int(ends[-1])
        self.value = AssembledValue(self, "value", (n_g, 1))
        self.jacobian = AssembledValue(self, "jacobian", (n_g, n_x + 1))
        self.parameter_jacobian = AssembledValue(self, "parameter_jacobian", (n_g, self.n_p))
        self.hessian = AssembledValue(self, "hessian", (n_x, n_x))

    def vector(self, parameters: ParameterValues) -> Array:
        """Return the parameters p (n_p,) by kernel and name, each (size, N)."""
        p = np.empty(self.n_p)
        for kernel, places in self.named(p).items():
            for name, place in places.items():
                place[:] = parameters[kernel][name]
        return p

    def named(self, p: Array) -> ParameterValues:
        """Return views (size, N, ...) of the parameters p (n_p, ...), by kernel and name.

        Or of changes of the parameters (n_p, K).
        """
        result: ParameterValues = {}
        for term, places in zip(self.terms, self.slices, strict=True):
            columns = p[places].reshape(term.count, -1, *p.shape[1:])
            result[term.kernel.name] = {
                name: columns[:, rows].swapaxes(0, 1) for name, rows in term.kernel.slices.items()
            }
        return result

    def with_parameters_as_variables(self) -> Equations:
        """Return the same equations with the numbers among the unknowns, behind the others."""
        terms = []
        for term, of in zip(self.terms, self.slices, strict=True):
            values = np.arange(of.start, of.stop).reshape((-1, term.count), order="F")
            places = np.vstack([term.unknowns, self.n_x + values])
            terms.append(Term(term.kernel.with_parameters_as_variables(), places, term.rows))
        return Equations(self.n_x + self.n_p, self.n_g, terms)

    def along_parameters(self, x: Array, p: Array, change: Array) -> Array:
        """Return the derivatives of residuals (n_g, K) along changes of the numbers (n_p, K)."""
        nonzeros = self.parameter_jacobian(x, p)
        J = csr_array((nonzeros, self.parameter_jacobian.triplet), (self.n_g, self.n_p))
        return np.asarray(J @ change)


class AssembledValue:
    """What the kernels of equations add up to: the nonzeros of the residuals or of a derivative."""

    def __init__(self, of: Equations, what: What, shape: tuple[int, int]) -> None:
        self._of, self._what, self._shape = of, what, shape

    @property
    def places(self) -> ca.Sparsity:
        """Where the nonzeros are."""
        rows, columns = self.triplet
        return ca.Sparsity.triplet(*self._shape, rows.tolist(), columns.tolist())

    @property
    def triplet(self) -> tuple[Places, Places]:
        """Rows and columns of the nonzeros."""
        return self._placed[:2]

    @cached_property
    def _placed(self) -> tuple[Places, Places, Places]:
        """Rows and columns of the nonzeros, and to which of them each value of the kernels adds."""
        of, what, (height, _) = self._of, self._what, self._shape
        if what == "value":
            rows = [np.zeros(0, np.int64), *(term.rows.ravel("F") for term in of.terms)]
            return np.arange(height), np.zeros(height, np.int64), np.concatenate(rows)
        keys = [np.zeros(0, np.int64)]
        for term, numbers in zip(of.terms, of.slices, strict=True):
            _, i, j = term.kernel.derivative(what)
            values = np.arange(numbers.start, numbers.stop).reshape((-1, term.count), order="F")
            columns = (values if what == "parameter_jacobian" else term.unknowns)[j]
            rows_of = (term.unknowns if what == "hessian" else term.rows)[i]
            keys.append((columns * height + rows_of).ravel("F"))
            if what == "jacobian":
                keys.append((of.n_x * height + term.rows).ravel("F"))
        order, index = np.unique(np.concatenate(keys), return_inverse=True)
        return order % height, order // height, index

    def __call__(self, x: Array, *value: Array) -> Array:
        """Return the nonzeros by x and p, and lam for the Hessian. Raises CompilerError.

        Of values and Jacobians those of many unknowns (M, n_x), too, as (M, nonzeros).
        """
        rows, _, index = self._placed
        if x.ndim == 1:
            values = self._each.flat(x, *value)
            return np.bincount(index, values, rows.size).astype(float, copy=False)
        if len(x) == 1:
            return self(x[0], *value)[None]
        most = max((term.count for term in self._of.terms), default=0)
        if (self._of.machine_code or len(x) * most > FEW) and all(self._columns):
            return self._side_by_side(x, *value)
        return np.array([self(row, *value) for row in x])

    def _side_by_side(self, x: Array, p: Array) -> Array:
        """Return the nonzeros (M, nonzeros) by many unknowns (M, n_x), and p."""
        unknowns, values = np.ascontiguousarray(x.T), []
        for run, term, numbers in zip(self._columns, self._of.terms, self._of.slices, strict=True):
            assert run is not None
            y, c = unknowns[term.unknowns], p[numbers].reshape(term.count, -1).T
            results = run(y.reshape(len(y), -1), np.repeat(c, len(x), axis=1))
            values += [r.reshape(-1, len(x)) for r in results]
        return np.ascontiguousarray((self._adding @ np.concatenate(values)).T)

    @cached_property
    def _columns(self) -> list[VectorInterpreter | None]:
        """The kernels for all repetitions of many unknowns; None for what these cannot do."""
        return [
            cached(BatchFunction, each, self._of.machine_code).columns for each in self._functions
        ]

    @cached_property
    def _adding(self) -> csr_array:
        """The matrix that adds values, those of each kernel row by row, to nonzeros."""
        rows, _, index = self._placed
        ends, order = 0, []
        for term, each in zip(self._of.terms, self._functions, strict=True):
            for k in range(each.n_out()):
                size = term.count * each.numel_out(k)
                order.append(ends + np.arange(size).reshape(term.count, -1).ravel("F"))
                ends += size
        at = index[np.concatenate(order)]
        return csr_array((np.ones(at.size), (at, np.arange(at.size))), (rows.size, at.size))

    @cached_property
    def function(self) -> ca.Function:
        """The same as an expression, for CasADi's solvers. Raises CompilerError."""
        (rows, _, at), arguments = self._placed, self._each.function.mx_in()
        add = ca.Sparsity(rows.size, at.size, list(range(at.size + 1)), at.tolist())
        values = ca.vertcat(*(ca.vec(part) for part in self._each.function.call(arguments)))
        return ca.Function(self._what, arguments, [ca.DM(add, 1.0) @ values])

    @cached_property
    def _each(self) -> BufferedFunction:
        """The values of the kernels: the results of each, whose columns are repetitions."""
        of, what = self._of, self._what
        sizes = [("x", of.n_x), ("p", of.n_p), ("lam", of.n_g)]
        arguments = [ca.MX.sym(name, size) for name, size in sizes[: 3 if what == "hessian" else 2]]
        x, p, *lam = arguments
        functions, results = kernels(self._functions, of.machine_code), []
        for f, term, numbers in zip(functions, of.terms, of.slices, strict=True):
            # Unknowns, numbers and any multipliers, repetitions as columns.
            gathered = [x[term.unknowns.ravel("F").tolist()], p[numbers]]
            gathered += [weights[term.rows.ravel("F").tolist()] for weights in lam]
            columns = [ca.reshape(values, -1, term.count) for values in gathered]
            results += f.map(term.count).call(columns)
        return BufferedFunction(ca.Function(f"{what}_of_kernels", arguments, results))

    @property
    def _functions(self) -> list[ca.Function]:
        """What each kernel adds, once."""
        what, terms = self._what, [term.kernel for term in self._of.terms]
        return [each.value if what == "value" else each.derivative(what)[0] for each in terms]
