"""The chain rule: equations that are sums of small kernels, each repeated over the arm.

A kernel (model.transcription.kernel) is a function of a few unknowns and numbers; a term is a
kernel with the places of its unknowns and rows in the whole. The derivatives of all repetitions are
added up in the sparse Jacobian and Hessian: in CasADi's symbols by `map` and a constant matrix, or
by C, a few repetitions side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import casadi as ca
import numpy as np

from model.machine.buffered import Buffered
from model.machine.compiled import kernels
from model.machine.repeated import InC, Repeated, can_be_in_c
from model.transcription.kernel import Kernel, Places

What = Literal["value", "jacobian", "by_numbers", "hessian"]


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


@dataclass(frozen=True, eq=False)
class _Sum:
    """What repeated kernels add up to: the nonzeros of a matrix at `places`."""

    parts: Sequence[Repeated]
    places: ca.Sparsity


class Equations:
    """The sum of terms: residuals g (n_g,) of unknowns x (n_x,) and numbers p (n_p,).

    The numbers are those of the terms, one after the other, each column by column. With
    `machine_code` the kernels are compiled; then nothing can be differentiated by CasADi.
    """

    def __init__(self, n_x: int, n_g: int, terms: list[Term], machine_code: bool = False) -> None:
        self.machine_code = machine_code
        self.n_x, self.n_g, self.terms = n_x, n_g, [term for term in terms if term.count]
        ends = np.cumsum([0, *(term.n_numbers for term in self.terms)])
        self.slices = [slice(a, b) for a, b in pairwise(ends.tolist())]
        self.n_p = int(ends[-1])
        self._sums: dict[What, _Sum] = {}

    def numbers_of(self, name: str) -> slice:
        """Return where the numbers of a kernel, by its name, are among all."""
        names = [term.kernel.name for term in self.terms]
        return self.slices[names.index(name)]

    @cached_property
    def value(self) -> ca.Function:
        """Unknowns, numbers -> residuals."""
        return self._function("value")

    @cached_property
    def jacobian(self) -> tuple[ca.Function, ca.Sparsity]:
        """(x, p -> nonzeros of dg/dx), and their places."""
        return self._function("jacobian"), self.places("jacobian")

    @cached_property
    def by_numbers(self) -> tuple[ca.Function, ca.Sparsity]:
        """(x, p -> nonzeros of dg/dp), and their places."""
        return self._function("by_numbers"), self.places("by_numbers")

    @cached_property
    def hessian(self) -> tuple[ca.Function, ca.Sparsity]:
        """(x, p, lam -> nonzeros of the Hessian of lam . g), and their places: all, symmetric."""
        return self._function("hessian"), self.places("hessian")

    def places(self, what: What) -> ca.Sparsity:
        """Return where the nonzeros of one of the above are."""
        return self._sum(what).places

    def call(self, what: What) -> Buffered | InC:
        """Return one of the above to be called with numbers, for a row of values.

        Compiled kernels are called from C, if they are short. Raises CompilerError.
        """
        of = self._sum(what)
        if self.machine_code and can_be_in_c(of.parts):
            return InC(of.parts, of.places.nnz())
        return Buffered(self._function(what))

    def _sum(self, what: What) -> _Sum:
        if what not in self._sums:
            self._sums[what] = self._value() if what == "value" else self._derived(what)
        return self._sums[what]

    def _value(self) -> _Sum:
        pairs = zip(self.terms, self.slices, strict=True)
        parts = [Repeated(t.kernel.value, t.unknowns, t.rows, t.rows, p.start) for t, p in pairs]
        return _Sum(parts, ca.Sparsity.dense(self.n_g))

    def _derived(self, what: What) -> _Sum:
        """Return the sum of what derivatives of the kernels add to the nonzeros of the whole."""
        found, rows, columns = [], [], []
        for term, numbers in zip(self.terms, self.slices, strict=True):
            function, i, j = getattr(term.kernel, what)
            own = np.arange(numbers.start, numbers.stop).reshape((-1, term.count), order="F")
            rows.append((term.unknowns if what == "hessian" else term.rows)[i])
            columns.append((own if what == "by_numbers" else term.unknowns)[j])
            found.append((function, term, numbers.start))
        shape = {
            "jacobian": (self.n_g, self.n_x),
            "by_numbers": (self.n_g, self.n_p),
            "hessian": (self.n_x, self.n_x),
        }[what]
        places, index = _sparse(rows, columns, shape)
        parts = [
            Repeated(function, term.unknowns, term.rows, at, start)
            for (function, term, start), at in zip(found, index, strict=True)
            if at.size
        ]
        return _Sum(parts, places)

    def _function(self, what: What) -> ca.Function:
        """Return in symbols what is added up."""
        of = self._sum(what)
        sizes = [("x", self.n_x), ("p", self.n_p), ("lam", self.n_g)]
        given = [ca.MX.sym(name, size) for name, size in sizes[: 3 if what == "hessian" else 2]]
        functions = kernels((part.kernel for part in of.parts), self.machine_code)
        found = [
            ca.vec(function.map(part.count)(*_own(function, part, given)))
            for function, part in zip(functions, of.parts, strict=True)
        ]
        at = [part.places.ravel("F") for part in of.parts]
        add = _added(np.concatenate([np.zeros(0, np.int64), *at]), of.places.nnz())
        return ca.Function(what, given, [add @ ca.vertcat(ca.MX(0, 1), *found)])


def _own(kernel: ca.Function, part: Repeated, given: list[ca.MX]) -> list[ca.MX]:
    """Return what a kernel takes of unknowns, numbers and multipliers, repetitions as columns."""
    x, p, *lam = given
    numbers = p[part.numbers : part.numbers + part.count * kernel.numel_in(1)]
    gathered = [x[part.unknowns.ravel("F").tolist()], numbers]
    gathered += [weights[part.rows.ravel("F").tolist()] for weights in lam]
    return [ca.reshape(values, -1, part.count) for values in gathered]


def _added(places: Places, size: int) -> ca.DM:
    """Return the matrix that adds values up at their places."""
    at = ca.Sparsity(size, places.size, list(range(places.size + 1)), places.tolist())
    return ca.DM(at, 1.0)


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
