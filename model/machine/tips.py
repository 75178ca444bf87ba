"""The tips of many arms in closed form, by C that takes a few arms at a time."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from typing import Any, Protocol

import casadi as ca
import numpy as np

from model.machine.lanes import LANES, aligned, loaded, padded, pointer, written
from model.machine.program import Program
from model.paths import Array
from model.stations import Counts
from model.unloaded.pulls import TERMS, PullPolynomials


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


def call_tips(
    tables: Tables, step: ca.Function, chain: ca.Function, stretch: ca.Function, tensions: Array
) -> tuple[Array, Array]:
    """Return what Batch.tips does, by machine code; raises CompilerError."""
    run, M = _library(step, chain, stretch), tensions.shape[1]
    T = padded(tensions)
    n = T.shape[1]
    own = np.concatenate([part.ravel() for part in tables.polynomials.own])
    tendons = np.array([part.shape[1] for part in tables.polynomials.own], np.int32)
    room = aligned(TERMS * stretch.size1_in(0) * (tendons.size + 1) * LANES)
    pose, least = np.empty((7, n)), np.empty(n)
    arms = [T, tendons, own, tables.base]
    steps = [tables.active, tables.basis, tables.data, tables.h]
    ends = [tables.end_active, tables.end_basis, tables.end_data]
    run(
        ctypes.c_long(n),
        tendons.size,
        tables.h.size,
        tables.end_active.size,
        *(pointer(v) for v in (*arms, *steps, *ends, room, pose, least)),
    )
    return pose[:, :M], least[:M]


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
    tips = loaded("tips.c", sizes, programs, "-O2").tips
    tips.restype = None
    return tips
