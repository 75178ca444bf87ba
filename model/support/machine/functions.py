"""CasADi functions for NumPy arrays: without call overhead, for one or many sets of arguments.

CasADi's conversion of arguments and results dominates short calls, and its interpreter evaluates
one set of arguments after another. For many sets, NumPy evaluates one operation of an SX function
after another for all sets, or compiled C evaluates several sets in vector registers. The order of
operations is the same, so that results are identical, and several times faster.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache
from importlib.resources import files
from itertools import pairwise
from typing import Any, NamedTuple, Protocol, TypeVar, cast

import casadi as ca
import numpy as np

from octoplan.model.paths import Array
from octoplan.model.support.machine.compiled import is_short, library

K = TypeVar("K")
# Arguments, all results, callable that evaluates the function on these, and CasADi's buffer.
Prepared = tuple[list[Array], Array, Callable[[], None], Any]
# Number of sets in a vector of the C code.
LANES = 8
# Number of sets that NumPy evaluates together, so that intermediate results fit into the cache.
_AT_ONCE = 2048
# Number of sets up to which CasADi's interpreter is faster.
FEW = 192


class _Cached(Protocol):
    """The type of `cached`."""

    def __call__(self, make: Callable[..., K], *of: Any) -> K:
        """Return `make(*of)`."""


@lru_cache(maxsize=512)
def _cached(make: Callable[..., Any], *of: Any) -> Any:
    return make(*of)


# Return `make(*of)`, cached for all arms and meshes with the same structure. Pickles of functions
# refer to this cache by the name `_cached`.
cached = cast(_Cached, _cached)


class BufferedFunction:
    """A function of dense vectors with dense results, for calls from any thread."""

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self._local = threading.local()
        shapes = [(function.size2_out(i), function.size1_out(i)) for i in range(function.n_out())]
        ends = np.cumsum([0, *(columns * rows for columns, rows in shapes)]).tolist()
        self._parts = [
            (slice(*part), shape) for part, shape in zip(pairwise(ends), shapes, strict=True)
        ]

    def __call__(self, *inputs: Array) -> list[Array]:
        """Return the results, each transposed: (columns, rows)."""
        whole = self.flat(*inputs).copy()
        return [whole[part].reshape(shape) for part, shape in self._parts]

    def flat(self, *inputs: Array) -> Array:
        """Return all results concatenated (n,), valid until the next call from this thread."""
        try:
            prepared: Prepared = self._local.prepared
        except AttributeError:
            prepared = self._local.prepared = self.prepared()
        arguments, whole, run, _ = prepared
        for each, value in zip(arguments, inputs, strict=True):
            each[:] = value
        run()
        return whole

    def stats(self) -> dict[str, Any]:
        """Return the function's statistics of the last call from this thread."""
        return dict(self._local.prepared[3].stats())

    def prepared(self) -> Prepared:
        """Return arguments, all results, callable that evaluates the function, and its buffer."""
        f = self.function
        arguments = [np.zeros(f.nnz_in(i)) for i in range(f.n_in())]
        whole: Array = np.zeros(self._parts[-1][0].stop)
        buffer, run = f.buffer()
        for i, argument in enumerate(arguments):
            buffer.set_arg(i, memoryview(argument))  # type: ignore[call-arg,arg-type]
        for i, (part, _) in enumerate(self._parts):
            buffer.set_res(i, memoryview(whole[part]))  # type: ignore[call-arg,arg-type]
        return arguments, whole, run, buffer


