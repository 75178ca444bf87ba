"""Condensed steps by compiled kernels and C around them: no interpreter in the loop along the arm.

What CondensedSteps states in symbols, for CasADi's solvers, is computed here in the same order, and
so to the same digits, by model/unloaded/condensed_steps.c. That C knows no arm, mesh or law: it is
compiled once for a number of tendons, and calls the compiled kernels of these.
"""

from __future__ import annotations

import ctypes
import threading
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np

from model.machine.compiled import code_of
from model.machine.libraries import library
from model.paths import Array
from model.unloaded.condensed_steps import POSE, STRAINS, CondensedSteps

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
    """Poses that are seen and 1 + q at slim places, as numbers; may be called from any thread."""

    def __init__(self, steps: CondensedSteps) -> None:
        self._steps, self._run, self._local = steps, _library(steps.n), threading.local()

    @staticmethod
    def can(steps: CondensedSteps) -> bool:
        """Return whether all of the kernels are compiled."""
        return all(code_of(f) is not None for f in steps.kernels)

    def values(self, T: Array) -> tuple[Array, Array]:
        """Return the poses (K, 7) and 1 + q (r,) under tensions (n_tendons,)."""
        along, slim = self._rooms()
        along.T[:] = slim.T[:] = T
        self._local.at = None
        self._run.poses_of(*along.given)
        self._run.strains_of(*slim.given, 0, len(slim.strains))
        return along.poses[self._steps.seen], 1 + slim.strains[:, 2]

    def first(self, T: Array) -> tuple[Array, Array, Array]:
        """Return the same, and the derivatives (7 K + r, n_tendons) of both."""
        along, slim = self._at(T)
        poses, jacobian = along.poses[self._steps.seen], along.jacobian[self._steps.seen]
        both = np.concatenate([jacobian.reshape(-1, self._steps.n), slim.by_tensions[:, 2]])
        return poses, 1 + slim.strains[:, 2], both

    def second(self, T: Array, weights: Array, thin: Array) -> Array:
        """Return the Hessian (n, n) of weights (K, 7) . poses + thin (r,) . stretches."""
        along, slim = self._at(T)
        along.weights[:] = 0.0
        along.weights[self._steps.seen], slim.weights[:, 2] = weights, thin
        self._run.hessian_of(*along.curved)
        self._run.bent_of(*slim.curved)
        return np.asarray(along.hessian + slim.hessian)

    def _at(self, T: Array) -> tuple[_Room, _Room]:
        """Return what is found under tensions, with first derivatives."""
        along, slim = self._rooms()
        if self._local.at is None or not np.array_equal(self._local.at, T):
            along.T[:] = slim.T[:] = T
            self._run.jacobian_of(*along.given)
            self._run.strains_of(*slim.given, 0, len(slim.strains))
            self._local.at = T.copy()
        return along, slim

    def _rooms(self) -> tuple[_Room, _Room]:
        local = self._local
        if not hasattr(local, "rooms"):
            codes = [ctypes.cast(code_of(f), ctypes.c_void_p) for f in self._steps.kernels]
            law = self._steps.kernels[0].numel_out(0)
            places = self._steps.numbers, self._steps.slim_numbers
            along, slim = (_Room(own, codes, law) for own in places)
            along.weights = np.zeros((self._steps.steps + 1, POSE))
            slim.weights = np.zeros((len(slim.strains), STRAINS))
            for room in (along, slim):
                room.curved = *room.given[:2], *map(_pointer, (room.weights, room.hessian))
            local.rooms, local.at = (along, slim), None
        along, slim = local.rooms
        return along, slim


class _Room:
    """Numbers of an arm, what the C finds, the room that it works in, and its arguments."""

    weights: Array
    curved: tuple[Any, ...]

    def __init__(self, numbers: tuple[Array, ...], codes: list[Any], law: int) -> None:
        maps, data, h, _ = numbers
        (K, rows, n), S = maps.shape, h.size
        e = STRAINS * (K // S)
        self.T, self.hessian = np.empty(n), np.empty((n, n))
        self.pull, self.law, self.strains = (np.empty((K, k)) for k in (rows, law, STRAINS))
        self.poses, self.lam = np.empty((S + 1, POSE)), np.empty((S + 1, POSE))
        self.jacobian = np.empty((S + 1, POSE, n))
        self.by_tensions = np.empty((K, STRAINS, n))
        self.A, self.B = np.empty((S, POSE, POSE)), np.empty((S, e, POSE))
        step = (POSE + e) * (POSE + e + n)
        self.room = np.empty(step + rows * (rows + n + STRAINS))
        sizes = (S, K // S, rows, data.shape[1], law)
        self._arm = _Arm(*sizes, *codes, *(own.ctypes.data for own in numbers))
        self._found = _Found(*(getattr(self, name).ctypes.data for name in _FOUND))
        at = (ctypes.c_void_p(ctypes.addressof(own)) for own in (self._arm, self._found))
        self.given = *at, _pointer(self.T)


def _pointer(values: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)


@lru_cache(maxsize=16)
def _library(n: int) -> Any:
    source = files("model.unloaded").joinpath("condensed_steps.c").read_text(encoding="utf-8")
    found = ctypes.CDLL(str(library(f"#define N {n}\n{source}", "-O3")))
    at = ctypes.c_void_p
    found.strains_of.argtypes = [at, at, at, ctypes.c_long, ctypes.c_long]
    for run in (
        found.poses_of,
        found.jacobian_of,
        found.strains_of,
        found.hessian_of,
        found.bent_of,
    ):
        run.restype = None
    return found
