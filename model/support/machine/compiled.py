"""Kernels as machine code: the same digits as interpreted, ten to twenty times sooner.

Shared libraries are in the user's cache folder, so that each is compiled once. A library's name is
a hash of its source, compiler and flags, and then the checksum of its own bytes: what is found
under the name but has another checksum is never loaded. Libraries come to their names in one step,
so that several processes may build the same at once.
"""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal
from weakref import WeakKeyDictionary

import casadi as ca
from platformdirs import user_cache_path

from octoplan.model.support.errors import CompilerError, CompilerWarning, InputError
from octoplan.model.support.units import warn

Compile = bool | Literal["auto"]
# More takes the compiler several times as long, for code that is a tenth faster.
_LEVEL = "-O1"
# Longer functions stay as they are: half a minute of a compiler's for what few plans call at all,
# those that hold the least stable mode to a margin.
_LONGEST = 31_000
_built: WeakKeyDictionary[ca.Function, ca.Function] = WeakKeyDictionary()
# No contraction of products and sums: the digits are those of the interpreter.
FLAGS = ("-march=native", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared")
_NAMES = ("cc", "gcc", "clang")
_REMEDY = "install one, name one by $CC, or pip install 'octoplan[compiled]'"


def checked_compile(compile: Any) -> bool:  # noqa: A002  (the name that scripts use)
    """Return whether to compile: True, False, or "auto" for where there is a compiler that works.

    Raises InputError for anything else; CompilerError for True where there is none.
    """
    if isinstance(compile, bool) and not compile:
        return False
    if compile is not True and not (isinstance(compile, str) and compile == "auto"):
        raise InputError("compile", compile, 'True, False or "auto"')
    try:
        _compile_trial(os.environ.get("CC"), os.environ.get("PATH"))
    except CompilerError as reason:
        if compile is True:
            raise
        warn("not compiled: no C compiler works", CompilerWarning, f"not compiled: {reason}")
        return False
    return True


@lru_cache(maxsize=8)
def _compile_trial(named: str | None, path: str | None) -> None:
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


@lru_cache(maxsize=8)
def _compiler(named: str, path: str) -> tuple[tuple[str, ...], str]:
    """Return how the compiler is called, and a hash of its version and of the processor."""
    command = _command(named)
    # The macros that it begins with tell its version, the machine and the processor's features.
    macros = _run((*command, *FLAGS[:1], "-dM", "-E", "-x", "c", "-"), "")
    return command, hashlib.sha256(macros.encode()).hexdigest()


def _command(named: str) -> tuple[str, ...]:
    words = tuple(shlex.split(named))
    if words:
        if shutil.which(words[0]) is None:
            raise CompilerError(f"the C compiler that $CC names is not there: {named!r}; {_REMEDY}")
        return words
    for name in _NAMES:
        if shutil.which(name):
            return (name,)
    if find_spec("ziglang"):
        return (sys.executable, "-m", "ziglang", "cc")
    raise CompilerError(f"no C compiler was found as {', '.join(_NAMES)}; {_REMEDY}")


def _run(command: tuple[str, ...], source: str) -> str:
    """Return what a command prints, given source; raises CompilerError with what it says."""
    try:
        done = subprocess.run(command, input=source, capture_output=True, text=True, check=False)
    except OSError as reason:
        raise CompilerError(f"the C compiler {command[0]} failed: {reason}") from None
    if done.returncode != 0:
        said = done.stderr.strip()[-2000:] or f"it ended with code {done.returncode}"
        raise CompilerError(f"the C compiler {shlex.join(command[:4])} failed: {said}")
    return done.stdout


def library(source: str, flag: str) -> Path:
    """Return the library of C source, verified; built where it is not there.

    Parameters
    ----------
    flag : str
        Of the compiler, besides those that are always given.

    Raises
    ------
    CompilerError
    """
    command, identity = _compiler(os.environ.get("CC", ""), os.environ.get("PATH", ""))
    values = (source, command, identity, FLAGS, flag)
    key, folder = hashlib.sha256(repr(values).encode()).hexdigest(), cache_folder()
    for path in folder.glob(f"{key}-*.so"):
        if path.name == _file_name(key, path):
            return path
        with suppress(OSError):
            path.unlink()
    with tempfile.TemporaryDirectory(prefix="building-", dir=_writable(folder)) as work:
        built = Path(work) / "library.so"
        _run((*command, *FLAGS, flag, "-x", "c", "-", "-o", str(built), "-lm"), source)
        path = Path(work).parent / _file_name(key, built)
        built.replace(path)
    return path


def cache_folder() -> Path:
    """Return the folder of the libraries; it need not be there."""
    return user_cache_path("octoplan", appauthor=False) / "compiled"


def _file_name(key: str, path: Path) -> str:
    return f"{key}-{hashlib.sha256(path.read_bytes()).hexdigest()}.so"


def _writable(folder: Path) -> Path:
    """Return the folder, or where it cannot be written one that lasts as long as the process."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as reason:
        text = "compiled code is not kept, and compiled again by each process"
        warn(text, CompilerWarning, f"{text}: {reason}")
        return Path(_temporary_folder().name)


@lru_cache(maxsize=1)
def _temporary_folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="octoplan-", ignore_cleanup_errors=True)
