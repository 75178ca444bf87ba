"""Files that are there whole or not at all."""

from __future__ import annotations

import errno
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from model.errors import FileError, InputError
from planner.staging import keep, placed, staged


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it is there whole or not at all."""
    with placed(path) as part:
        part.write_bytes(content)


def write_together(folder: Path, contents: dict[str, bytes]) -> None:
    """Write files into a folder, which is made if need be: all of them, or on an error none.

    They are staged in a folder inside it first, so that a full disk spoils nothing; what was there
    before is put back where one of them cannot take its place. Raises FileError.
    """
    try:
        _write_staged(folder, contents)
    except (OSError, ValueError) as reason:
        told = f"no file was written in this folder: {why(reason)}"
        raise FileError(str(folder), "", told) from None


def _write_staged(folder: Path, contents: dict[str, bytes]) -> None:
    new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with staged(folder) as here:
            for name, content in contents.items():
                (here / name).write_bytes(content)
            _take_places(here, folder, list(contents))
            keep(f"{', '.join(contents)} in {folder} are written")
    except BaseException:
        if new:
            with suppress(OSError):
                folder.rmdir()
        raise


def _take_places(here: Path, folder: Path, names: list[str]) -> None:
    before: dict[str, bytes | None] = {}
    try:
        for name in names:
            path = folder / name
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, f"{name} in it is a folder")
            old = path.read_bytes() if path.is_file() else None
            (here / name).replace(path)
            before[name] = old
    except BaseException:
        for name, content in before.items():
            if content is None:
                (folder / name).unlink()
            else:
                (folder / name).write_bytes(content)
        raise


def write_named(path: str | Path, suffix: str, content: bytes) -> Path:
    """Write a file whose name has to end in a suffix; returns its path.

    Raises InputError for another suffix, and where it cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != suffix:
        raise InputError("path", str(path), f"a file name that ends in {suffix}")
    try:
        write_whole(path, content)
    except (OSError, ValueError) as reason:
        raise InputError("path", str(path), f"a file that can be written: {why(reason)}") from None
    return path


def read_file(path: Path) -> bytes:
    """Return what a file holds; OSError for what is none, such as a pipe, which might never end.

    ValueError for names that no file can have.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        raise OSError(errno.EINVAL, "this is no ordinary file")
    return path.read_bytes()


def why(reason: OSError | ValueError) -> str:
    """Return why a file cannot be read or written, in the system's words."""
    told = reason.strerror if isinstance(reason, OSError) else None
    return (told or str(reason)).lower()


def to_json(values: Any) -> bytes:
    """Return values as JSON, indented; numbers that are not finite become null."""
    return msgspec.json.format(msgspec.json.encode(values, enc_hook=_item), indent=2)


def _item(value: Any) -> Any:
    """Return a number of NumPy's as one of Python's."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is nothing that JSON can hold")


def versions() -> dict[str, str]:
    """Return the versions of what computes."""
    return {"octoplan": version("octoplan"), "casadi": version("casadi"), "numpy": version("numpy")}
