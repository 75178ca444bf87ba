"""Condensed steps by compiled kernels and C around them: no interpreter in the loop along the arm.

What CondensedSteps states in symbols, for CasADi's solvers, is computed here in the same order, and
so to the same digits, by model/unloaded/condensed_steps.c. That C knows no arm, mesh or law: it is
compiled once for a number of tendons, and calls the compiled kernels of these.
"""

from __future__ import annotations

import ctypes
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np

from model.machine.compiled import code_of
from model.machine.libraries import library
from model.paths import Array
from model.unloaded.condensed_steps import POSE, STRAINS, CondensedSteps

FUNCTIONS = ("poses_of", "jacobian_of", "strains_of", "hessian_of", "bent_of")
_SIZES = ("steps", "m", "rows", "n_data", "n_law")
_KERNELS = ("solve", "value", "first", "second", "march", "march_first", "march_second")
_NUMBERS = ("maps", "data", "h", "base")
_FOUND = ("pull", "law", "strains", "poses", "by_tensions", "jacobian", "A", "B", "lam", "room")


class _Arm(ctypes.Structure):
    """See arm_t."""

    _fields_ = (
        *((name, ctypes.c_long) for name in _SIZES),
        *((name, ctypes.c_void_p) for name in (*_KERNELS, *_NUMBERS)),
    )


class _Found(ctypes.Structure):
    """See found_t."""

    _fields_ = tuple((name, ctypes.c_void_p) for name in _FOUND)


class StepsInC:
    """The C for an arm, and numbers for it to work on.

    Attributes
    ----------
    n : int
        Number of tendons.
    seen : (K,) of C's long
        The steps after which poses are seen.
    functions : pointers
        poses_of, jacobian_of, strains_of, hessian_of and bent_of.
    """

    def __init__(self, steps: CondensedSteps) -> None:
        self._steps, self.n = steps, steps.n
        self.seen = np.array(steps.seen, dtype=np.dtype(ctypes.c_long))
        library_of = _library(steps.n)
        self.functions = [ctypes.cast(library_of[name], ctypes.c_void_p) for name in FUNCTIONS]

    @staticmethod
    def can(steps: CondensedSteps) -> bool:
        """Return whether all of the kernels are compiled."""
        return all(code_of(f) is not None for f in steps.kernels)

    def rooms(self) -> tuple[Room, Room]:
        """Return numbers along the arm, and at slim places, that nobody else works on."""
        steps = self._steps
        codes = [ctypes.cast(code_of(f), ctypes.c_void_p) for f in steps.kernels]
        law = steps.kernels[0].numel_out(0)
        along = Room(steps.numbers, codes, law)
        along.weights = np.zeros_like(along.poses)
        return along, Room(steps.slim_numbers, codes, law)


class Room:
    """Numbers of an arm, what the C finds, and the room that it works in.

    Attributes
    ----------
    arm, found : pointers to arm_t and found_t
    T (n,), weights, hessian (n, n) : Array
        What else the C is given: tensions, weights of a Hessian (of strains, along the arm of
        poses), which comes there.
    poses (S + 1, POSE), jacobian (S + 1, POSE, n) : Array
    strains (K, STRAINS), by_tensions (K, STRAINS, n) : Array
        What is found at S steps of K places; see condensed_steps.c.
    """

    def __init__(self, numbers: tuple[Array, ...], codes: list[Any], law: int) -> None:
        maps, data, h, _ = numbers
        (K, rows, n), S = maps.shape, h.size
        e = STRAINS * (K // S)
        self.T, self.hessian = np.empty(n), np.empty((n, n))
        self.pull, self.law, self.strains = (np.empty((K, k)) for k in (rows, law, STRAINS))
        self.weights = np.zeros_like(self.strains)
        self.poses, self.lam = np.empty((S + 1, POSE)), np.empty((S + 1, POSE))
        self.jacobian = np.empty((S + 1, POSE, n))
        self.by_tensions = np.empty((K, STRAINS, n))
        self.A, self.B = np.empty((S, POSE, POSE)), np.empty((S, e, POSE))
        step = (POSE + e) * (POSE + e + n)
        self.room = np.empty(step + rows * (rows + n + STRAINS))
        sizes = (S, K // S, rows, data.shape[1], law)
        self._numbers = numbers
        self._arm = _Arm(*sizes, *codes, *(own.ctypes.data for own in numbers))
        self._found = _Found(*(getattr(self, name).ctypes.data for name in _FOUND))
        self.arm, self.found = map(ctypes.addressof, (self._arm, self._found))


@lru_cache(maxsize=16)
def _library(n: int) -> Any:
    source = files("model.unloaded").joinpath("condensed_steps.c").read_text(encoding="utf-8")
    return ctypes.CDLL(str(library(f"#define N {n}\n{source}", "-O3")))
