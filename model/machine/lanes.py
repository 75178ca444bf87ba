"""Programs written out in C for a few arms side by side: one number of each in a vector.

The C of model/machine/lanes.h and of a frame, with sizes and programs written in, is compiled and
called through ctypes.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping
from importlib.resources import files

import casadi as ca
import numpy as np

from model.machine.libraries import library
from model.machine.pieces import cut
from model.machine.program import OPERATIONS, Program
from model.paths import Array

LANES = 8


def loaded(
    frame: str, sizes: Mapping[str, int | str], programs: list[str], flag: str
) -> ctypes.CDLL:
    """Return the library of a C file beside this one, with sizes and programs written in.

    Raises CompilerError.
    """
    here = files("model.machine")
    defined = "\n".join(f"#define {name} {size}" for name, size in sizes.items())
    head = defined + "\n" + here.joinpath("lanes.h").read_text(encoding="utf-8")
    source = here.joinpath(frame).read_text(encoding="utf-8").replace("/* LANES */", head)
    return ctypes.CDLL(str(library(source.replace("/* PROGRAMS */", "\n".join(programs)), flag)))


def written(program: Program, name: str, numbers: tuple[int, ...], pieces: bool = False) -> str:
    """Return a program as a C function of arrays of lanes; `numbers` are plain doubles.

    Long ones are soon compiled in pieces, and take a little longer to run.
    Results must not overlap arguments.
    """
    arguments = {
        f"in{i}": f"const {'double' if i in numbers else 'lanes'} *"
        for i in range(len(program.sizes_in))
    } | {f"out{i}": "lanes *" for i in range(len(program.sizes_out))}
    lines = []
    for op, read, write, value in program.lines:
        if op == ca.OP_INPUT:
            number = f"in{read[0]}[{read[1]}]"
            lines.append(f"  a{write[0]}={f'all({number})' if read[0] in numbers else number};")
        elif op == ca.OP_OUTPUT:
            lines.append(f"  out{write[0]}[{write[1]}]=a{read[0]};")
        elif op == ca.OP_CONST:
            lines.append(f"  a{write[0]}=all({_literal(value)});")
        else:
            of = OPERATIONS[op].c.format(*(f"a{i}" for i in read))
            lines.append(f"  a{write[0]}={of};")
    given = ", ".join(kind + own for own, kind in arguments.items())
    before = ""
    if pieces:
        before, calls = cut(lines, f"{name}_", arguments, "lanes")
        lines = [calls]
    else:
        lines.insert(0, f"  lanes {', '.join(f'a{i}' for i in range(program.n_registers))};")
    return "\n".join([f"{before}static inline void {name}({given}) {{", *lines, "}"])


def aligned(size: int) -> Array:
    """Return doubles that begin where vector registers can load them."""
    room = np.empty(size + LANES)
    skip = -room.ctypes.data % (8 * LANES) // 8
    return room[skip : skip + size]


def padded(values: Array) -> Array:
    """Return columns (rows, M) with the last repeated up to a multiple of LANES."""
    rows, M = values.shape
    found = np.empty((rows, M + -M % LANES))
    found[:, :M], found[:, M:] = values, values[:, -1:]
    return found


def _literal(value: float) -> str:
    return "NAN" if math.isnan(value) else repr(value).replace("inf", "INFINITY")
