"""The C compiler of the machine: $CC, or cc, gcc, clang, or the one in the wheel ziglang."""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from model.errors import CompilerError

# No contraction of products and sums: the digits are those of the interpreter.
FLAGS = ("-march=native", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared")
_NAMES = ("cc", "gcc", "clang")
_REMEDY = "install one, name one by $CC, or pip install 'octoplan[compiled]'"


@dataclass(frozen=True)
class Compiler:
    """A compiler that works.

    Attributes
    ----------
    command : tuple of str
        How it is called.
    identity : str
        A hash of its version and of the processor that it compiles for.
    """

    command: tuple[str, ...]
    identity: str

    def compile(self, source: str, library: Path, flag: str) -> None:
        """Write the shared library of C source; raises CompilerError."""
        given = ("-x", "c", "-", "-o", str(library), "-lm")
        _run((*self.command, *FLAGS, flag, *given), source)


def compiler() -> Compiler:
    """Return the compiler; raises CompilerError where there is none, or it fails."""
    return _compiler(os.environ.get("CC", ""), os.environ.get("PATH", ""))


@lru_cache(maxsize=8)
def _compiler(named: str, path: str) -> Compiler:
    command = _command(named)
    # The macros that it begins with tell its version, the machine and the processor's features.
    macros = _run((*command, *FLAGS[:1], "-dM", "-E", "-x", "c", "-"), "")
    return Compiler(command, hashlib.sha256(macros.encode()).hexdigest())


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
