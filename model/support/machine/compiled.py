"""Kernels as machine code: results identical to the interpreter's, ten to twenty times faster.

Shared libraries are stored in the user's cache folder, so that each is compiled once. The name of a
library is a hash of source, compiler and flags, followed by the checksum of the library. A file
with a wrong checksum is never loaded. Files are renamed atomically, so that several processes may
compile the same library at the same time.
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
import numpy as np
from platformdirs import user_cache_path

from octoplan.model.support.errors import CompilerError, CompilerWarning, InputError
from octoplan.model.support.units import warn

Compile = bool | Literal["auto"]
# Optimisation level. Higher levels multiply the compile time, for code that is 10 % faster.
_LEVEL = "-O1"
# Largest number of instructions of a compiled function. Longer functions take half a minute to
# compile, and only plans with a stability margin call them.
_LONGEST = 31_000
_compiled: WeakKeyDictionary[ca.Function, ca.Function] = WeakKeyDictionary()
# Contraction of products and sums is off, so that results are identical to the interpreter's.
FLAGS = ("-march=native", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared")
_NAMES = ("cc", "gcc", "clang")
_REMEDY = "install one, name one by $CC, or pip install 'octoplan[compiled]'"


def checked_compile(compile: Any) -> bool:  # noqa: A002  (the name that scripts use)
    """Return whether to compile, for True, False, or "auto": if a compiler works.

    Raises InputError for other values, and CompilerError for True without a working compiler.
    """
    is_auto = isinstance(compile, str) and compile == "auto"
    if not is_auto and not isinstance(compile, bool | np.bool_):
        raise InputError("compile", compile, 'True, False or "auto"')
    if not compile:
        return False
    try:
        _compile_trial(os.environ.get("CC"), os.environ.get("PATH"))
    except CompilerError as reason:
        if not is_auto:
            raise
        warn("not compiled: no C compiler works", CompilerWarning, f"not compiled: {reason}")
        return False
    return True


@lru_cache(maxsize=8)
def _compile_trial(named: str | None, path: str | None) -> None:
    """Compile a trivial library; cached by the environment variables CC and PATH."""
    library("int works(void) { return 1; }\n", _LEVEL)


def kernels(functions: Iterable[ca.Function], machine_code: bool = True) -> list[ca.Function]:
    """Return functions as machine code, or unchanged; compile several functions in parallel.

    Long functions, and functions that are not SX functions, are returned unchanged. CasADi cannot
    differentiate compiled functions.

    Raises CompilerError.
    """
    functions = list(functions)
    if not machine_code:
        return functions
    new = [f for f in dict.fromkeys(functions) if f not in _compiled and is_short(f)]
    generators = [ca.CodeGenerator("function.c") for _ in new]
    for generator, f in zip(generators, new, strict=True):
        generator.add(f)
    with ThreadPoolExecutor(max(len(new), 1)) as pool:
        paths = list(pool.map(lambda each: library(str(each.dump()), _LEVEL), generators))
    for f, path in zip(new, paths, strict=True):
        _compiled[f] = ca.external(f.name(), str(path))
    return [_compiled.get(f, f) for f in functions]


def is_short(f: ca.Function) -> bool:
    """Return whether a function consists of scalar operations, few enough to compile."""
    return f.is_a("SXFunction") and f.n_instructions() <= _LONGEST


def kernel(function: ca.Function, machine_code: bool = True) -> ca.Function:
    """Return a function as machine code, or unchanged; see kernels."""
    return kernels([function], machine_code)[0]


@lru_cache(maxsize=8)
def _compiler(named: str, path: str) -> tuple[tuple[str, ...], str]:
    """Return the command of the compiler, and a hash of its version and of the processor."""
    command = _command(named)
    # Predefined macros identify the version, the machine and the processor's features.
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
    """Return the output of a command for a source; raise CompilerError with the error output."""
    try:
        done = subprocess.run(command, input=source, capture_output=True, text=True, check=False)
    except OSError as reason:
        raise CompilerError(f"the C compiler {command[0]} failed: {reason}") from None
    if done.returncode != 0:
        said = done.stderr.strip()[-2000:] or f"it ended with code {done.returncode}"
        raise CompilerError(f"the C compiler {shlex.join(command[:4])} failed: {said}")
    return done.stdout


def library(source: str, flag: str) -> Path:
    """Return the verified library of C source; compile it if necessary.

    Parameters
    ----------
    source : str
    flag : str
        Flag of the compiler in addition to FLAGS.

    Raises
    ------
    CompilerError
    """
    command, identity = _compiler(os.environ.get("CC", ""), os.environ.get("PATH", ""))
    values = (source, command, identity, FLAGS, flag)
    key = hashlib.sha256(repr(values).encode()).hexdigest()
    folder = cache_folder()
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
    """Return the folder of the libraries, which may not exist."""
    return user_cache_path("octoplan", appauthor=False) / "compiled"


def _file_name(key: str, path: Path) -> str:
    return f"{key}-{hashlib.sha256(path.read_bytes()).hexdigest()}.so"


def _writable(folder: Path) -> Path:
    """Return the folder if it is writable, otherwise a temporary folder of this process."""
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
