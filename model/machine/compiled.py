"""Functions compiled to machine code by the C compiler of the machine: the same digits, faster."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar
from weakref import WeakKeyDictionary

import casadi as ca

from model.errors import OctoplanError

T = TypeVar("T")
# No contraction of products and sums: the digits are those of the interpreter. The code runs on no
# other machine than the one it is compiled on.
_FLAGS = ("-O2", "-march=native", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared")
_built: WeakKeyDictionary[ca.Function, ca.Function] = WeakKeyDictionary()


class CompilerError(OctoplanError):
    """There is no C compiler, or it failed; the message is its own."""


def compiled(function: ca.Function) -> ca.Function:
    """Return a function as machine code, built once in a process; raises CompilerError."""
    if function not in _built:
        generator = ca.CodeGenerator("function.c")
        generator.add(function)
        name = function.name()
        _built[function] = compile_c(generator.dump(), lambda path: ca.external(name, path))
    return _built[function]


def compile_c(source: str, load: Callable[[str], T]) -> T:
    """Return what `load` makes of the path of the shared library compiled from C source.

    Raises CompilerError.
    """
    compiler = shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc")
    if compiler is None:
        raise CompilerError("compile=True needs a C compiler: none found as $CC, cc or gcc")
    with tempfile.TemporaryDirectory() as folder:
        code, library = Path(folder) / "code.c", Path(folder) / "code.so"
        code.write_text(source, encoding="utf-8")
        command = [compiler, *_FLAGS, str(code), "-o", str(library), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise CompilerError(f"{compiler} failed: {done.stderr.strip()[-2000:]}")
        return load(str(library))
