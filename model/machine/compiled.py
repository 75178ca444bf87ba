"""Kernels as machine code: the same digits as interpreted, ten to twenty times sooner."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any, Literal, TypeVar
from weakref import WeakKeyDictionary

import casadi as ca

from model.errors import CompilerError, InputError
from model.machine.libraries import library
from model.units import warn

K = TypeVar("K")
Compile = bool | Literal["auto"]
# More takes the compiler several times as long, for code that is a tenth faster.
_LEVEL = "-O1"
# Longer functions stay as they are: half a minute of a compiler's for what few plans call at all,
# those that hold the least stable mode to a margin.
_LONGEST = 31_000
_built: WeakKeyDictionary[ca.Function, ca.Function] = WeakKeyDictionary()


def checked_compile(compile: Any) -> bool:  # noqa: A002  (the name that scripts use)
    """Return whether to compile: True, False, or "auto" for where there is a compiler that works.

    Raises InputError for anything else; CompilerError for True where there is none.
    """
    if isinstance(compile, bool) and not compile:
        return False
    if compile is not True and not (isinstance(compile, str) and compile == "auto"):
        raise InputError("compile", compile, 'True, False or "auto"')
    try:
        _try(os.environ.get("CC"), os.environ.get("PATH"))
    except CompilerError as reason:
        if compile is True:
            raise
        warn(f"not compiled: {reason}", RuntimeWarning)
        return False
    return True


@lru_cache(maxsize=8)
def _try(named: str | None, path: str | None) -> None:
    library("int works(void) { return 1; }\n", _LEVEL)


def kernels(functions: Iterable[ca.Function], machine_code: bool = True) -> list[ca.Function]:
    """Return functions as machine code, or as they are; several are compiled side by side.

    Those that are no SX functions stay, and very long ones. CasADi cannot differentiate what is
    compiled.

    Raises CompilerError.
    """
    functions = list(functions)
    if not machine_code:
        return functions
    left = [f for f in dict.fromkeys(functions) if f not in _built and is_short(f)]
    generators = [ca.CodeGenerator("function.c") for _ in left]
    for generator, f in zip(generators, left, strict=True):
        generator.add(f)
    with ThreadPoolExecutor(max(len(left), 1)) as pool:
        paths = list(pool.map(lambda each: library(str(each.dump()), _LEVEL), generators))
    for f, path in zip(left, paths, strict=True):
        _built[f] = ca.external(f.name(), str(path))
    return [_built.get(f, f) for f in functions]


def is_short(f: ca.Function) -> bool:
    """Return whether a function is one of scalar operations that a compiler is soon done with."""
    return f.is_a("SXFunction") and f.n_instructions() <= _LONGEST


def kernel(function: ca.Function, machine_code: bool = True) -> ca.Function:
    """Return a function as machine code, or as it is; see kernels."""
    return kernels([function], machine_code)[0]


def built(make: Callable[..., K], *of: Any) -> K:
    """Return what is made of a structure, made once for all arms and meshes that have it."""
    result: K = _made(make, *of)
    return result


@lru_cache(maxsize=512)
def _made(make: Callable[..., Any], *of: Any) -> Any:
    return make(*of)
