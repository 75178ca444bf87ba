"""Sequential quadratic programming by C, where the program is C: no Python between the steps.

The steps are those of planner.solve.sqp, to the same digits.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np

from model.machine.buffered import runners
from model.machine.libraries import library
from model.paths import Array
from planner.program.condensed_in_c import CondensedInC
from planner.program.explicit_in_c import ExplicitInC
from planner.program.in_c import FOUND
from planner.solve.ipopt import Solution
from planner.solve.quadratic import quadratic

_PROGRAM = ("self", "value", "first", "second", *FOUND)
_QUADRATIC = ("run", "call", "drop", "H", "slope", "A", "lba", "uba", "lbx", "ubx", "change", "own")
_ASKED = ("lbx", "ubx", "lbg", "ubg", "known", "equal", "uneven")
_COUNTS = ("n_equal", "n_uneven", "n_known")
_RULES = ("met", "soft", "soft_late", "shifted", "rounding", "closed", "longest", "local", "lost")
_RULES_OF_POINTS = ("at", "joined", "near", "alike")
_LIMITS = ("most", "late", "creeps", "halved")
_POINT = ("x", "lam", "g", "slope", "residuals", "room", "held")
_WHOLE, _AT = np.dtype(ctypes.c_long), ctypes.c_void_p


class _Program(ctypes.Structure):
    """See program_t."""

    _fields_ = (("n", ctypes.c_long), ("m", ctypes.c_long), *((name, _AT) for name in _PROGRAM))


class _Quadratic(ctypes.Structure):
    """See quadratic_t."""

    _fields_ = tuple((name, _AT) for name in _QUADRATIC)


class _Asked(ctypes.Structure):
    """See asked_t."""

    _fields_ = (*((name, _AT) for name in _ASKED), *((name, ctypes.c_long) for name in _COUNTS))


class _Rules(ctypes.Structure):
    """See rules_t."""

    _fields_ = (
        *((name, ctypes.c_double) for name in (*_RULES, *_RULES_OF_POINTS)),
        *((name, ctypes.c_long) for name in _LIMITS),
    )


class _Point(ctypes.Structure):
    """See point_t."""

    _fields_ = (
        *((name, _AT) for name in _POINT),
        ("f", ctypes.c_double),
        *((name, ctypes.c_long) for name in ("steps", "met", "joined")),
    )


def run(
    program: ExplicitInC | CondensedInC,
    p: Array,
    bounds: tuple[Array, ...],
    known: Sequence[Solution],
    rules: Mapping[str, float],
    x: Array,
    lam: Array,
) -> tuple[Solution, int] | None:
    """Return where steps from all unknowns x and multipliers lead, and which known optimum that is.

    The place is below 0 where it is none; there is no solution where not even x is a point. Rules
    are those of planner.solve.sqp.
    """
    n, m = bounds[0].size, lam.size
    lent, values = program.lent(p), [np.ascontiguousarray(b, dtype=float) for b in bounds]
    lent.begin(x)
    equal = np.equal(values[2], values[3])
    uneven = np.flatnonzero(~equal).astype(_WHOLE)
    which = np.flatnonzero(equal).astype(_WHOLE), uneven
    optima = np.array([one.x[:n] for one in known], dtype=float)
    given = [*values, optima, *which]
    asked = _Asked(*map(_address, given), *(own.size for own in which), len(known))
    found = [x[:n].astype(float), lam.astype(float), np.empty(m), np.empty(n)]
    own = [np.empty(int(rules["most"]) + 1), np.empty(2 * n * n + 2 * n + m), np.zeros(n, _WHOLE)]
    at = _Point(*map(_address, (*found, *own)), np.nan)
    numbers = (_address(getattr(lent, name)) for name in FOUND)
    of = _Program(n, m, lent.program, *program.functions(), *numbers)
    told = _Rules(**rules)
    parts = (of, _solver(n, uneven.size), asked, told, at)
    if not _library().run(*map(ctypes.byref, parts)):
        return None
    x, lam, g, slope = found
    lam_x = np.where(own[2], -slope, 0.0)
    return Solution(lent.whole(x), lam_x, lam, at.f, g, bool(at.met), "", at.steps), at.joined


class _Solvers(threading.local):
    """Solvers of quadratic programs by their sizes, with the numbers they work on."""

    def __init__(self) -> None:
        self.of = lru_cache(maxsize=16)(_prepared)


def _prepared(n: int, m: int) -> tuple[_Quadratic, Any]:
    given, results, call, buffer = quadratic(n, m).function.prepared()
    numbers = map(_address, (*given[:7], results[0], results[2]))
    return _Quadratic(id(call), *runners(), *numbers), (given, results, call, buffer)


_solvers = _Solvers()


def _solver(n: int, m: int) -> _Quadratic:
    return _solvers.of(n, m)[0]


def _address(values: Array) -> int:
    return int(values.ctypes.data)


@lru_cache(maxsize=1)
def _library() -> Any:
    source = files("planner.solve").joinpath("sqp.c").read_text(encoding="utf-8")
    return ctypes.PyDLL(str(library(source, "-O2")))
