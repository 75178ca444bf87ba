"""Files that are there whole or not at all."""

from __future__ import annotations

import errno
import os
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from model.errors import InputError


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it is there whole or not at all."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        Path(name).chmod(0o644)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def write_together(folder: Path, contents: dict[str, bytes]) -> None:
    """Write files into a folder, which is made if need be: all of them, or on an error none.

    They are staged in a folder inside it first, so that a full disk spoils nothing.
    """
    new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=".new.") as staged:
            for name, content in contents.items():
                (Path(staged) / name).write_bytes(content)
            for name in contents:
                if (folder / name).is_dir():
                    raise IsADirectoryError(errno.EISDIR, f"{name} in it is a folder")
            for name in contents:
                (Path(staged) / name).replace(folder / name)
    except BaseException:
        if new:
            folder.rmdir()
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
    except OSError as reason:
        allowed = f"a file that can be written: {(reason.strerror or str(reason)).lower()}"
        raise InputError("path", str(path), allowed) from None
    return path


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
