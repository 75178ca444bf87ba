"""CasADi's C code made fit for a small machine: one kind of number, no names but its own."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from octoplan.model.rotations import matrix

Precision = Literal["double", "float"]

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
        In planner/frontends/c_code/files.
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
        sizes = {key: str(size) for key, size in work_of(self.functions).items()}
        return {**self.places, "CODE": c_code(self.functions, name, precision).strip(), **sizes}


def work_of(functions: Sequence[ca.Function]) -> dict[str, int]:
    """Return what a call of any of the functions needs, by the names that the files have for it.

    Numbers, whole numbers, and pointers to arguments and results.
    """
    needed = ("sz_w", 1), ("sz_iw", 1), ("sz_arg", 0), ("sz_res", 0)
    return {
        name.upper(): max(least, *(getattr(f, name)() for f in functions)) for name, least in needed
    }


def c_code(functions: Sequence[ca.Function], name: str, precision: Precision) -> str:
    """Return functions in C, seen by nobody outside of their file; `name` is the file's.

    A function f takes (arg, res, iw, w, 0); see work_of. In single precision no double appears,
    which small machines compute in software or twice as slowly.
    """
    number, without = {"casadi_real": precision, "casadi_int": "int"}, ("with_export", "with_mem")
    generator = ca.CodeGenerator(name, number | dict.fromkeys(without, False))
    for function in functions:
        generator.add(function)
    # Inline functions may stay unused without a warning, and are not compiled then.
    code = _GLOBAL.sub(r"static inline \1", generator.dump())
    # Numbers and calls of the math library in single precision.
    return _MATH.sub(r"\1f(", _LITERAL.sub(r"\1f", code)) if precision == "float" else code


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


def frame_function() -> ca.Function:
    """Return q -> its rotation matrix (9,), row by row."""
    q = ca.SX.sym("q", 4)
    return ca.Function("frame", [q], [ca.vec(matrix(q).T)], {"cse": True})
