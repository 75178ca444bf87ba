"""Read files with clear errors; write files atomically: complete, or not at all.

Output is staged in a temporary folder beside the destination and moved at the end.
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

# Prefix of the names of staging folders; the host and the process id follow. An id whose process
# has ended marks an orphaned folder.
_MARK = ".octoplan.part"
# Staging folders of this process.
_staging: set[Path] = set()
# Files written last by this process, and the sentences that report them when the process is ended.
_written: deque[tuple[Path, str]] = deque(maxlen=9)


@contextmanager
def staging_folder(folder: Path) -> Iterator[Path]:
    """Yield a new staging folder inside a folder; remove this one and orphaned ones afterwards."""
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
def atomic_replace(path: Path, within: Path | None = None) -> Iterator[Path]:
    """Yield a path to write a file or a folder to; move the result to `path` at the end.

    The staging folder is inside `within`, or in the folder of `path` by default.
    """
    with staging_folder(within or path.parent) as here:
        part = here / path.name
        yield part
        path.parent.mkdir(exist_ok=True)
        if part.is_dir() and path.is_dir():
            # One folder cannot replace another in a single step.
            path.replace(here / "old")
        part.replace(path)


def _is_orphan(folder: Path) -> bool:
    """Return True if a staging folder belongs to an ended process of this host."""
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
    """Yield a path to write a file to; move the result to `path` at the end.

    Raises InputError if the suffix is not one of `suffixes` or the file cannot be written.
    """
    if path.suffix.lower() not in suffixes:
        raise InputError("path", str(path), f"a file name that ends in {' or '.join(suffixes)}")
    try:
        with atomic_replace(path) as part:
            yield part
        remember_written(path, f"{path} is written")
    except (OSError, ValueError) as reason:
        if isinstance(reason, InputError):
            raise
        raise InputError(
            "path", str(path), f"a file that can be written: {system_message(reason)}"
        ) from None


def remember_written(path: Path, text: str) -> None:
    """Record a sentence that `discard_staged` returns as long as `path` exists."""
    if (path, text) not in _written:
        _written.append((path, text))


def discard_staged() -> str:
    """Remove all staging folders before the process exits; return which files were written."""
    for here in tuple(_staging):
        shutil.rmtree(here, ignore_errors=True)
    return "; ".join(text for path, text in _written if path.exists()) or "nothing was written"


def write_together(folder: Path, contents: dict[str, bytes]) -> None:
    """Write files into a folder, created if needed: all files, or none on an error.

    All files are staged before the first is moved, so that a full disk leaves no partial result.
    Raises FileError if a file cannot be written or a folder of that name exists.
    """
    try:
        there = next(place for place in (folder, *folder.parents) if place.is_dir())
        with staging_folder(there) as here:
            for name, content in contents.items():
                if (folder / name).is_dir():
                    raise IsADirectoryError(errno.EISDIR, f"{name} in this folder is a folder")
                (here / name).write_bytes(content)
            folder.mkdir(parents=True, exist_ok=True)
            for name in contents:
                (here / name).replace(folder / name)
            remember_written(folder, f"{', '.join(contents)} in {folder} are written")
    except (OSError, ValueError) as reason:
        text = f"no file was written in this folder: {system_message(reason)}"
        raise FileError(str(folder), "", text) from None


def path_of(value: Any, field: str = "path") -> Path:
    """Return a value as a path; raise InputError for other types."""
    return Path(kind(field, value, str | os.PathLike, "the name of a file or folder"))


def write_named(path: str | Path, suffix: str, content: bytes) -> Path:
    """Write a file whose name ends in a suffix; return the path.

    Raises InputError for another suffix or if the file cannot be written.
    """
    path = path_of(path)
    with atomic_write(path, suffix) as part:
        part.write_bytes(content)
    return path


def system_message(reason: OSError | ValueError) -> str:
    """Return the message of the operating system for a file that cannot be read or written."""
    return (getattr(reason, "strerror", None) or str(reason)).lower()


def to_json(values: Any) -> bytes:
    """Return values as JSON, indented; numbers that are not finite become null."""
    return msgspec.json.format(msgspec.json.encode(values, enc_hook=_item), indent=2)


def _item(value: Any) -> Any:
    """Return NumPy numbers and arrays as Python numbers and lists, and mappings as dicts."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def versions() -> dict[str, str]:
    """Return the versions of octoplan and of the numerical libraries."""
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
    (r"^\s*\[target\]", "several targets have a [[targets]] table each"),
    (r"^\s*\[[^\]]*$", "a table begins with its name in brackets, as in [arm]"),
)


def read_bytes(path: Path, wanted: str = "") -> bytes:
    """Return the contents of a file; raise FileError with a remedy if the file cannot be read.

    `wanted` is the remedy; the default names a scene file. Pipes are rejected: a pipe may never
    end.
    """
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise OSError(errno.EINVAL, "this is no ordinary file")
        return path.read_bytes()
    except (OSError, ValueError) as reason:  # ValueError: the name is not valid for a file
        raise FileError(
            str(path), "", f"{system_message(reason)}; {wanted or _instead(path)}"
        ) from None


def read_toml(path: Path) -> tuple[dict[str, Any], str]:
    """Return the contents and the text of a TOML file; raise FileError."""
    text = read_bytes(path)
    if path.suffix.lower() != ".toml":
        wanted = "must be a scene file, a TOML file whose name ends in .toml"
        raise FileError(str(path), "", wanted)
    return parse_toml(text, str(path)), text.decode(errors="replace")


def _instead(path: Path) -> str:
    """Return the remedy for a scene file that cannot be read: the nearest name, or `new`."""
    others: dict[str, str] = {}
    with suppress(OSError, ValueError):
        result = (other for other in path.parent.glob("*.toml") if other.is_file())
        others = {other.stem: other.name for other in result}
    near = difflib.get_close_matches(path.stem, others, 1)
    if near:
        return f'did you mean "{path.with_name(others[near[0]])}"?'
    return "must be a scene file; `octoplan new FILE` writes one"


def parse_toml(text: bytes, name: str) -> dict[str, Any]:
    """Return the contents of a TOML text; raise FileError with the line of a syntax error."""
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
    """Return the contents of a saved file; raise FileError if `schema` is not `wanted`.

    `wanted` is "octoplan KIND VERSION".
    """
    name = str(path)
    what = wanted.split()[1]
    try:
        table = msgspec.json.decode(read_bytes(path, f"must be a saved {what}"))
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
