"""The chain rule: equations that are sums of small kernels, each repeated over the arm.

A kernel (model.transcription.kernel) is a function of a few unknowns and numbers; a term is a
kernel with the places of its unknowns and rows in the whole. The derivatives of all repetitions are
evaluated by `map`, and put into the sparse Jacobian and Hessian by a constant matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from model.machine.compiled import kernels
from model.transcription.kernel import Kernel, Places


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
    value : casadi.Function
        x, p -> g.
    """

    def __init__(self, n_x: int, n_g: int, terms: list[Term], machine_code: bool = False) -> None:
        self.machine_code = machine_code
        self.n_x, self.n_g, self.terms = n_x, n_g, [term for term in terms if term.count]
        ends = np.cumsum([0, *(term.n_numbers for term in self.terms)])
        self.slices = [slice(a, b) for a, b in pairwise(ends.tolist())]
        self.n_p = int(ends[-1])

    def numbers_of(self, name: str) -> slice:
        """Return where the numbers of a kernel, by its name, are among all."""
        names = [term.kernel.name for term in self.terms]
        return self.slices[names.index(name)]

    @cached_property
    def value(self) -> ca.Function:
        """Unknowns, numbers -> residuals."""
        x, p, _ = self._symbols()
        rows = np.concatenate([term.rows.ravel("F") for term in self.terms])
        values = kernels((term.kernel.value for term in self.terms), self.machine_code)
        found = [
            ca.vec(value.map(term.count)(*given))
            for value, (term, given) in zip(values, self._given(x, p), strict=True)
        ]
        return ca.Function("value", [x, p], [_gathered(found, rows, self.n_g)])

    @cached_property
    def jacobian(self) -> tuple[ca.Function, ca.Sparsity]:
        """(x, p -> nonzeros of dg/dx), and their places."""
        return self._jacobian("jacobian", [term.unknowns for term in self.terms], self.n_x)

    @cached_property
    def by_numbers(self) -> tuple[ca.Function, ca.Sparsity]:
        """(x, p -> nonzeros of dg/dp), and their places."""
        own = zip(self.terms, self.slices, strict=True)
        columns = [
            np.arange(at.start, at.stop, dtype=np.int64).reshape((-1, term.count), order="F")
            for term, at in own
        ]
        return self._jacobian("by_numbers", columns, self.n_p)

    def _jacobian(
        self, what: str, places: list[Places], size: int
    ) -> tuple[ca.Function, ca.Sparsity]:
        """Return the nonzeros of a derivative of all kernels, by what stands at places."""
        x, p, _ = self._symbols()
        found, rows, columns = [], [], []
        derived = [getattr(term.kernel, what) for term in self.terms]
        kept = [k for k, (_, i, _) in enumerate(derived) if i.size]
        functions = kernels((derived[k][0] for k in kept), self.machine_code)
        given_all = self._given(x, p)
        for k, function in zip(kept, functions, strict=True):
            (_, i, j), (term, given), own = derived[k], given_all[k], places[k]
            found.append(ca.vec(function.map(term.count)(*given)))
            rows.append(term.rows[i].ravel("F"))
            columns.append(own[j].ravel("F"))
        nonzeros, at = _sparse(found, rows, columns, (self.n_g, size))
        return ca.Function(what, [x, p], [nonzeros]), at

    @cached_property
    def hessian(self) -> tuple[ca.Function, ca.Sparsity]:
        """(x, p, lam -> nonzeros of the Hessian of lam . g), and their places: all, symmetric."""
        x, p, lam = self._symbols()
        found, rows, columns = [], [], []
        curved = [part for part in self._given(x, p) if part[0].kernel.hessian[1].size]
        hessians = [term.kernel.hessian for term, _ in curved]
        functions = kernels((own[0] for own in hessians), self.machine_code)
        parts = zip(functions, hessians, curved, strict=True)
        for function, (_, i, j), (term, given) in parts:
            own = ca.reshape(lam[term.rows.ravel("F").tolist()], -1, term.count)
            found.append(ca.vec(function.map(term.count)(*given, own)))
            rows.append(term.unknowns[i].ravel("F"))
            columns.append(term.unknowns[j].ravel("F"))
        nonzeros, places = _sparse(found, rows, columns, (self.n_x, self.n_x))
        return ca.Function("hessian", [x, p, lam], [nonzeros]), places

    def _symbols(self) -> tuple[ca.MX, ca.MX, ca.MX]:
        sizes = (("x", self.n_x), ("p", self.n_p), ("lam", self.n_g))
        x, p, lam = (ca.MX.sym(name, size) for name, size in sizes)
        return x, p, lam

    def _given(self, x: ca.MX, p: ca.MX) -> list[tuple[Term, tuple[ca.MX, ca.MX]]]:
        """Return each term with the unknowns and numbers of all its repetitions as columns."""
        found = []
        for term, numbers in zip(self.terms, self.slices, strict=True):
            y = ca.reshape(x[term.unknowns.ravel("F").tolist()], -1, term.count)
            found.append((term, (y, ca.reshape(p[numbers], -1, term.count))))
        return found


def _gathered(values: list[ca.MX], places: Places, size: int) -> ca.MX:
    """Return the vector (size,) in which values are added up at their places."""
    stacked = ca.vertcat(*values)
    add = ca.Sparsity(size, places.size, list(range(places.size + 1)), places.tolist())
    return ca.DM(add, 1.0) @ stacked


def _sparse(
    values: list[ca.MX], rows: list[Any], columns: list[Any], shape: tuple[int, int]
) -> tuple[ca.MX, ca.Sparsity]:
    """Return the nonzeros of a sparse matrix whose entries are sums of values, and its sparsity."""
    i, j = np.concatenate(rows).astype(np.int64), np.concatenate(columns).astype(np.int64)
    order, index = np.unique(j * shape[0] + i, return_inverse=True)
    ends = np.searchsorted(order, np.arange(shape[1] + 1) * shape[0])
    places = ca.Sparsity(*shape, ends.tolist(), (order % shape[0]).tolist())
    return _gathered(values, index, places.nnz()), places
