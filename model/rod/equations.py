"""Sparse equations that are sums of small kernels, each repeated along the arm; derivatives.

A term is a kernel (octoplan.model.rod.kernels) with the indices of its unknowns and rows. The
derivatives of all repetitions are added to the sparse Jacobian and Hessian: in numbers, and as
expressions for CasADi's solvers by `map` and a constant matrix.
"""

from __future__ import annotations

from collections import Counter
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
class PlacedKernel:
    """A kernel repeated N times, at places among unknowns and rows.

    Attributes
    ----------
    kernel : Kernel
    unknowns : (n_y, N)
        Index of each unknown of each repetition.
    rows : (n_r, N)
        Index of each residual of each repetition.
    """

    kernel: Kernel
    unknowns: Places
    rows: Places

    @property
    def count(self) -> int:
        """The number of repetitions N."""
        return int(self.unknowns.shape[1])


# Kernel name -> parameter name -> values (size, N) of its repetitions.
ParameterValues = dict[str, dict[str, Array]]


class Equations:
    """The sum of terms: residuals g (n_g,) of unknowns x (n_x,) and parameters p (n_p,).

    p contains the parameters term by term, and repetition by repetition in each term.

    Parameters
    ----------
    n_x, n_g : int
    terms : list of PlacedKernel
        Kernels with parameters have different names.
    machine_code : bool
        Whether the kernels are compiled; then CasADi cannot differentiate them.

    Attributes
    ----------
    value : AssembledValue
        (x, p) -> g.
    jacobian : AssembledValue
        (x, p) -> dg/dx with g as the last column (n_g, n_x + 1).
    parameter_jacobian : AssembledValue
        (x, p) -> dg/dp (n_g, n_p).
    hessian : AssembledValue
        (x, p, lam) -> the full Hessian of lam . g in x (n_x, n_x).
    """

    def __init__(
        self, n_x: int, n_g: int, terms: list[PlacedKernel], machine_code: bool = False
    ) -> None:
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

    @cached_property
    def _ambiguous(self) -> frozenset[str]:
        """Names that several kernels with parameters share."""
        count = Counter(term.kernel.name for term in self.terms if term.kernel.parameters)
        return frozenset(name for name, n in count.items() if n > 1)

    def vector(self, parameters: ParameterValues) -> Array:
        """Return the parameters p (n_p,) from values (size, N) by kernel and name.

        Raises ValueError if two kernels with parameters have the same name.
        """
        ambiguous = sorted(self._ambiguous)
        if ambiguous:
            raise ValueError(f"kernels = {ambiguous}: must have different names")
        p = np.empty(self.n_p)
        for kernel, views in self.named(p).items():
            for name, view in views.items():
                view[:] = parameters[kernel][name]
        return p

    def named(self, p: Array) -> ParameterValues:
        """Return views (size, N, ...) of the parameters p (n_p, ...), by kernel and name.

        Kernels that share a name are left out, because the name does not identify them.
        """
        result: ParameterValues = {}
        for term, part in zip(self.terms, self.slices, strict=True):
            if term.kernel.name in self._ambiguous:
                continue
            columns = p[part].reshape(term.count, -1, *p.shape[1:])
            result[term.kernel.name] = {
                name: columns[:, rows].swapaxes(0, 1) for name, rows in term.kernel.slices.items()
            }
        return result

    def with_parameters_as_variables(self) -> Equations:
        """Return the same equations with p as unknowns behind x."""
        terms = []
        for term, part in zip(self.terms, self.slices, strict=True):
            unknowns = np.vstack([term.unknowns, self.n_x + _columns(part, term.count)])
            terms.append(
                PlacedKernel(term.kernel.with_parameters_as_variables(), unknowns, term.rows)
            )
        return Equations(self.n_x + self.n_p, self.n_g, terms)

    def along_parameters(self, x: Array, p: Array, change: Array) -> Array:
        """Return the derivatives of the residuals (n_g, K) along changes of p (n_p, K)."""
        nonzeros = self.parameter_jacobian(x, p)
        J = csr_array((nonzeros, self.parameter_jacobian.triplet), (self.n_g, self.n_p))
        return np.asarray(J @ change)


def _columns(part: slice, count: int) -> Places:
    """Return the indices in a slice as (n, count): one column for each repetition."""
    return np.arange(part.start, part.stop).reshape((-1, count), order="F")


