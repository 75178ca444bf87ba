"""The chain rule: equations that are sums of small kernels, each repeated over the arm.

A kernel (model.transcription.kernel) is a function of a few unknowns and numbers; a term is a
kernel with the places of its unknowns and rows in the whole. The derivatives of all repetitions are
added up in the sparse Jacobian and Hessian, in CasADi's symbols: by `map` and a constant matrix.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, TypeVar

import casadi as ca
import numpy as np
from scipy.sparse import csr_array

from model.machine.buffered import Buffered, Mapped
from model.machine.compiled import kernels
from model.paths import Array
from model.transcription.kernel import Kernel, Places

T = TypeVar("T")
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
class _Part:
    """What a term, whose numbers begin at `numbers`, adds by a function at `places` (n_out, N)."""

    function: ca.Function
    term: Term
    places: Places
    numbers: int


@dataclass(frozen=True, eq=False)
class _Sum:
    """What repeated kernels add up to: the nonzeros of a matrix at `places`."""

    parts: Sequence[_Part]
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
        self._made: dict[tuple[str, What], Any] = {}

    def numbers_of(self, name: str) -> slice:
        """Return where the numbers of a kernel, by its name, are among all."""
        names = [term.kernel.name for term in self.terms]
        return self.slices[names.index(name)]

    @property
    def value(self) -> ca.Function:
        """Unknowns, numbers -> residuals."""
        return self._function("value")

    @property
    def jacobian(self) -> tuple[ca.Function, ca.Sparsity]:
        """(x, p -> nonzeros of dg/dx), and their places."""
        return self._function("jacobian"), self.places("jacobian")

    @property
    def hessian(self) -> tuple[ca.Function, ca.Sparsity]:
        """(x, p, lam -> nonzeros of the Hessian of lam . g), and their places: all, symmetric."""
        return self._function("hessian"), self.places("hessian")

    @cached_property
    def in_numbers(self) -> Equations:
        """The same equations with the numbers among the unknowns, behind the others."""
        terms = []
        for term, of in zip(self.terms, self.slices, strict=True):
            values = np.arange(of.start, of.stop).reshape((-1, term.count), order="F")
            places = np.vstack([term.unknowns, self.n_x + values])
            terms.append(Term(term.kernel.in_numbers, places, term.rows))
        return Equations(self.n_x + self.n_p, self.n_g, terms)

    def places(self, what: What) -> ca.Sparsity:
        """Return where the nonzeros of one of the above, or of "by_numbers", dg/dp, are."""
        return self._sum(what).places

    def triplet(self, what: What) -> tuple[Places, Places]:
        """Return rows and columns of these nonzeros."""
        return self._once("triplet", what, lambda: _triplet(self.places(what)))

    def call(self, what: What) -> Buffered:
        """Return one of the above to be called with numbers, for a row of values."""
        return self._once("call", what, lambda: Buffered(self._function(what)))

    def many(self, what: What) -> Many:
        """Return the same for many x (N, n_x) with one p: values (N, n)."""
        return self._once("many", what, lambda: Many(self._sum(what), self.machine_code))

    def moved_by_numbers(self, x: Array, p: Array, change: Array) -> Array:
        """Return how residuals move with numbers (n_p, K), at many x (N, n_x): (N, n_g, K)."""
        rows, columns = self.triplet("by_numbers")
        order = np.argsort(rows, kind="stable")
        parts, starts = np.unique(rows[order], return_index=True)
        products = self.many("by_numbers")(x, p)[:, order, None] * change[columns[order]]
        values = np.zeros((len(x), self.n_g, change.shape[1]))
        values[:, parts] = np.add.reduceat(products, starts, axis=1)
        return values

    def _once(self, kind: str, what: What, make: Callable[[], T]) -> T:
        """Return what is made when it is asked for first."""
        if (kind, what) not in self._made:
            self._made[kind, what] = make()
        made: T = self._made[kind, what]
        return made

    def _sum(self, what: What) -> _Sum:
        make = self._value if what == "value" else lambda: self._derived(what)
        return self._once("sum", what, make)

    def _function(self, what: What) -> ca.Function:
        """Return in symbols what is added up. Raises CompilerError."""
        return self._once("function", what, lambda: self._added(what))

    def _value(self) -> _Sum:
        pairs = zip(self.terms, self.slices, strict=True)
        parts = [_Part(t.kernel.value, t, t.rows, p.start) for t, p in pairs]
        return _Sum(parts, ca.Sparsity.dense(self.n_g))

    def _derived(self, what: What) -> _Sum:
        """Return the sum of what derivatives of the kernels add to the nonzeros of the whole."""
        results, rows, columns = [], [], []
        for term, numbers in zip(self.terms, self.slices, strict=True):
            function, i, j = getattr(term.kernel, what)
            values = np.arange(numbers.start, numbers.stop).reshape((-1, term.count), order="F")
            rows.append((term.unknowns if what == "hessian" else term.rows)[i])
            columns.append((values if what == "by_numbers" else term.unknowns)[j])
            results.append((function, term, numbers.start))
        shape = {
            "jacobian": (self.n_g, self.n_x),
            "by_numbers": (self.n_g, self.n_p),
            "hessian": (self.n_x, self.n_x),
        }[what]
        places, index = _sparse(rows, columns, shape)
        parts = [
            _Part(function, term, at, start)
            for (function, term, start), at in zip(results, index, strict=True)
            if at.size
        ]
        return _Sum(parts, places)

    def _added(self, what: What) -> ca.Function:
        of = self._sum(what)
        sizes = [("x", self.n_x), ("p", self.n_p), ("lam", self.n_g)]
        arguments = [ca.MX.sym(name, size) for name, size in sizes[: 3 if what == "hessian" else 2]]
        functions = kernels((part.function for part in of.parts), self.machine_code)
        results = [
            ca.vec(function.map(part.term.count)(*_own(part, arguments)))
            for function, part in zip(functions, of.parts, strict=True)
        ]
        at = [part.places.ravel("F") for part in of.parts]
        add = _added(np.concatenate([np.zeros(0, np.int64), *at]), of.places.nnz())
        return ca.Function(what, arguments, [add @ ca.vertcat(ca.MX(0, 1), *results)])


class Many:
    """What repeated kernels add up to at many unknowns: x (N, n_x), p (n_p,) -> values (N, n).

    Each kernel is taken through the repetitions of all sets at once.
    """

    def __init__(self, of: _Sum, machine_code: bool) -> None:
        self._parts = [(part, Mapped(part.function, machine_code)) for part in of.parts]
        at = [np.zeros(0, np.int64), *(part.places.ravel("F") for part in of.parts)]
        places = np.concatenate(at)
        ones, columns = np.ones(places.size), np.arange(places.size)
        self._add = csr_array((ones, (places, columns)), (of.places.nnz(), places.size))

    def __call__(self, x: Array, p: Array) -> Array:
        """See the class."""
        results = [np.zeros((len(x), 0))]
        for part, call in self._parts:
            term = part.term
            y = x[:, term.unknowns.T].reshape(-1, term.unknowns.shape[0])
            numbers = p[part.numbers : part.numbers + term.n_numbers]
            numbers = numbers.reshape(term.count, term.kernel.c.numel())
            results.append(call(y, numbers)[0].reshape(len(x), part.places.size))
        return np.ascontiguousarray((self._add @ np.concatenate(results, axis=1).T).T)


def _own(part: _Part, value: list[ca.MX]) -> list[ca.MX]:
    """Return what a kernel takes of unknowns, numbers and multipliers, repetitions as columns."""
    (x, p, *lam), term = value, part.term
    numbers = p[part.numbers : part.numbers + term.n_numbers]
    gathered = [x[term.unknowns.ravel("F").tolist()], numbers]
    gathered += [weights[term.rows.ravel("F").tolist()] for weights in lam]
    return [ca.reshape(values, -1, term.count) for values in gathered]


def _triplet(places: ca.Sparsity) -> tuple[Places, Places]:
    rows, columns = (np.array(part, dtype=np.int64) for part in places.get_triplet())
    return rows, columns


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
