"""The functions of a structure, each made when it is first called, to be called with numbers."""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model.machine.buffered import Buffered, ManyArguments
from model.transcription.kernel import Places
from model.transcription.layout import Layout


class Calls:
    """The functions of a structure; `value` is (x, p) -> residuals."""

    def __init__(self, of: Layout) -> None:
        self.of = of
        self.value = Buffered(of.equations.value)

    @cached_property
    def jacobian(self) -> Buffered:
        """(x, p) -> nonzeros of the residuals' Jacobian."""
        return Buffered(self.of.equations.jacobian[0])

    @cached_property
    def values(self) -> ManyArguments:
        """(many x, p) -> residuals of each."""
        return ManyArguments(self.of.equations.value)

    @cached_property
    def jacobians(self) -> ManyArguments:
        """(many x, p) -> `jacobian` of each."""
        return ManyArguments(self.of.equations.jacobian[0])

    @cached_property
    def many_by_numbers(self) -> ManyArguments:
        """(many x, p) -> `by_numbers` of each."""
        return ManyArguments(self.of.equations.by_numbers[0])

    @cached_property
    def number_rows(self) -> tuple[Places, Places, Places, Places]:
        """Order of the nonzeros of `by_numbers` by row, their columns, where rows begin, which."""
        rows, columns = (np.array(v) for v in self.of.equations.by_numbers[1].get_triplet())
        order = np.argsort(rows, kind="stable")
        own, starts = np.unique(rows[order], return_index=True)
        return order, columns[order], starts, own

    @cached_property
    def by_numbers(self) -> Buffered:
        """(x, p) -> nonzeros of the derivatives of the residuals by the numbers."""
        return Buffered(self.of.equations.by_numbers[0])

    @cached_property
    def number_places(self) -> tuple[Places, Places]:
        """Rows of the nonzeros of `by_numbers`, and where its columns begin."""
        return compressed(self.of.equations.by_numbers[1])

    @cached_property
    def hessian(self) -> Buffered:
        """(x, p, multipliers) -> nonzeros of the Hessian of multipliers . residuals."""
        return Buffered(self.of.equations.hessian[0])

    @cached_property
    def lengths(self) -> Buffered:
        """(x, length numbers) -> lengths of the tendons."""
        return Buffered(self.of.lengths.value)

    @cached_property
    def length_jacobian(self) -> Buffered:
        """(x, length numbers) -> nonzeros of the derivatives of the lengths by x."""
        return Buffered(self.of.lengths.jacobian[0])

    @cached_property
    def length_places(self) -> tuple[Any, Any]:
        """Rows and columns of the nonzeros of `length_jacobian`."""
        rows, columns = self.of.lengths.jacobian[1].get_triplet()
        return np.array(rows), np.array(columns)


@lru_cache(maxsize=32)
def calls_of(of: Layout) -> Calls:
    """Return the functions of a structure, made once."""
    return Calls(of)


def compressed(places: ca.Sparsity) -> tuple[Places, Places]:
    """Return the rows of nonzeros and where columns begin, as SciPy has them."""
    return np.array(places.row()), np.array(places.colind())
