"""A program with its states eliminated, by C: its equations, LAPACK, CasADi's functions of targets.

For C that asks by pointers, see condensed.c and planner.solve.sqp_in_c. Functions of CasADi are run
from C through Python's own interface, so that whoever calls must hold Python's lock.
"""

from __future__ import annotations

import ctypes
import threading
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cython_blas, cython_lapack

from model.equilibrium.linearised import Band
from model.machine.buffered import runners
from model.machine.libraries import library
from model.machine.repeated import InC, evaluator
from model.paths import Array
from planner.program.in_c import FOUND, Function, pointers
from planner.program.program import Program
from planner.program.reduced import Nonzeros

_AT, _LONG = ctypes.c_void_p, ctypes.c_long
_TABLES = ("inside", "stored", "outside", "sides", "whole", "row_scale", "numbers")
_CODES = ("evaluate", "factor", "substitute", "multiply", "apply", "call", "drop")
_FUNCTIONS, _SUMS = ("values", "first", "outer"), ("value_sum", "jacobian_sum", "hessian_sum")
_ROOMS = ("x", "trial", "X", "band", "right", "moves", "slopes", "moved", "product", "found")
Rules = tuple[int, float, float]


class _Sum(ctypes.Structure):
    """See sum_t."""

    _fields_ = (("terms", _AT), ("count", _LONG), ("size", _LONG), ("found", _AT))


class _Matrix(ctypes.Structure):
    """See matrix_t."""

    _fields_ = (("rows", _AT), ("ends", _AT), ("nonzeros", _AT))


class _Program(ctypes.Structure):
    """See condensed_t."""

    _fields_ = (
        *((name, _LONG) for name in ("n", "n_free", "m", "states", "followed")),
        *((name, ctypes.c_int) for name in ("below", "above", "n_inside", "n_outside")),
        *((name, ctypes.c_double) for name in ("near", "shrinks")),
        *((name, _AT) for name in (*_TABLES, *_CODES)),
        *((name, Function) for name in _FUNCTIONS),
        *((name, _Sum) for name in _SUMS),
        *((name, _Matrix) for name in ("own", "inner")),
        *((name, _AT) for name in (*_ROOMS, "multipliers", "pivots", *FOUND)),
    )


class CondensedInC:
    """The C of a program whose unknowns besides the tensions are the states of its arm."""

    def __init__(self, program: Program, sums: list[InC], band: Band, rules: Rules) -> None:
        self._asked, self._local = (program, sums, band, rules), threading.local()

    @classmethod
    def of(cls, program: Program, band: Band, rules: Rules) -> CondensedInC | None:
        """Return it; None where not all of a program is compiled, or there are more unknowns."""
        if program.blocks.n_answers or not program.equations.machine_code:
            return None
        calls = program.value_call, program.jacobian_call, program.hessian_call
        sums = [call for call in calls if isinstance(call, InC)]
        if len(sums) < len(calls):
            return None
        return cls(program, sums, band, rules)

    def functions(self) -> tuple[ctypes.c_void_p, ...]:
        """Return value, first and second as other C calls them, with what is `lent`."""
        run = _library()
        found = run.condensed_value, run.condensed_first, run.condensed_second
        return tuple(ctypes.cast(f, _AT) for f in found)

    def lent(self, p: Array) -> Lent:
        """Return the numbers that the C works on in this thread, with parameters p."""
        if not hasattr(self._local, "lent"):
            self._local.lent = Lent(*self._asked)
        found: Lent = self._local.lent
        found.take(p)
        return found


