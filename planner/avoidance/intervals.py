"""A CasADi function over boxes of its arguments: bounds of its values, by interval arithmetic.

An interval is an array whose first axis has the lower and the upper bound; one of length 1 is a
number. Every value of the function for arguments inside of the boxes is inside of the bounds, but
for rounding. Bounds are wider than the range where an argument is used more than once, by a part
that shrinks with the square of the box. Source: Moore, Kearfott, Cloud, "Introduction to Interval
Analysis" (2009), chapters 5 and 6.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce

import casadi as ca
import numpy as np

from model.machine.functions import instructions
from model.paths import Array


def times(a: Array, b: Array) -> Array:
    """Return the interval of the product."""
    with np.errstate(invalid="ignore"):
        products = [x * y for x in a for y in b]
    return np.array([reduce(np.minimum, products), reduce(np.maximum, products)])


def _inverse(a: Array) -> Array:
    """Return 1 / a; everything where a has both signs."""
    with np.errstate(divide="ignore"):
        low, high = 1 / a[-1], 1 / a[0]
    both = a[0] * a[-1] <= 0
    return np.array([np.where(both, -np.inf, low), np.where(both, np.inf, high)])


def _square(a: Array) -> Array:
    least = np.maximum(np.maximum(a[0], -a[-1]), 0.0)
    return np.array([least**2, np.maximum(a[0] ** 2, a[-1] ** 2)])


_OPERATIONS: dict[int, Callable[..., Array]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b[::-1],
    ca.OP_NEG: lambda a: -a[::-1],
    ca.OP_TWICE: lambda a: 2 * a,
    ca.OP_MUL: times,
    ca.OP_DIV: lambda a, b: times(a, _inverse(b)),
    ca.OP_INV: _inverse,
    ca.OP_SQ: _square,
    ca.OP_SQRT: lambda a: np.sqrt(np.maximum(a, 0.0)),
}


class Bounded:
    """An SX function of dense vectors, built of sums, products, quotients, squares and roots."""

    def __init__(self, function: ca.Function) -> None:
        self._size, self._steps = function.numel_out(0), instructions(function)

    def __call__(self, *boxes: Array) -> Array:
        """Return bounds (2, N, n_out) of the first result over boxes (1 or 2, N, n_in)."""
        result = np.zeros((2, self._size, boxes[0].shape[1]))
        columns = [np.ascontiguousarray(np.moveaxis(box, 2, 0)) for box in boxes]
        work: dict[int, Array] = {}
        for operation, inputs, out, constant in self._steps:
            if operation == ca.OP_OUTPUT:
                result[:, out[1]] = work[inputs[0]]
            elif operation == ca.OP_INPUT:
                work[out[0]] = columns[inputs[0]][inputs[1]]
            elif operation == ca.OP_CONST:
                work[out[0]] = np.array([[constant]])
            else:
                work[out[0]] = _OPERATIONS[operation](*(work[i] for i in inputs))
        return np.moveaxis(result, 1, 2)
