"""Programs written out in C for many arms at a time, compiled, and called through ctypes."""

from __future__ import annotations

import ctypes
import math
from functools import lru_cache
from importlib.resources import files
from typing import Any, Protocol

import casadi as ca
import numpy as np

from model.machine.libraries import library
from model.machine.program import OPERATIONS, Program
from model.paths import Array
from model.stations import Counts
from model.unloaded.pulls import TERMS, PullPolynomials

LANES = 8


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
    n = -(-M // LANES) * LANES
    T = np.ascontiguousarray(np.pad(tensions, ((0, 0), (0, n - M)), mode="edge"))
    own = np.concatenate([part.ravel() for part in tables.polynomials.own])
    tendons = np.array([part.shape[1] for part in tables.polynomials.own], np.int32)
    room = _aligned(TERMS * stretch.size1_in(0) * (tendons.size + 1) * LANES)
    pose, least = np.empty((7, n)), np.empty(n)
    arms = [T, tendons, own, tables.base]
    steps = [tables.active, tables.basis, tables.data, tables.h]
    ends = [tables.end_active, tables.end_basis, tables.end_data]
    run(
        ctypes.c_long(n),
        tendons.size,
        tables.h.size,
        tables.end_active.size,
        *(_pointer(v) for v in (*arms, *steps, *ends, room, pose, least)),
    )
    return pose[:, :M], least[:M]


def _pointer(values: Any) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)


def _aligned(size: int) -> Array:
    """Return doubles that begin where vector registers can load them."""
    room = np.empty(size + LANES)
    skip = -room.ctypes.data % (8 * LANES) // 8
    return room[skip : skip + size]


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
    frame = files("model.machine").joinpath("tips.c").read_text(encoding="utf-8")
    defined = "\n".join(f"#define {name} {size}" for name, size in sizes.items())
    source = frame.replace("/* SIZES */", defined).replace("/* PROGRAMS */", "\n\n".join(programs))
    tips = ctypes.CDLL(str(library(source, "-O2"))).tips
    tips.restype = None
    return tips


def written(program: Program, name: str, numbers: tuple[int, ...]) -> str:
    """Return a program as a C function of arrays of lanes; `numbers` are plain doubles.

    Results must not overlap arguments.
    """
    arguments = [
        f"const {'double' if i in numbers else 'lanes'} *in{i}"
        for i in range(len(program.sizes_in))
    ]
    results = [f"lanes *out{i}" for i in range(len(program.sizes_out))]
    body = [f"  lanes {', '.join(f'w{i}' for i in range(program.n_registers))};"]
    for op, read, write, value in program.lines:
        if op == ca.OP_INPUT:
            given = f"in{read[0]}[{read[1]}]"
            body.append(f"  w{write[0]} = {f'all({given})' if read[0] in numbers else given};")
        elif op == ca.OP_OUTPUT:
            body.append(f"  out{write[0]}[{write[1]}] = w{read[0]};")
        elif op == ca.OP_CONST:
            body.append(f"  w{write[0]} = all({_literal(value)});")
        else:
            body.append(f"  w{write[0]} = {OPERATIONS[op].c.format(*(f'w{i}' for i in read))};")
    head = f"static inline void {name}({', '.join([*arguments, *results])}) {{"
    return "\n".join([head, *body, "}"])


def _literal(value: float) -> str:
    return "NAN" if math.isnan(value) else repr(value).replace("inf", "INFINITY")