class Lent:
    """The numbers that the C of a program works on.

    Attributes
    ----------
    program : pointer to a condensed_t
    f (1,), g (m,), gradient (n,), jacobian (m, n), hessian (n, n), more (n,), off (1,) : Array
        What is found, in place; `more` is the slope that states off add, `off` how far they are.
    """

    def __init__(self, program: Program, sums: list[InC], band: Band, rules: Rules) -> None:
        functions = [f.prepared() for f in (program.values, program.first, program.outer_hessian)]
        n, m = program.n_free, sum(row.size for row in program.outer_rows)
        tensions, states = program.blocks.of.n_tendons, program.size - n
        self._of, self._parameters = program, [given[1] for given, _, _, _ in functions]
        p, parts, self._whole = self._parameters[0], program.parts, np.empty(program.size)
        tables = _band_tables(program, band)
        numbers = self._whole, p[parts.row_scale], p[parts.numbers]
        self.f, self.g, self.gradient = np.empty(1), np.empty(m), np.empty(n)
        self.jacobian, self.hessian = np.empty((n, m)).T, np.empty((n, n))
        self.more, self.off = np.empty(n), np.empty(1)
        rooms = _rooms(program.size, states, band, tensions, n, m)
        self._x, self._trial = rooms[:2]
        found = [np.empty(own.size) for own in sums]
        arrays = [(pointers(given), pointers(results)) for given, results, _, _ in functions]
        self._program = _Program(
            *(tensions, n, m, states, rules[0], band.below, band.above),
            *(tables[0].size, tables[2].size, *rules[1:]),
            *map(_address, (*tables, *numbers)),
            *_codes(),
            *(Function.of(own[2], *both) for own, both in zip(functions, arrays, strict=True)),
            *(
                _Sum(s.terms, s.count, s.size, _address(v))
                for s, v in zip(sums, found, strict=True)
            ),
            _matrix(program.outer_hessian_places, functions[2][1][0]),
            _matrix(program.hessian_places, found[2]),
            *map(_address, rooms),
            *(_address(getattr(self, name)) for name in FOUND),
        )
        self.program = _AT(ctypes.addressof(self._program))
        self._kept = functions, sums, found, tables, numbers, rooms, arrays

    def take(self, p: Array) -> None:
        """Take parameters."""
        if not np.array_equal(self._parameters[0], p):
            for own in self._parameters:
                own[:] = p
            self._whole[:] = self._of.whole(p)

    def begin(self, x: Array) -> None:
        """Begin at all unknowns x."""
        self._trial[:] = x

    def whole(self, x: Array) -> Array:
        """Return all unknowns where it was linearised last; x are those before the states."""
        return np.concatenate([x, self._x[x.size :]])


def _rooms(size: int, states: int, band: Band, tensions: int, n: int, m: int) -> list[Array]:
    """Return what the C works in: _ROOMS."""
    k = n + 1
    sizes = (size, size, size, states * band.height, states * (tensions + 1), states * k)
    more = (states * (m + 1), k * (m + 1), 2 * size * k, size * k, states, states)
    return [np.zeros(own) for own in (*sizes, *more)]


def _band_tables(program: Program, band: Band) -> list[NDArray[np.int64]]:
    """Return which nonzeros of the Jacobian are in the band, where; and which are not, where."""
    at, n, states = program.jacobian_places, program.n_free, program.blocks.of.n_states
    rows, columns = (own.astype(np.int64) for own in (at.rows, at.columns))
    inside, outside = np.flatnonzero(columns > n), np.flatnonzero(columns <= n)
    column = columns[inside] - n - 1
    stored = column * band.height + band.below + band.above + rows[inside] - column
    side = np.minimum(columns[outside], program.blocks.of.n_tendons)
    tables = inside, stored, outside, side * states + rows[outside]
    return [np.ascontiguousarray(table, dtype=np.int64) for table in tables]


def _matrix(places: Nonzeros, nonzeros: Array) -> _Matrix:
    return _Matrix(_address(places.rows), _address(places.ends), _address(nonzeros))


def _address(values: Any) -> int:
    return int(values.ctypes.data)


@lru_cache(maxsize=1)
def _codes() -> tuple[Any, ...]:
    """Return the functions that the C calls: for terms, SciPy's LAPACK and BLAS, and Python's."""
    lapack = (_capsule(cython_lapack, name) for name in ("dgbtrf", "dgbtrs"))
    blas = (_capsule(cython_blas, name) for name in ("dgemm", "dgemv"))
    return ctypes.cast(evaluator(), _AT), *lapack, *blas, *runners()


def _capsule(module: Any, name: str) -> int:
    """Return the address of a function that a module of Cython exports."""
    own, api = module.__pyx_capi__[name], ctypes.pythonapi
    api.PyCapsule_GetName.restype = ctypes.c_char_p
    api.PyCapsule_GetName.argtypes = [ctypes.py_object]
    api.PyCapsule_GetPointer.restype = _AT
    api.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    return int(api.PyCapsule_GetPointer(own, api.PyCapsule_GetName(own)))


@lru_cache(maxsize=1)
def _library() -> Any:
    source = files("planner.program").joinpath("condensed.c").read_text(encoding="utf-8")
    return ctypes.PyDLL(str(library(source, "-O3")))
