"""An explicit program as numbers, by C along the arm and CasADi's functions of its targets.

One statement serves Python, which asks for values and derivatives, and C that asks for the same by
pointers; see explicit.c. Functions of CasADi are run from C through Python's own interface, so that
whoever calls must hold Python's lock.
"""

from __future__ import annotations

import ctypes
import threading
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np

from model.machine.buffered import Buffered, runners
from model.machine.lanes import pointer
from model.machine.libraries import library
from model.paths import Array
from model.unloaded.steps_in_c import FUNCTIONS, Room, StepsInC
from planner.program.expressions import Outer
from planner.program.in_c import Function, pointers

_SIZES = ("n", "n_free", "m", "K", "r", "n_weights")
_PLACE = ("arm", "found", "T", "weights", "hessian", "poses", "jacobian", "strains", "by_tensions")
_OF_TARGETS = ("value", "first", "weights", "second")


class _Place(ctypes.Structure):
    """See place_t."""

    _fields_ = tuple((name, ctypes.c_void_p) for name in _PLACE)


class _Program(ctypes.Structure):
    """See explicit_t."""

    _fields_ = (
        *((name, ctypes.c_long) for name in _SIZES),
        *((name, ctypes.c_void_p) for name in ("seen", "unit", "f", "g")),
        *((name, _Place) for name in ("along", "slim")),
        *((name, ctypes.c_void_p) for name in (*FUNCTIONS, "call", "drop")),
        *((name, Function) for name in _OF_TARGETS),
    )


class ExplicitInC:
    """f, g and their derivatives; x begins with n tensions, in units that are the last of p."""

    def __init__(self, steps: StepsInC, outer: Outer) -> None:
        self._asked, self._run, self._local = (steps, outer), _library(), threading.local()

    def value(self, x: Array, p: Array) -> tuple[float, Array]:
        """Return objective and constraints."""
        here = self.lent(p)
        here.seen, x = None, _whole(x)
        self._run.explicit_value(here.program, pointer(x), pointer(x))
        return float(here.f[0]), here.g.copy()

    def first(self, x: Array, p: Array) -> tuple[float, Array, Array, Array]:
        """Return f, its gradient, g and its Jacobian."""
        here, x = self.lent(p), _whole(x)
        self._run.explicit_first(here.program, pointer(x))
        here.seen = x.copy()
        return float(here.f[0]), here.gradient.copy(), here.g.copy(), here.jacobian.copy("K")

    def second(self, x: Array, p: Array, sigma: float, lam: Array) -> Array:
        """Return the Hessian of sigma f + lam . g."""
        here, x, lam = self.lent(p), _whole(x), _whole(lam)
        if here.seen is None or not np.array_equal(here.seen, x):
            self.first(x, p)
        self._run.explicit_second(here.program, pointer(x), sigma, pointer(lam))
        return here.hessian.copy()

    def functions(self) -> tuple[ctypes.c_void_p, ...]:
        """Return value, first and second as other C calls them, with what is `lent`."""
        run = self._run
        return tuple(
            ctypes.cast(f, ctypes.c_void_p)
            for f in (run.explicit_value, run.explicit_first, run.explicit_second)
        )

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
    program : pointer to an explicit_t
    f (1,), g (m,), gradient (n_free,), jacobian (m, n_free), hessian (n_free, n_free) : Array
        What is found, in place.
    more (n_free,), off (1,) : Array
        What states would add, see Lent of planner.program.condensed_in_c: nothing.
    seen : (n_free,) or None
        Where first derivatives were found last; whoever calls the C keeps that true.
    """

    seen: Array | None = None

    def __init__(self, steps: StepsInC, outer: Outer) -> None:
        rooms = along, slim = steps.rooms()
        functions = [Buffered(getattr(outer, name)).prepared() for name in _OF_TARGETS]
        self._parameters = [given[1] for given, _, _, _ in functions]
        first, second = functions[1][1], functions[3][1]
        self.gradient, self.jacobian, self.hessian = first[1][0], first[3].T, second[0]
        m, n_free = self.jacobian.shape
        self.f, self.g, self._unit = np.empty(1), np.empty(m), np.empty(steps.n)
        self.more, self.off = np.zeros(n_free), np.zeros(1)
        sizes = steps.n, n_free, m, steps.seen.size, len(slim.strains), along.weights.size
        numbers = (values.ctypes.data for values in (steps.seen, self._unit, self.f, self.g))
        places = (_Place(room.arm, room.found, *_addresses(room)) for room in rooms)
        codes = *steps.functions, *runners()
        arrays = [(pointers(given), pointers(found)) for given, found, _, _ in functions]
        of_targets = (
            Function.of(own[2], *both) for own, both in zip(functions, arrays, strict=True)
        )
        self._program = _Program(*sizes, *numbers, *places, *codes, *of_targets)
        self.program = ctypes.c_void_p(ctypes.addressof(self._program))
        self._kept = steps, rooms, functions, arrays

    def take(self, p: Array) -> None:
        """Take parameters."""
        if not np.array_equal(self._parameters[0], p):
            for own in self._parameters:
                own[:] = p
            self._unit[:] = p[-self._unit.size :]
            self.seen = None

    def begin(self, x: Array) -> None:
        """Begin at unknowns x, of which no derivatives are known."""
        self.seen = None

    def whole(self, x: Array) -> Array:
        """Return all unknowns: there are no states."""
        return x


def _whole(values: Array) -> Array:
    """Return numbers one after the other, as C reads them."""
    return np.ascontiguousarray(values, dtype=float)


def _addresses(room: Room) -> list[int]:
    return [getattr(room, name).ctypes.data for name in _PLACE[2:]]


@lru_cache(maxsize=1)
def _library() -> Any:
    source = files("planner.program").joinpath("explicit.c").read_text(encoding="utf-8")
    found = ctypes.PyDLL(str(library(source, "-O2")))
    at = ctypes.c_void_p
    found.explicit_second.argtypes = [at, at, ctypes.c_double, at]
    return found
