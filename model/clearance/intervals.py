"""A CasADi function over boxes of its arguments: bounds of its values, by interval arithmetic.

Every value of the function for arguments inside of the boxes is inside of the bounds, but for
rounding. Bounds are wider than the range where an argument is used more than once, by a part that
shrinks with the square of the box. Source: Moore, Kearfott, Cloud, "Introduction to Interval
Analysis" (2009), chapters 5 and 6.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import NamedTuple

import casadi as ca
import numpy as np

from model.machine.columns import instructions
from model.paths import Array


class Interval(NamedTuple):
    """Lower and upper bounds of one shape."""

    low: Array
    high: Array

    def times(self, other: Interval) -> Interval:
        """Return the interval of the product."""
        with np.errstate(invalid="ignore"):
            products = [a * b for a in self._ends for b in other._ends]
        return Interval(reduce(np.minimum, products), reduce(np.maximum, products))

    @property
    def _ends(self) -> tuple[Array, ...]:
        """Both bounds, or one where they are the same array."""
        return (self.low,) if self.low is self.high else tuple(self)

    @property
    def middle(self) -> Array:
        """The middle."""
        return np.asarray((self.low + self.high) / 2)

    @property
    def radius(self) -> Array:
        """Half the width."""
        return np.asarray((self.high - self.low) / 2)


def _inverse(a: Interval) -> Interval:
    """Return 1 / a; everything where a has both signs."""
    with np.errstate(divide="ignore"):
        low, high = 1 / a.high, 1 / a.low
    both = a.low * a.high <= 0
    return Interval(np.where(both, -np.inf, low), np.where(both, np.inf, high))


def _square(a: Interval) -> Interval:
    least = np.maximum(np.maximum(a.low, -a.high), 0.0)
    return Interval(least**2, np.maximum(a.low**2, a.high**2))


_OPERATIONS: dict[int, Callable[..., Interval]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: lambda a, b: Interval(a.low + b.low, a.high + b.high),
    ca.OP_SUB: lambda a, b: Interval(a.low - b.high, a.high - b.low),
    ca.OP_NEG: lambda a: Interval(-a.high, -a.low),
    ca.OP_TWICE: lambda a: Interval(2 * a.low, 2 * a.high),
    ca.OP_MUL: Interval.times,
    ca.OP_DIV: lambda a, b: a.times(_inverse(b)),
    ca.OP_INV: _inverse,
    ca.OP_SQ: _square,
    ca.OP_SQRT: lambda a: Interval(*(np.sqrt(np.maximum(each, 0.0)) for each in a)),
}


class Bounded:
    """An SX function of dense vectors, built of sums, products, quotients, squares and roots."""

    def __init__(self, function: ca.Function) -> None:
        self.size = function.numel_out(0)
        self.steps = instructions(function)

    def __call__(self, *value: Interval) -> Interval:
        """Return bounds (N, n_out) of the first result for arguments in boxes (N, n_in)."""
        shape = value[0].low.shape[0]
        low, high = np.zeros((self.size, shape)), np.zeros((self.size, shape))
        columns = [
            Interval(*[each.low.T] * 2)
            if each.low is each.high
            else Interval(each.low.T, each.high.T)
            for each in value
        ]
        work: dict[int, Interval] = {}
        for operation, inputs, out, constant in self.steps:
            if operation == ca.OP_OUTPUT:
                low[out[1]], high[out[1]] = work[inputs[0]]
            elif operation == ca.OP_INPUT:
                column = columns[inputs[0]]
                first = column.low[inputs[1]]
                same = column.low is column.high
                work[out[0]] = Interval(first, first if same else column.high[inputs[1]])
            elif operation == ca.OP_CONST:
                work[out[0]] = Interval(*[np.array(constant)] * 2)
            else:
                work[out[0]] = _OPERATIONS[operation](*(work[i] for i in inputs))
        return Interval(low.T, high.T)
