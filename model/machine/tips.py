"""The poses of many arms in closed form, by C that takes a few arms at a time."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from typing import Any, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from model.machine.lanes import LANES, aligned, loaded, padded, written
from model.machine.program import Program
from model.paths import Array
from model.stations import Counts
from model.unloaded.pulls import TERMS, PullPolynomials

NodeNumbers = NDArray[np.int32]


class Tables(Protocol):
    """The steps of an arm as tables of numbers; see model.machine.batch.Batch."""

    polynomials: PullPolynomials
    base: Array
    h: Array
    active: Counts
    basis: Array
    data: Array
    end_active: Counts
    end_basis: Array
    end_data: Array


class PosesInC:
    """What Batch.poses does, by machine code of a step, the chain and 1 + q.

    Calls from several threads do not meet. Raises CompilerError.
    """

    def __init__(
        self, tables: Tables, programs: tuple[ca.Function, ca.Function, ca.Function]
    ) -> None:
        self._run = _library(*programs)
        own = np.concatenate([part.ravel() for part in tables.polynomials.own])
        tendons = np.array([part.shape[1] for part in tables.polynomials.own], np.int32)
        steps = [tables.active, tables.basis, tables.data, tables.h]
        ends = [tables.end_active, tables.end_basis, tables.end_data]
        self._tables = [tendons, own, tables.base, *steps, *ends]
        self._given = [values.ctypes.data for values in self._tables]
        self._sizes = tendons.size, tables.h.size, tables.end_active.size
        self._room = TERMS * programs[2].size1_in(0) * (tendons.size + 1) * LANES

    def __call__(self, tensions: Array, nodes: NodeNumbers) -> tuple[Array, Array]:
        """Return poses (K, 7, M) and the least 1 + q (M,); see Batch.poses."""
        T, M = padded(tensions), tensions.shape[1]
        n, room = T.shape[1], aligned(self._room)
        poses, least = np.empty((nodes.size, 7, n)), np.empty(n)
        found = (values.ctypes.data for values in (nodes, room, poses, least))
        self._run(n, *self._sizes, nodes.size, T.ctypes.data, *self._given, *found)
        return poses[:, :, :M], least[:M]


@lru_cache(maxsize=32)
def _library(step: ca.Function, chain: ca.Function, stretch: ca.Function) -> Any:
    sizes = {
        "LANES": LANES,
        "TERMS": TERMS,
        "N_PULL": stretch.size1_in(0),
        "N_DATA": stretch.size1_in(1),
        "NODES": step.size2_in(0),
    }
    programs = [
        written(Program(step), "step", numbers=(1, 2)),
        written(Program(chain), "chain", numbers=()),
        written(Program(stretch), "stretch", numbers=(1,)),
    ]
    run = loaded("tips.c", sizes, programs, "-O2").poses_at
    whole, at = ctypes.c_int, ctypes.c_void_p
    run.argtypes, run.restype = [ctypes.c_long, *[whole] * 4, *[at] * 15], None
    return run
