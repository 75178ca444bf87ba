"""The elementary operations of a function, run on many columns of numbers at once.

CasADi's interpreter carries one set of numbers through all operations. Taken for hundreds of sets
at a time by NumPy, or written out in C for the machine's vector units, the same operations in the
same order give the same digits several times sooner.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from model.paths import Array

Lanes = Any


def _where(condition: Array, a: Array, out: Array) -> Array:
    out[:] = np.where(condition != 0, a, 0.0)
    return out


def _twice(a: Array, out: Array) -> Array:
    return np.add(a, a, out)


@dataclass(frozen=True)
class Operation:
    """One elementary operation: how NumPy does it on columns, and how it is written in C."""

    numpy: Callable[..., Any]
    c: str


OPERATIONS = {
    ca.OP_ASSIGN: Operation(np.positive, "{0}"),
    ca.OP_ADD: Operation(np.add, "{0} + {1}"),
    ca.OP_SUB: Operation(np.subtract, "{0} - {1}"),
    ca.OP_MUL: Operation(np.multiply, "{0} * {1}"),
    ca.OP_DIV: Operation(np.divide, "{0} / {1}"),
    ca.OP_NEG: Operation(np.negative, "-{0}"),
    ca.OP_SQ: Operation(np.square, "{0} * {0}"),
    ca.OP_TWICE: Operation(_twice, "{0} + {0}"),
    ca.OP_INV: Operation(np.reciprocal, "1.0 / {0}"),
    ca.OP_SQRT: Operation(np.sqrt, "each_sqrt({0})"),
    ca.OP_SIN: Operation(np.sin, "each_sin({0})"),
    ca.OP_COS: Operation(np.cos, "each_cos({0})"),
    ca.OP_EXP: Operation(np.exp, "each_exp({0})"),
    ca.OP_ASIN: Operation(np.arcsin, "each_asin({0})"),
    ca.OP_FABS: Operation(np.fabs, "each_fabs({0})"),
    ca.OP_FMIN: Operation(np.fmin, "each_fmin({0}, {1})"),
    ca.OP_FMAX: Operation(np.fmax, "each_fmax({0}, {1})"),
    ca.OP_LT: Operation(np.less, "truth({0} < {1})"),
    ca.OP_LE: Operation(np.less_equal, "truth({0} <= {1})"),
    ca.OP_NOT: Operation(np.logical_not, "truth({0} == 0.0)"),
    ca.OP_IF_ELSE_ZERO: Operation(_where, "where({0}, {1})"),
}


_NUMPY = {op: operation.numpy for op, operation in OPERATIONS.items()}


class Program:
    """The operations of an SX function, in order.

    Attributes
    ----------
    sizes_in, sizes_out : tuple of int
        Numbers in each argument and result.
    n_registers : int
        How many intermediate numbers there are at a time.
    lines : list of (operation, registers or places read, register or place written, constant)
        With the ids of CasADi; an input is read from (argument, element), an output written to
        (result, element).
    """

    def __init__(self, function: ca.Function) -> None:
        self.name = function.name()
        self.sizes_in = tuple(function.nnz_in(i) for i in range(function.n_in()))
        self.sizes_out = tuple(function.nnz_out(i) for i in range(function.n_out()))
        self.n_registers = function.sz_w()
        self.lines = []
        for k in range(function.n_instructions()):
            op = function.instruction_id(k)
            value = function.instruction_constant(k) if op == ca.OP_CONST else 0.0
            if op not in OPERATIONS and op not in (ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT):
                raise NotImplementedError(f"operation {op} of {self.name}")
            self.lines.append(
                (op, function.instruction_input(k), function.instruction_output(k), value)
            )

    def run(self, arguments: Sequence[Array], results: Sequence[Array], work: Array) -> None:
        """Write results (numbers, ...) for arguments (numbers, ...), whose columns broadcast.

        `work` (n_registers or more, ...) is overwritten.
        """
        rows: list[Any] = list(work)
        held: list[Any] = [*rows]
        for op, read, written, value in self.lines:
            if op == ca.OP_INPUT:
                held[written[0]] = arguments[read[0]][read[1]]
            elif op == ca.OP_OUTPUT:
                results[written[0]][written[1]] = held[read[0]]
            elif op == ca.OP_CONST:
                held[written[0]] = value
            elif len(read) == 2:
                i, j = read
                k = written[0]
                held[k] = _NUMPY[op](held[i], held[j], rows[k])
            else:
                k = written[0]
                held[k] = _NUMPY[op](held[read[0]], rows[k])
