"""Shared libraries on disk, in the user's cache folder, so that each is compiled once.

A library's name is a hash of its source, compiler and flags, and then the checksum of its own
bytes: what is found under the name but has another checksum is never loaded. Libraries come to
their names in one step, so that several processes may build the same at once.
"""

from __future__ import annotations

import atexit
import hashlib
import inspect
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from platformdirs import user_cache_path

from model.errors import CompilerError
from model.units import warn

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
        arguments = ("-x", "c", "-", "-o", str(library), "-lm")
        _run((*self.command, *FLAGS, flag, *arguments), source)


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
    values = (source, how, by.command, by.identity, FLAGS, flag)
    key, folder = hashlib.sha256(repr(values).encode()).hexdigest(), cache_folder()
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
        message = f"compiled code is not kept, and compiled again by each process: {reason}"
        warn(message, RuntimeWarning)
        return _scratch()


@lru_cache(maxsize=1)
def _scratch() -> Path:
    folder = tempfile.mkdtemp(prefix="octoplan-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


# Longer pieces take the compiler longer, shorter ones hand on more: the code of 64 to 250 lines
# takes as long to run, within a tenth.
_LINES, _WHOLE = 128, 512
_BEGIN = re.compile(r"^static int \w+\(const casadi_real\*\* arg, .*\{$", re.MULTILINE)
_END = "\n  return 0;\n}"
_DECLARED = "  casadi_real a"
_VARIABLE = re.compile(r"\ba\d+\b")
_ASSIGNED = re.compile(r"  (a\d+)=")


def in_pieces(source: str) -> str:
    """Return CasADi's C of one SX function, with its list of assignments in pieces."""
    begin = _BEGIN.search(source)
    assert begin is not None
    head, name = source[: begin.start()], begin.group()
    body, tail = source[begin.end() :].split(_END, 1)
    lines = [line for line in body.strip("\n").split("\n") if not line.startswith(_DECLARED)]
    arguments = {"arg": "const casadi_real**", "res": "casadi_real**"}
    functions, calls = cut(lines, "piece", arguments, "casadi_real")
    return "".join([head, functions, name, "\n", calls, _END, tail])


def cut(
    lines: Sequence[str], name: str, arguments: Mapping[str, str], number: str
) -> tuple[str, str]:
    """Return functions that do the assignments of lines in pieces, and what calls all of them.

    They are named after `name`; `arguments` are those of the whole, with their types, and `number`
    is the type of the variables.
    """
    size = len(lines) if len(lines) <= _WHOLE else _LINES
    pieces = [lines[i : i + size] for i in range(0, len(lines), size)]
    written, later = [], set[str]()
    value = ", ".join(f"{kind} {value}" for value, kind in arguments.items())
    for k, piece in reversed(list(enumerate(pieces))):
        head = f"static void {name}{k}({value}, {number}* kept)"
        written.append(_piece(head, piece, later, number))
        later = (later - _assigned(piece)) | _read(piece)
    size = 1 + max(int(v[1:]) for line in lines for v in _VARIABLE.findall(line))
    handed = ", ".join([*arguments, "kept"])
    calls = [f"\n  {name}{k}({handed});" for k in range(len(pieces))]
    return "".join(reversed(written)), "".join([f"  {number} kept[{size}];", *calls])


def _piece(head: str, lines: Sequence[str], later: set[str], number: str) -> str:
    """Return a piece as a function that reads and leaves in `kept` what others share with it."""
    read, assigned = _read(lines), _assigned(lines)
    return "\n".join(
        [
            f"__attribute__((noinline)) {head} {{",
            f"  {number} {', '.join(sorted(read | assigned))};",
            *(f"  {v}=kept[{int(v[1:])}];" for v in sorted(read)),
            *lines,
            *(f"  kept[{int(v[1:])}]={v};" for v in sorted(assigned & later)),
            "}\n\n",
        ]
    )


def _assigned(lines: Sequence[str]) -> set[str]:
    return {match.group(1) for match in map(_ASSIGNED.match, lines) if match}


def _read(lines: Sequence[str]) -> set[str]:
    """Return the variables that are read before they are assigned."""
    read, assigned = set[str](), set[str]()
    for line in lines:
        match = _ASSIGNED.match(line)
        read.update(set(_VARIABLE.findall(line[match.end() :] if match else line)) - assigned)
        if match:
            assigned.add(match.group(1))
    return read
