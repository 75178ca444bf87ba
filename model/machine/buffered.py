"""A function called without CasADi's wrapping of arguments and results, which is most of a call."""

from __future__ import annotations

import threading
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model.machine.columns import Columns, unknown
from model.machine.compiled import is_short
from model.paths import Array


class Buffered:
    """A function of dense vectors, with dense results, that may be called from any thread."""

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self._local = threading.local()

    def __call__(self, *inputs: Array) -> list[Array]:
        """Return the results, each transposed: (columns, rows)."""
        try:
            held, results, run, _ = self._local.prepared
        except AttributeError:
            held, results, run, _ = self._local.prepared = self.prepared()
        for each, value in zip(held, inputs, strict=True):
            each[:] = value
        run()
        return list(map(np.ndarray.copy, results))

    def stats(self) -> dict[str, Any]:
        """Return what the function tells of the last call of this thread."""
        return dict(self._local.prepared[3].stats())

    def prepared(self) -> tuple[list[Array], list[Array], Any, Any]:
        """Return arguments, results, what runs the function on these, and its buffer."""
        f = self.function
        arguments = [np.zeros(f.nnz_in(i)) for i in range(f.n_in())]
        results = [np.zeros((f.size2_out(i), f.size1_out(i))) for i in range(f.n_out())]
        buffer, run = f.buffer()
        for i, held in enumerate(arguments):
            buffer.set_arg(i, memoryview(held))  # type: ignore[call-arg,arg-type]
        for i, result in enumerate(results):
            buffer.set_res(i, memoryview(result))  # type: ignore[call-arg,arg-type]
        return arguments, results, run, buffer


class Mapped:
    """A function of dense vectors for many sets of arguments, from any thread; rows are sets.

    Few are taken by CasADi's maps, of which the last ones are kept, many, and all with
    `machine_code`, by model.machine.columns. The first argument has all rows; others may have
    fewer, which are taken again and again.
    """

    def __init__(self, function: ca.Function, machine_code: bool = False) -> None:
        self._function = function
        self._machine_code = machine_code and is_short(function)
        # Sets at a time, of scalar functions and of others.
        self._most = 512 if function.is_a("SXFunction") else 64
        self._sized = lru_cache(maxsize=20)(self._of)

    def __call__(self, *value: Array) -> list[Array]:
        """Return the results (N, n_out) of arguments (N, n_in) or (N,)."""
        count, most = len(value[0]), self._most
        by_columns = count and (self._machine_code or count > most) and self.columns is not None
        fit = (1, count) if by_columns else (count,)
        rows = [v if len(v) in fit else v[np.arange(count) % len(v)] for v in value]
        if by_columns and self.columns:
            results = self.columns(*(v.reshape(len(v), -1).T for v in rows))
            return [np.ascontiguousarray(result.T) for result in results]
        if 0 < count <= most:
            outcome = self._sized(count)(*[v.ravel() for v in rows])
            return [result.reshape(count, -1) for result in outcome]
        sizes = [self._function.numel_out(i) for i in range(self._function.n_out())]
        parts = [self(*(v[i : i + most] for v in rows)) for i in range(0, count, most)]
        columns = zip(*parts, strict=True) if parts else ([np.zeros((0, n))] for n in sizes)
        return [np.concatenate(column) for column in columns]

    @cached_property
    def columns(self) -> Columns | None:
        """The function of arguments (n_in, N) with results (n_out, N), of scalar operations."""
        if not self._function.is_a("SXFunction") or unknown(self._function):
            return None
        return Columns(self._function, self._machine_code)

    def _of(self, size: int) -> Buffered:
        return Buffered(self._function if size == 1 else self._function.map(size))
