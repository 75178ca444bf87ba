"""CasADi's C code made fit for a small machine: one kind of number, no names but its own."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import casadi as ca
import numpy as np

from model.rotations import matrix

Precision = Literal["double", "float"]
PRECISIONS: tuple[Precision, ...] = ("double", "float")

# Everything in CasADi's code that computes has a point: whole numbers are indices.
_LITERAL = re.compile(r"(?<![\w.])(\d+\.\d*(?:[eE][+-]?\d+)?)(?![\w.])")
_NAMES = "acos|asin|atan2?|ceil|cosh?|exp|fabs|floor|fm(?:ax|in|od)|log|pow|sinh?|sqrt|tanh?"
_MATH = re.compile(rf"\b({_NAMES})\(")
_GLOBAL = re.compile(r"^(?!static )((?:const )?\w+\*? \w+\([^;{}]*\) ?\{)", re.MULTILINE)


@dataclass(frozen=True)
class CSource:
    """What becomes NAME.c.

    Attributes
    ----------
    template : str
        In planner/c_code/files.
    functions : tuple of casadi.Function
        Those that it calls.
    places : dict
        What fills the places that are marked in it.
    numbers : int
        In static work arrays.
    """

    template: str
    functions: tuple[ca.Function, ...]
    places: dict[str, str]
    numbers: int

    def code(self, name: str, precision: Precision) -> dict[str, str]:
        """Return what fills all places; `name` is that of the file."""
        work = work_of(self.functions)
        sizes = {"SZ_W": work.w, "SZ_IW": work.iw, "SZ_ARG": work.arg, "SZ_RES": work.res}
        code = c_code(self.functions, name, precision).strip()
        return {**self.places, "CODE": code, **{key: str(size) for key, size in sizes.items()}}


@dataclass(frozen=True)
class Work:
    """What a call of the functions needs: numbers, whole numbers and pointers."""

    w: int
    iw: int
    arg: int
    res: int


def work_of(functions: Sequence[ca.Function]) -> Work:
    """Return what a call of any of the functions needs."""
    return Work(
        w=max(1, *(f.sz_w() for f in functions)),
        iw=max(1, *(f.sz_iw() for f in functions)),
        arg=max(f.sz_arg() for f in functions),
        res=max(f.sz_res() for f in functions),
    )


def c_code(functions: Sequence[ca.Function], name: str, precision: Precision) -> str:
    """Return functions in C, seen by nobody outside of their file; `name` is the file's.

    A function f takes (arg, res, iw, w, 0); see Work. In single precision no double appears, which
    small machines compute in software or twice as slowly.
    """
    options = {
        "casadi_real": precision,
        "casadi_int": "int",
        "with_export": False,
        "with_mem": False,
    }
    generator = ca.CodeGenerator(name, options)
    for function in functions:
        generator.add(function)
    # Inline functions may stay unused without a warning, and are not compiled then.
    code = _GLOBAL.sub(r"static inline \1", generator.dump())
    return single(code) if precision == "float" else code


def single(code: str) -> str:
    """Return C code with its numbers, and its calls of the math library, in single precision."""
    return _MATH.sub(r"\1f(", _LITERAL.sub(r"\1f", code))


def numbers(values: Any, precision: Precision) -> str:
    """Return numbers row by row as what initialises an array in C, all digits kept."""
    digits = 17 if precision == "double" else 9
    suffix = "" if precision == "double" else "f"
    texts = [f"{value:.{digits - 1}e}{suffix}" for value in np.ravel(values).tolist()]
    lines = [", ".join(texts[i : i + 4]) for i in range(0, len(texts), 4)]
    return ",\n    ".join(lines)


def whole_numbers(values: Any) -> str:
    """Return whole numbers as what initialises an array in C."""
    return ", ".join(map(str, np.ravel(values).tolist()))


@lru_cache(maxsize=1)
def frame_function() -> ca.Function:
    """Return q -> its rotation matrix (9,), row by row."""
    q = ca.SX.sym("q", 4)
    return ca.Function("frame", [q], [ca.vec(matrix(q).T)], {"cse": True})
