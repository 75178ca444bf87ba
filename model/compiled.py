"""Functions compiled to machine code by the C compiler of the machine: the same digits, faster."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from weakref import WeakKeyDictionary

import casadi as ca

from model.errors import OctoplanError

_built: WeakKeyDictionary[ca.Function, ca.Function] = WeakKeyDictionary()


class CompilerError(OctoplanError):
    """There is no C compiler, or it failed; the message is its own."""


def compiled(function: ca.Function) -> ca.Function:
    """Return a function as machine code, built once in a process.

    Raises CompilerError. Contraction of products and sums is off, so that the digits are those of
    the interpreter.
    """
    if function not in _built:
        _built[function] = _build(function)
    return _built[function]


def _build(function: ca.Function) -> ca.Function:
    compiler = shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc")
    if compiler is None:
        raise CompilerError("compile=True needs a C compiler: none found as $CC, cc or gcc")
    with tempfile.TemporaryDirectory() as folder:
        generator = ca.CodeGenerator("function.c")
        generator.add(function)
        source = generator.generate(f"{folder}/")
        library = Path(folder) / "function.so"
        command = [
            compiler,
            "-O2",
            "-ffp-contract=off",
            "-fPIC",
            "-shared",
            source,
            "-o",
            str(library),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise CompilerError(f"{compiler} failed: {done.stderr.strip()[-2000:]}")
        return ca.external(function.name(), str(library))
