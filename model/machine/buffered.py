"""A function called without CasADi's wrapping of arguments and results, which is most of a call."""

from __future__ import annotations

import threading
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model.paths import Array


class Buffered:
    """A function of dense vectors, with dense results, that may be called from any thread."""

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self._local = threading.local()

    def __call__(self, *given: Array) -> list[Array]:
        """Return the results, each transposed: (columns, rows)."""
        local = self._local.__dict__
        if not local:
            names = ("given", "results", "run", "buffer")
            local.update(zip(names, self.prepared(), strict=True))
        for held, value in zip(local["given"], given, strict=True):
            held[:] = value
        local["run"]()
        return [result.copy() for result in local["results"]]

    def stats(self) -> dict[str, Any]:
        """Return what the function tells of the last call of this thread."""
        return dict(self._local.buffer.stats())

    def prepared(self) -> tuple[list[Array], list[Array], Any, Any]:
        """Return arguments, results, what runs the function on these, and its buffer."""
        f = self.function
        given = [np.zeros(f.nnz_in(i)) for i in range(f.n_in())]
        results = [np.zeros((f.size2_out(i), f.size1_out(i))) for i in range(f.n_out())]
        buffer, run = f.buffer()
        for i, held in enumerate(given):
            buffer.set_arg(i, memoryview(held))  # type: ignore[call-arg,arg-type]
        for i, result in enumerate(results):
            buffer.set_res(i, memoryview(result))  # type: ignore[call-arg,arg-type]
        return given, results, run, buffer


class Mapped:
    """A function of dense vectors for many columns at once, from any thread.

    They are taken so many at a time. Maps are kept for sizes that are powers of two; the last
    columns are repeated up to one.
    """

    _most = 128

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._sized = lru_cache(maxsize=20)(lambda size: Buffered(function.map(size)))

    def __call__(self, *given: Array) -> list[Array]:
        """Return the results (N, n_out) of arguments (N, n_in) or (N,)."""
        count = len(given[0])
        if not count:
            return [
                np.zeros((0, self._function.numel_out(i))) for i in range(self._function.n_out())
            ]
        if count > self._most:
            starts = range(0, count, self._most)
            parts = [self(*(v[i : i + self._most] for v in given)) for i in starts]
            return [np.concatenate(found) for found in zip(*parts, strict=True)]
        size = 1 << (count - 1).bit_length()
        if size > count:
            given = tuple(np.concatenate([v, v[-1:].repeat(size - count, axis=0)]) for v in given)
        return [found[:count] for found in self._sized(size)(*(v.ravel() for v in given))]


class ManyArguments:
    """A function of two dense vectors for many first ones at once, from any thread.

    They are taken by powers of two, so that few maps are kept and nothing is computed in vain.
    """

    _most = 64

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._sized = lru_cache(maxsize=None)(self._of)

    def __call__(self, given: Array, shared: Array) -> Array:
        """Return the results (N, n_out) of arguments (N, n_in) with one that all share."""
        found, start = np.empty((len(given), self._function.numel_out(0))), 0
        while start < len(given):
            size = min(1 << ((len(given) - start).bit_length() - 1), self._most)
            own = slice(start, start + size)
            found[own] = self._sized(size)(given[own].ravel(), shared)[0]
            start += size
        return found

    def _of(self, size: int) -> Buffered:
        if size == 1:
            return Buffered(self._function)
        return Buffered(self._function.map("many", "serial", size, [1], []))