class BatchFunction:
    """A function of dense vectors for many sets of arguments, one per row, from any thread.

    CasADi's map evaluates few sets. A VectorInterpreter evaluates many sets, and any number of sets
    with `machine_code`, if it supports all operations. The first argument determines the number of
    rows; other arguments are repeated cyclically.
    """

    def __init__(self, function: ca.Function, machine_code: bool = False) -> None:
        self._function = function
        self._machine_code = machine_code and is_short(function)
        self._sized = lru_cache(maxsize=20)(self._for_size)

    def __call__(self, *value: Array) -> list[Array]:
        """Return the results (N, n_out) of arguments (N, n_in) or (N,)."""
        count = len(value[0])
        f = self._function
        if not count:
            return [np.zeros((0, f.numel_out(i))) for i in range(f.n_out())]
        columns = self.columns if self._machine_code or count > FEW else None
        fit = (1, count) if columns else (count,)
        rows = [v if len(v) in fit else v[np.arange(count) % len(v)] for v in value]
        if columns:
            results = columns(*(v.reshape(len(v), -1).T for v in rows))
            return [np.ascontiguousarray(result.T) for result in results]
        return self._sized(count)(*[v.ravel() for v in rows])

    @cached_property
    def columns(self) -> VectorInterpreter | None:
        """Interpreter for arguments (n_in, N) and results (n_out, N), if operations allow it."""
        if unsupported(self._function):
            return None
        return VectorInterpreter(self._function, self._machine_code)

    def _for_size(self, size: int) -> BufferedFunction:
        return BufferedFunction(self._function if size == 1 else self._function.map(size))


class Operation(NamedTuple):
    """A scalar operation: NumPy function of rows with an output argument, and C expression."""

    numpy: Callable[..., Any]
    c: str


def _if_else_zero(condition: Array, a: Array, out: Array) -> Array:
    out[:] = np.where(condition != 0, a, 0.0)
    return out


OPERATIONS = {
    ca.OP_ASSIGN: Operation(np.positive, "{0}"),
    ca.OP_ADD: Operation(np.add, "{0} + {1}"),
    ca.OP_SUB: Operation(np.subtract, "{0} - {1}"),
    ca.OP_MUL: Operation(np.multiply, "{0} * {1}"),
    ca.OP_DIV: Operation(np.divide, "{0} / {1}"),
    ca.OP_NEG: Operation(np.negative, "-{0}"),
    ca.OP_SQ: Operation(np.square, "{0} * {0}"),
    ca.OP_TWICE: Operation(lambda a, out: np.add(a, a, out), "{0} + {0}"),
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
    ca.OP_IF_ELSE_ZERO: Operation(_if_else_zero, "where({0}, {1})"),
}
_MOVES = (ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT)
Instruction = tuple[int, Sequence[int], Sequence[int], float]


def unsupported(function: ca.Function) -> list[int]:
    """Return the operations of an SX function that are not in OPERATIONS."""
    values = (function.instruction_id(k) for k in range(function.n_instructions()))
    return [op for op in values if op not in OPERATIONS and op not in _MOVES]


def instructions(function: ca.Function) -> list[Instruction]:
    """Return the instructions of an SX function: operation, inputs, outputs and constant.

    Inputs and outputs are registers; OP_INPUT reads (argument, element), OP_OUTPUT writes (result,
    element).
    """
    lines: list[Instruction] = []
    for k in range(function.n_instructions()):
        op = function.instruction_id(k)
        value = function.instruction_constant(k) if op == ca.OP_CONST else 0.0
        lines.append((op, function.instruction_input(k), function.instruction_output(k), value))
    return lines


