"""Files: read with a sentence for what is none, and written whole or not at all.

What is written is staged beside where it goes, then moved there.
"""

from __future__ import annotations

import difflib
import errno
import hashlib
import os
import platform
import re
import shutil
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import numpy as np

from octoplan.model.support.checks import kind
from octoplan.model.support.errors import FileError, InputError, as_given, shortened

# Folders in which files are staged, beside where they go, are named after machine and process: by
# that it is known what a killed process has left there.
_MARK = ".octoplan.part"
# Those of this process.
_staging: set[Path] = set()
# What this process has written last, and that in words, for whoever ends it.
_kept: deque[tuple[Path, str]] = deque(maxlen=9)


@contextmanager
def staged(folder: Path) -> Iterator[Path]:
    """Yield a new folder inside a folder, which is gone afterwards, and so are orphans of it."""
    machine = hashlib.sha256(platform.node().encode()).hexdigest()[:8]
    for other in folder.glob(f"{_MARK}.{machine}.*"):
        if _is_orphan(other):
            shutil.rmtree(other, ignore_errors=True)
    prefix = f"{_MARK}.{machine}.{os.getpid()}."
    with TemporaryDirectory(prefix=prefix, dir=folder, ignore_cleanup_errors=True) as name:
        here = Path(name)
        _staging.add(here)
        try:
            yield here
        finally:
            _staging.remove(here)


@contextmanager
def whole(path: Path, within: Path | None = None) -> Iterator[Path]:
    """Yield a path to write a file or a folder to, which takes its place once it is there whole.

    It is staged in the folder that it is in, or within another one, in which that is made then.
    """
    with staged(within or path.parent) as here:
        part = here / path.name
        yield part
        path.parent.mkdir(exist_ok=True)
        if part.is_dir() and path.is_dir():
            # A folder cannot take the place of another at once.
            path.replace(here / "old")
        part.replace(path)


def _is_orphan(folder: Path) -> bool:
    """Return whether the process of this machine that staged in a folder is there no more."""
    process = folder.name.removeprefix(_MARK).split(".")[2]
    if process == str(os.getpid()):
        return folder not in _staging
    if os.name != "posix" or not process.isdigit():
        return False
    try:
        os.kill(int(process), 0)
    except (OSError, OverflowError) as reason:
        return not isinstance(reason, PermissionError)
    return False


@contextmanager
def atomic_write(path: Path, *suffixes: str) -> Iterator[Path]:
    """Yield a path to write a file to, which is moved to `path` once it is there whole.

    Raises InputError for a name that ends otherwise, and where it cannot be written.
    """
    if path.suffix.lower() not in suffixes:
        raise InputError("path", str(path), f"a file name that ends in {' or '.join(suffixes)}")
    try:
        with whole(path) as part:
            yield part
        remember_written(path, f"{path} is written")
    except (OSError, ValueError) as reason:
        if isinstance(reason, InputError):
            raise
        raise InputError("path", str(path), f"a file that can be written: {why(reason)}") from None


def remember_written(path: Path, text: str) -> None:
    """Say what stays where it is should the process be ended while a path is there."""
    if (path, text) not in _kept:
        _kept.append((path, text))


def end() -> str:
    """Remove what is not whole, as the process ends at once; return what is kept, in words."""
    for here in tuple(_staging):
        shutil.rmtree(here, ignore_errors=True)
    return "; ".join(text for path, text in _kept if path.exists()) or "nothing was written"


def write_together(folder: Path, contents: dict[str, bytes]) -> None:
    """Write files into a folder, which is made if need be: all of them, or on an error none.

    They are staged in it, or where it is to be made, so that a full disk spoils nothing; a folder
    in the place of one of them is refused before. Raises FileError.
    """
    try:
        there = next(place for place in (folder, *folder.parents) if place.is_dir())
        with staged(there) as here:
            for name, content in contents.items():
                if (folder / name).is_dir():
                    raise IsADirectoryError(errno.EISDIR, f"{name} in it is a folder")
                (here / name).write_bytes(content)
            folder.mkdir(parents=True, exist_ok=True)
            for name in contents:
                (here / name).replace(folder / name)
            remember_written(folder, f"{', '.join(contents)} in {folder} are written")
    except (OSError, ValueError) as reason:
        text = f"no file was written in this folder: {why(reason)}"
        raise FileError(str(folder), "", text) from None


def path_of(value: Any, field: str = "path") -> Path:
    """Return a path; InputError for what is none."""
    return Path(kind(field, value, str | os.PathLike, "the name of a file or folder"))


def write_named(path: str | Path, suffix: str, content: bytes) -> Path:
    """Write a file whose name has to end in a suffix; returns its path.

    Raises InputError for another suffix, and where it cannot be written.
    """
    path = path_of(path)
    with atomic_write(path, suffix) as part:
        part.write_bytes(content)
    return path


