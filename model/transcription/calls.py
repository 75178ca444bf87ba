"""The functions of a structure, each made when it is first called, to be called with numbers."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model.machine.buffered import Buffered, ManyArguments
from model.machine.repeated import InC
from model.paths import Array
from model.transcription.kernel import Places
from model.transcription.layout import Layout

Call = Buffered | InC
Many = Callable[[Array, Array], Array]


class Calls:
    """The functions of a structure; `value` is (x, p) -> residuals."""

    def __init__(self, of: Layout) -> None:
        self.of = of
        self.value = of.equations.call("value")

    @cached_property
    def jacobian(self) -> Call:
        """(x, p) -> nonzeros of the residuals' Jacobian."""
        return self.of.equations.call("jacobian")

    @cached_property
    def values(self) -> Many:
        """(many x, p) -> residuals of each."""
        return _many(self.value)

    @cached_property
    def jacobians(self) -> Many:
        """(many x, p) -> `jacobian` of each."""
        return _many(self.jacobian)

    @cached_property
    def many_by_numbers(self) -> Many:
        """(many x, p) -> `by_numbers` of each."""
        return _many(self.by_numbers)

    @cached_property
    def number_rows(self) -> tuple[Places, Places, Places, Places]:
        """Order of the nonzeros of `by_numbers` by row, their columns, where rows begin, which."""
        rows, columns = (np.array(v) for v in self.of.equations.places("by_numbers").get_triplet())
        order = np.argsort(rows, kind="stable")
        own, starts = np.unique(rows[order], return_index=True)
        return order, columns[order], starts, own

    @cached_property
    def by_numbers(self) -> Call:
        """(x, p) -> nonzeros of the derivatives of the residuals by the numbers."""
        return self.of.equations.call("by_numbers")

    @cached_property
    def number_places(self) -> tuple[Places, Places]:
        """Rows of the nonzeros of `by_numbers`, and where its columns begin."""
        return compressed(self.of.equations.places("by_numbers"))

    @cached_property
    def hessian(self) -> Call:
        """(x, p, multipliers) -> nonzeros of the Hessian of multipliers . residuals."""
        return self.of.equations.call("hessian")

    @cached_property
    def lengths(self) -> Call:
        """(x, length numbers) -> lengths of the tendons."""
        return self.of.lengths.call("value")

    @cached_property
    def length_jacobian(self) -> Call:
        """(x, length numbers) -> nonzeros of the derivatives of the lengths by x."""
        return self.of.lengths.call("jacobian")

    @cached_property
    def length_places(self) -> tuple[Any, Any]:
        """Rows and columns of the nonzeros of `length_jacobian`."""
        rows, columns = self.of.lengths.places("jacobian").get_triplet()
        return np.array(rows), np.array(columns)


def _many(call: Call) -> Many:
    """Return what makes a call for many first arguments with one second that all share."""
    return call.many if isinstance(call, InC) else ManyArguments(call.function)


@lru_cache(maxsize=32)
def calls_of(of: Layout) -> Calls:
    """Return the functions of a structure, made once."""
    return Calls(of)


def compressed(places: ca.Sparsity) -> tuple[Places, Places]:
    """Return the rows of nonzeros and where columns begin, as SciPy has them."""
    return np.array(places.row()), np.array(places.colind())
