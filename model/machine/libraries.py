"""Shared libraries on disk, in the user's cache folder, so that each is compiled once.

A library's name is a hash of its source, compiler and flags, and then the checksum of its own
bytes: what is found under the name but has another checksum is never loaded. Libraries come to
their names in one step, so that several processes may build the same at once.
"""

from __future__ import annotations

import atexit
import hashlib
import inspect
import shutil
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from platformdirs import user_cache_path

from model.machine.compiler import FLAGS, compiler
from model.warn import warn


def library(source: str, flag: str, prepare: Callable[[str], str] | None = None) -> Path:
    """Return the library of C source, verified; built where it is not there.

    Parameters
    ----------
    flag : str
        Of the compiler, besides those that are always given.
    prepare : function
        What is done to the source before it is compiled.

    Raises
    ------
    CompilerError
    """
    by = compiler()
    how = inspect.getsource(sys.modules[prepare.__module__]) if prepare else ""
    told = (source, how, by.command, by.identity, FLAGS, flag)
    key, folder = hashlib.sha256(repr(told).encode()).hexdigest(), cache_folder()
    for path in folder.glob(f"{key}-*.so"):
        if path.name == _name(key, path):
            return path
        with suppress(OSError):
            path.unlink()
    with tempfile.TemporaryDirectory(prefix="building-", dir=_writable(folder)) as work:
        built = Path(work) / "library.so"
        by.compile(prepare(source) if prepare else source, built, flag)
        path = Path(work).parent / _name(key, built)
        built.replace(path)
    return path


def cache_folder() -> Path:
    """Return the folder of the libraries; it need not be there."""
    return user_cache_path("octoplan", appauthor=False) / "compiled"


def _name(key: str, path: Path) -> str:
    return f"{key}-{hashlib.sha256(path.read_bytes()).hexdigest()}.so"


def _writable(folder: Path) -> Path:
    """Return the folder, or where it cannot be written one that lasts as long as the process."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as reason:
        told = f"compiled code is not kept, and compiled again by each process: {reason}"
        warn(told, RuntimeWarning)
        return _scratch()


@lru_cache(maxsize=1)
def _scratch() -> Path:
    folder = tempfile.mkdtemp(prefix="octoplan-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)
