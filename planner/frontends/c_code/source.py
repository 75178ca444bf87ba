"""Adapt the C code of CasADi to embedded systems: one number type, static functions."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from octoplan.model.rotations import matrix

Precision = Literal["double", "float"]

# Floating-point literals have a decimal point; integers are indices.
_LITERAL = re.compile(r"(?<![\w.])(\d+\.\d*(?:[eE][+-]?\d+)?)(?![\w.])")
_NAMES = "acos|asin|atan2?|ceil|cosh?|exp|fabs|floor|fm(?:ax|in|od)|log|pow|sinh?|sqrt|tanh?"
_MATH = re.compile(rf"\b({_NAMES})\(")
_GLOBAL = re.compile(r"^(?!static )((?:const )?\w+\*? \w+\([^;{}]*\) ?\{)", re.MULTILINE)


@dataclass(frozen=True)
class CSource:
    """The contents of NAME.c.

    Attributes
    ----------
    template : str
        Name of the template in planner/frontends/c_code/files.
    functions : tuple of casadi.Function
        Functions that the template calls.
    places : dict
        Texts for the placeholders of the template.
    numbers : int
        Size of the static work arrays in numbers.
    """

    template: str
    functions: tuple[ca.Function, ...]
    places: dict[str, str]
    numbers: int

    def code(self, name: str, precision: Precision) -> dict[str, str]:
        """Return the texts for all placeholders; `name` is the name of the file."""
        sizes = {key: str(size) for key, size in work_of(self.functions).items()}
        return {**self.places, "CODE": c_code(self.functions, name, precision).strip(), **sizes}


def work_of(functions: Sequence[ca.Function]) -> dict[str, int]:
    """Return the work sizes for a call of any of the functions, by name of the placeholder.

    Sizes are those of the real and integer work arrays, and of the argument and result pointers.
    """
    needed = ("sz_w", 1), ("sz_iw", 1), ("sz_arg", 0), ("sz_res", 0)
    return {
        name.upper(): max(least, *(getattr(f, name)() for f in functions)) for name, least in needed
    }


def c_code(functions: Sequence[ca.Function], name: str, precision: Precision) -> str:
    """Return functions as C code with static linkage; `name` is the name of the file.

    The signature of each function is f(arg, res, iw, w, 0); see work_of. In single precision the
    code has no double, which small processors evaluate in software or at half the speed.
    """
    types = {"casadi_real": precision, "casadi_int": "int"}
    without = ("with_export", "with_mem")
    generator = ca.CodeGenerator(name, types | dict.fromkeys(without, False))
    for function in functions:
        generator.add(function)
    # Unused inline functions cause no warning and are not compiled.
    code = _GLOBAL.sub(r"static inline \1", generator.dump())
    # Convert literals and calls of the math library to single precision.
    return _MATH.sub(r"\1f(", _LITERAL.sub(r"\1f", code)) if precision == "float" else code


def numbers(values: Any, precision: Precision) -> str:
    """Return numbers, row-major, as the initialiser of a C array with all digits."""
    digits = 17 if precision == "double" else 9
    suffix = "" if precision == "double" else "f"
    texts = [f"{value:.{digits - 1}e}{suffix}" for value in np.ravel(values).tolist()]
    lines = [", ".join(texts[i : i + 4]) for i in range(0, len(texts), 4)]
    return ",\n    ".join(lines)


def whole_numbers(values: Any) -> str:
    """Return integers as the initialiser of a C array."""
    return ", ".join(map(str, np.ravel(values).tolist()))


def frame_function() -> ca.Function:
    """Return the function from a quaternion q to the rotation matrix (9,), row-major."""
    q = ca.SX.sym("q", 4)
    return ca.Function("frame", [q], [ca.vec(matrix(q).T)], {"cse": True})