class AssembledValue:
    """The nonzeros of the residuals, or of a derivative, assembled from the values of the kernels.

    Parameters
    ----------
    equations : Equations
    what : {"value", "jacobian", "parameter_jacobian", "hessian"}
    shape : (int, int)
    """

    def __init__(self, equations: Equations, what: What, shape: tuple[int, int]) -> None:
        self._equations = equations
        self._what = what
        self._shape = shape

    @property
    def places(self) -> ca.Sparsity:
        """The sparsity pattern."""
        rows, columns = self.triplet
        return ca.Sparsity.triplet(*self._shape, rows.tolist(), columns.tolist())

    @property
    def triplet(self) -> tuple[Places, Places]:
        """Rows and columns of the nonzeros."""
        return self._scatter_index[:2]

    @cached_property
    def _scatter_index(self) -> tuple[Places, Places, Places]:
        """Rows and columns of the nonzeros, and the nonzero to which each kernel value is added."""
        equations = self._equations
        what = self._what
        height, _ = self._shape
        if what == "value":
            rows = [np.zeros(0, np.int64), *(term.rows.ravel("F") for term in equations.terms)]
            return np.arange(height), np.zeros(height, np.int64), np.concatenate(rows)
        keys = [np.zeros(0, np.int64)]
        for term, part in zip(equations.terms, equations.slices, strict=True):
            _, i, j = term.kernel.derivative(what)
            by_parameters = what == "parameter_jacobian"
            columns = _columns(part, term.count) if by_parameters else term.unknowns
            rows_of_term = term.unknowns if what == "hessian" else term.rows
            keys.append((columns[j] * height + rows_of_term[i]).ravel("F"))
            if what == "jacobian":
                keys.append((equations.n_x * height + term.rows).ravel("F"))
        order, index = np.unique(np.concatenate(keys), return_inverse=True)
        return order % height, order // height, index

    def __call__(self, x: Array, *value: Array) -> Array:
        """Return the nonzeros (nnz,) at x (n_x,) and p, and lam for the Hessian.

        Residuals and Jacobians at many unknowns (M, n_x) are (M, nnz). Raise CompilerError if the
        kernels cannot be compiled.
        """
        rows, _, index = self._scatter_index
        if x.ndim == 1:
            values = self._kernel_values.flat(x, *value)
            return np.bincount(index, values, rows.size).astype(float, copy=False)
        if len(x) == 1:
            return self(x[0], *value)[None]
        most = max((term.count for term in self._equations.terms), default=0)
        many = self._equations.machine_code or len(x) * most > FEW
        if many and all(self._interpreters):
            return self._side_by_side(x, *value)
        return np.array([self(row, *value) for row in x])

    def _side_by_side(self, x: Array, p: Array) -> Array:
        """Return the nonzeros (M, nnz) at many unknowns (M, n_x) and p."""
        unknowns = np.ascontiguousarray(x.T)
        values = []
        for run, term, part in zip(
            self._interpreters, self._equations.terms, self._equations.slices, strict=True
        ):
            assert run is not None
            y = unknowns[term.unknowns]
            c = p[part].reshape(term.count, -1).T
            results = run(y.reshape(len(y), -1), np.repeat(c, len(x), axis=1))
            values += [r.reshape(-1, len(x)) for r in results]
        return np.ascontiguousarray((self._scatter_matrix @ np.concatenate(values)).T)

    @cached_property
    def _interpreters(self) -> list[VectorInterpreter | None]:
        """The kernels for all repetitions of many unknowns; None for unsupported kernels."""
        machine_code = self._equations.machine_code
        return [cached(BatchFunction, each, machine_code).columns for each in self._functions]

    @cached_property
    def _scatter_matrix(self) -> csr_array:
        """The matrix that adds kernel values, of each kernel row by row, to the nonzeros."""
        rows, _, index = self._scatter_index
        end = 0
        order = []
        for term, each in zip(self._equations.terms, self._functions, strict=True):
            for k in range(each.n_out()):
                size = term.count * each.numel_out(k)
                order.append(end + np.arange(size).reshape(term.count, -1).ravel("F"))
                end += size
        targets = index[np.concatenate(order)]
        entries = (targets, np.arange(targets.size))
        return csr_array((np.ones(targets.size), entries), (rows.size, targets.size))

    @cached_property
    def function(self) -> ca.Function:
        """The same value as an expression, for CasADi's solvers. Raises CompilerError."""
        rows, _, index = self._scatter_index
        arguments = self._kernel_values.function.mx_in()
        columns = list(range(index.size + 1))
        scatter = ca.Sparsity(rows.size, index.size, columns, index.tolist())
        values = ca.vertcat(*(ca.vec(x) for x in self._kernel_values.function.call(arguments)))
        return ca.Function(self._what, arguments, [ca.DM(scatter, 1.0) @ values])

    @cached_property
    def _kernel_values(self) -> BufferedFunction:
        """The results of each kernel; the columns of a result are the repetitions."""
        equations = self._equations
        what = self._what
        sizes = [("x", equations.n_x), ("p", equations.n_p), ("lam", equations.n_g)]
        arguments = [ca.MX.sym(name, size) for name, size in sizes[: 3 if what == "hessian" else 2]]
        x, p, *lam = arguments
        functions = kernels(self._functions, equations.machine_code)
        results = []
        for f, term, part in zip(functions, equations.terms, equations.slices, strict=True):
            # Unknowns, parameters and any multipliers, with repetitions as columns.
            gathered = [x[term.unknowns.ravel("F").tolist()], p[part]]
            gathered += [weights[term.rows.ravel("F").tolist()] for weights in lam]
            columns = [ca.reshape(values, -1, term.count) for values in gathered]
            results += f.map(term.count).call(columns)
        return BufferedFunction(ca.Function(f"{what}_of_kernels", arguments, results))

    @property
    def _functions(self) -> list[ca.Function]:
        """The function of each kernel for one repetition."""
        what = self._what
        all_kernels = [term.kernel for term in self._equations.terms]
        return [each.value if what == "value" else each.derivative(what)[0] for each in all_kernels]
