"""Kernels that are repeated over an arm in C: a few repetitions side by side in vector units."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from model.machine.compiled import is_short
from model.machine.lanes import loaded, written
from model.machine.libraries import library
from model.machine.program import Program
from model.paths import Array

# What one register of most processors holds: of few elements no more are side by side.
_SIDE_BY_SIDE = 4
# Shorter kernels are one function.
_IN_PIECES = 250
_built: WeakKeyDictionary[ca.Function, Any] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Repeated:
    """A kernel y, c[, lam] -> values (n_out,), N times.

    Attributes
    ----------
    unknowns : (n_y, N)
        Place of each of its unknowns among all.
    rows : (n_r, N)
        Place of each of its multipliers among all.
    places : (n_out, N)
        Where each of its values is added.
    numbers : int
        Where its numbers begin; those of a repetition stand together.
    """

    kernel: ca.Function
    unknowns: NDArray[np.int64]
    rows: NDArray[np.int64]
    places: NDArray[np.int64]
    numbers: int

    @property
    def count(self) -> int:
        """How often it is repeated."""
        return int(self.unknowns.shape[1])


class _Term(ctypes.Structure):
    """See term_t."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("run", "unknowns", "rows", "places")),
        *((name, ctypes.c_long) for name in ("count", "numbers")),
    )


class InC:
    """x, p[, lam] -> the sum (size,) of what repeated kernels add, to the digits of CasADi's.

    Calls from several threads do not meet. Raises CompilerError.

    Attributes
    ----------
    terms, count
        Address and number of the term_t that other C evaluates.
    """

    def __init__(self, parts: Sequence[Repeated], size: int) -> None:
        self.size, self._kept = size, [_tables(part) for part in parts]
        runs = _compiled([part.kernel for part in parts])
        self._terms = (_Term * len(parts))(
            *(
                _Term(run, *(_address(table) for table in own), part.count, part.numbers)
                for run, own, part in zip(runs, self._kept, parts, strict=True)
            )
        )
        self._run = evaluator()
        self.terms, self.count = ctypes.addressof(self._terms), len(parts)

    def __call__(self, x: Array, p: Array, lam: Array | None = None) -> list[Array]:
        """Return the sum as a row (1, size)."""
        x, p = (np.ascontiguousarray(part, dtype=float) for part in (x, p))
        lam = x if lam is None else np.ascontiguousarray(lam, dtype=float)
        found = np.zeros((1, self.size))
        given = (part.ctypes.data for part in (x, p, lam, found))
        self._run(self.terms, self.count, *given)
        return [found]

    def many(self, x: Array, p: Array) -> Array:
        """Return the sums (N, size) of many x (N, n_x) with numbers that all share."""
        x, p = (np.ascontiguousarray(part, dtype=float) for part in (x, p))
        found = np.zeros((len(x), self.size))
        given, numbers, sums = (part.ctypes.data for part in (x, p, found))
        for i in range(len(x)):
            own = given + i * x.strides[0]
            self._run(self.terms, self.count, own, numbers, own, sums + i * found.strides[0])
        return found


def can_be_in_c(parts: Sequence[Repeated]) -> bool:
    """Return whether no kernel is too long to be compiled."""
    return all(is_short(part.kernel) for part in parts)


def _tables(part: Repeated) -> list[NDArray[np.int32]]:
    """Return places as C reads them, those of a repetition side by side."""
    tables = part.unknowns, part.rows, part.places
    return [np.ascontiguousarray(table.T, dtype=np.int32) for table in tables]


def _address(values: NDArray[Any]) -> int:
    return int(values.ctypes.data)


def _compiled(functions: Sequence[ca.Function]) -> list[int]:
    """Return the addresses of repeated kernels, compiled side by side."""
    left = [f for f in dict.fromkeys(functions) if f not in _built]
    with ThreadPoolExecutor(max(len(left), 1)) as pool:
        for f, run in zip(left, pool.map(_library, left), strict=True):
            _built[f] = run
    return [int(ctypes.cast(_built[f], ctypes.c_void_p).value or 0) for f in functions]


def _library(kernel: ca.Function) -> Any:
    program = Program(kernel)
    n_lam = program.sizes_in[2] if len(program.sizes_in) > 2 else 0
    given = ("y", "numbers", "weights")[: len(program.sizes_in)]
    sizes: dict[str, int | str] = {
        "LANES": _SIDE_BY_SIDE,
        "N_Y": program.sizes_in[0],
        "N_C": program.sizes_in[1],
        "N_LAM": n_lam,
        "N_OUT": program.sizes_out[0],
        "KERNEL": f"kernel({', '.join((*given, 'out'))})",
    }
    pieces = len(program.lines) > _IN_PIECES
    return loaded("repeated.c", sizes, [written(program, "kernel", (), pieces)], "-O1").repeated


@lru_cache(maxsize=1)
def evaluator() -> Any:
    """Return the function of terms.c."""
    source = files("model.machine").joinpath("terms.c").read_text(encoding="utf-8")
    run = ctypes.CDLL(str(library(source, "-O2"))).evaluate
    at = ctypes.c_void_p
    run.argtypes, run.restype = [at, ctypes.c_long, at, at, at, at], None
    return run