class VectorInterpreter:
    """An SX function for many sets of arguments, one per column, by NumPy or C, from any thread.

    Arguments are (n_in, N), or (n_in, 1) if all sets share the argument; results are (n_out, N).
    All operations must be in OPERATIONS. Raises CompilerError.
    """

    def __init__(self, function: ca.Function, machine_code: bool) -> None:
        self._sizes_in = [function.numel_in(i) for i in range(function.n_in())]
        self._sizes = [function.numel_out(i) for i in range(function.n_out())]
        self._lines = [
            (OPERATIONS[op].numpy if op in OPERATIONS else None, op, read, to, value)
            for op, read, to, value in instructions(function)
        ]
        self._n_registers = function.sz_w()
        self._run = None
        if machine_code:
            self._run = ctypes.CDLL(str(library(c_source(function), "-O2"))).columns
            at = ctypes.c_void_p
            count = ctypes.c_long
            self._run.argtypes = [count, count, count, at, at, at]
            self._run.restype = None
            self._places = (at * function.n_in(), at * function.n_out())
            self._same = count * function.n_in()

    def __call__(self, *columns: Array, steps: int = 1, every: bool = True) -> list[Array]:
        """Return the results of N sets, the largest number of columns of an argument.

        With several steps, the first result of a step is the first argument of the next step. The
        other arguments are (steps n_in, N). The results are (steps n_out, N), or (n_out, N) of the
        last step unless `every` is set.
        """
        N = max(each.shape[1] for each in columns)
        most = steps if every else 1
        if self._run is None:
            results = [np.empty((steps * size, N)) for size in self._sizes]
            for i in range(0, N, _AT_ONCE):
                part = slice(i, i + _AT_ONCE)
                some = [each if each.shape[1] == 1 else each[:, part] for each in columns]
                self._interpret(steps, some, [result[:, part] for result in results])
            return [
                result[-most * size :] for result, size in zip(results, self._sizes, strict=True)
            ]
        results = [np.empty((most * size, N)) for size in self._sizes]
        arguments = [np.ascontiguousarray(each, dtype=float) for each in columns]
        places = zip(self._places, (arguments, results), strict=True)
        at = (kind(*(each.ctypes.data for each in arrays)) for kind, arrays in places)
        self._run(N, steps, every, self._same(*(each.shape[1] < N for each in columns)), *at)
        return results

    def _interpret(self, steps: int, columns: list[Array], results: list[Array]) -> None:
        """Evaluate some sets step by step, one operation after another, into `results`."""
        work = [*np.empty((self._n_registers, results[0].shape[1]))]
        registers = work.copy()
        state = columns[0]
        for k in range(steps):
            inputs, outputs = (
                [each[k * size : (k + 1) * size] for each, size in zip(rows, sizes, strict=True)]
                for rows, sizes in ((columns, self._sizes_in), (results, self._sizes))
            )
            inputs[0] = state
            state = outputs[0]
            with np.errstate(all="ignore"):
                for operation, op, read, (to, *place), value in self._lines:
                    if operation is not None:
                        registers[to] = operation(*[registers[i] for i in read], work[to])
                    elif op == ca.OP_INPUT:
                        registers[to] = inputs[read[0]][read[1]]
                    elif op == ca.OP_OUTPUT:
                        outputs[to][place[0]] = registers[read[0]]
                    else:
                        registers[to] = np.float64(value)


def c_source(function: ca.Function) -> str:
    """Return C source that evaluates an SX function for many sets."""
    sizes_in = [function.nnz_in(i) for i in range(function.n_in())]
    sizes_out = [function.nnz_out(i) for i in range(function.n_out())]
    ends_in = np.cumsum([0, *sizes_in]).tolist()
    ends_out = np.cumsum([0, *sizes_out]).tolist()
    lines = []
    for op, read, to, value in instructions(function):
        if op == ca.OP_INPUT:
            lines.append(f"  a{to[0]}=y[{ends_in[read[0]] + read[1]}];")
        elif op == ca.OP_OUTPUT:
            lines.append(f"  r[{ends_out[to[0]] + to[1]}]=a{read[0]};")
        elif op == ca.OP_CONST:
            lines.append(f"  a{to[0]}=all({value!r});")
        else:
            lines.append(f"  a{to[0]}={OPERATIONS[op].c.format(*(f'a{i}' for i in read))};")
    registers = ", ".join(f"a{i}" for i in range(function.sz_w()))
    parts: dict[str, Any] = {
        "LANES_": LANES,
        "SIZES_IN_": ", ".join(map(str, sizes_in)),
        "SIZES_OUT_": ", ".join(map(str, sizes_out)),
        "N_IN_": len(sizes_in),
        "N_OUT_": len(sizes_out),
        "N_Y_": ends_in[-1],
        "N_R_": ends_out[-1],
        "BODY_": "\n".join([f"  lanes {registers};", *lines]),
    }
    source = (
        files("octoplan.model.support.machine").joinpath("columns.c").read_text(encoding="utf-8")
    )
    for name, part in parts.items():
        source = source.replace(name, str(part))
    return source