def why(reason: OSError | ValueError) -> str:
    """Return why a file cannot be read or written, in the system's words."""
    return (getattr(reason, "strerror", None) or str(reason)).lower()


def to_json(values: Any) -> bytes:
    """Return values as JSON, indented; numbers that are not finite become null."""
    return msgspec.json.format(msgspec.json.encode(values, enc_hook=_item), indent=2)


def _item(value: Any) -> Any:
    """Return numbers of NumPy's as Python's, mappings as dicts."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} is nothing that JSON can hold")


def versions() -> dict[str, str]:
    """Return the versions of what computes."""
    return {"octoplan": version("octoplan"), "casadi": version("casadi"), "numpy": version("numpy")}


# Read

_REMEDIES = (
    (r"=\s*-?\d+,\d", "decimal numbers have a point: 0.5"),
    (
        r"=\s*[A-Za-z_][\w-]*\s*(#.*)?$",
        'text goes in quotes, as in preset = "table-4"; true, false',
    ),
    (r"=\s*-?[\d.]+\s*[A-Za-z]", "a number stands alone; its unit is in the key"),
    (r"=\s*-?\.\d|=\s*-?\d+\.(\D|$)", "digits on both sides of a point: 0.5, 3.0"),
    (r"^\s*[\w.]+\s*:", "keys and values are joined by =, as in nu = 0.5"),
    (r"^\s*\[[^\]]*$", "a table begins with its name in brackets, as in [arm]"),
)


def bytes_of(path: Path, wanted: str = "") -> bytes:
    """Return what a file holds; FileError, with what is wanted, where it cannot be read.

    A scene file unless said. A pipe is no file: it might never end.
    """
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise OSError(errno.EINVAL, "this is no ordinary file")
        return path.read_bytes()
    except (OSError, ValueError) as reason:  # ValueError for names that no file can have
        raise FileError(str(path), "", f"{why(reason)}; {wanted or _instead(path)}") from None


def read_toml(path: Path) -> tuple[dict[str, Any], str]:
    """Return what a TOML file holds, and its text; FileError."""
    text = bytes_of(path)
    if path.suffix.lower() != ".toml":
        wanted = "no scene file: those are TOML, with names that end in .toml"
        raise FileError(str(path), "", wanted)
    return toml_of(text, str(path)), text.decode(errors="replace")


def _instead(path: Path) -> str:
    """Return what to name in place of a file that cannot be read."""
    others: dict[str, str] = {}
    with suppress(OSError, ValueError):
        result = (other for other in path.parent.glob("*.toml") if other.is_file())
        others = {other.stem: other.name for other in result}
    near = difflib.get_close_matches(path.stem, others, 1)
    if near:
        return f'did you mean "{path.with_name(others[near[0]])}"?'
    return "a scene file is wanted, `octoplan new FILE` writes one"


def toml_of(text: bytes, name: str) -> dict[str, Any]:
    """Return what a TOML text holds; FileError that shows the line where it is none."""
    try:
        return dict(msgspec.toml.decode(text))
    except (msgspec.DecodeError, ValueError, RecursionError) as reason:
        words, _, place = str(reason).rpartition(" (at line ")
        number = place.partition(",")[0]
        if not number.isdigit():
            raise FileError(name, "", f"this is not valid TOML: {reason}") from None
    lines = text.decode(errors="replace").splitlines()[int(number) - 1 : int(number)]
    line = lines[0].strip() if lines else ""
    remedy = next((f"; {message}" for wrong, message in _REMEDIES if re.search(wrong, line)), "")
    message = f"not valid TOML: {words[:1].lower()}{words[1:]}: {shortened(line)}{remedy}"
    raise FileError(name, f"line {number}", message)


def read_json(path: Path, wanted: str) -> dict[str, Any]:
    """Return what a saved file holds; FileError for one of another `schema`, with what to do.

    What is wanted is "octoplan WHAT VERSION".
    """
    name, what = str(path), wanted.split()[1]
    try:
        table = msgspec.json.decode(bytes_of(path, f"a {what} that was saved is wanted"))
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as reason:
        raise FileError(name, "", f"this is not valid JSON: {reason}") from None
    if not isinstance(table, dict):
        raise FileError(name, "the file", f"must be a saved {what}", as_given(table))
    schema = table.get("schema")
    if schema == wanted:
        return table
    if schema is None:
        raise FileError(name, "schema", f'missing: must be "{wanted}" in a saved {what}')
    problem = f'must be "{wanted}"'
    if isinstance(schema, str) and schema.startswith(f"octoplan {what} "):
        problem += f"; use the version of octoplan that saved this {what}, or compute a new one"
    raise FileError(name, "schema", problem, as_given(schema))
