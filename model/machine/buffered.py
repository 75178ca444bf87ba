"""A function called without CasADi's wrapping of arguments and results, which is most of a call."""

from __future__ import annotations

import threading
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
            local.update(zip(names, self._prepared(), strict=True))
        for held, value in zip(local["given"], given, strict=True):
            held[:] = value
        local["run"]()
        return [result.copy() for result in local["results"]]

    def stats(self) -> dict[str, Any]:
        """Return what the function tells of the last call of this thread."""
        return dict(self._local.buffer.stats())

    def _prepared(self) -> tuple[list[Array], list[Array], Any, Any]:
        f = self.function
        given = [np.zeros(f.nnz_in(i)) for i in range(f.n_in())]
        results = [np.zeros((f.size2_out(i), f.size1_out(i))) for i in range(f.n_out())]
        buffer, run = f.buffer()
        for i, held in enumerate(given):
            buffer.set_arg(i, memoryview(held))  # type: ignore[call-arg,arg-type]
        for i, result in enumerate(results):
            buffer.set_res(i, memoryview(result))  # type: ignore[call-arg,arg-type]
        return given, results, run, buffer
