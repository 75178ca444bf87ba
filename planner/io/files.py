"""Files that are there whole or not at all: staged beside where they go, then moved there."""

from __future__ import annotations

import errno
import hashlib
import os
import platform
import shutil
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import numpy as np

from model.errors import FileError, InputError

# Folders in which files are staged, beside where they go, are named after machine and process:
# what a killed process leaves there is known by that, and after a day by its age.
_MARK = ".octoplan.part"
_DAY = 86400.0
# Those of this process, and whether what they are in was made for them.
_staging: dict[Path, bool] = {}
# What this process has written last, and that in words, for whoever ends it.
_kept: deque[tuple[Path, str]] = deque(maxlen=9)


@contextmanager
def staged(folder: Path, make: bool = False) -> Iterator[Path]:
    """Yield a new folder inside a folder, which is gone afterwards, and so are orphans of it.

    The folder itself is made if wanted, and removed where nothing came into it.
    """
    is_made = make and not folder.exists()
    if make:
        folder.mkdir(parents=True, exist_ok=True)
    _remove_orphans(folder)
    prefix = f"{_MARK}.{_machine()}.{os.getpid()}."
    here = Path()
    try:
        with TemporaryDirectory(prefix=prefix, dir=folder, ignore_cleanup_errors=True) as name:
            here = Path(name)
            _staging[here] = is_made
            yield here
    finally:
        _staging.pop(here, None)
        if is_made:
            _remove_empty(folder)


def _remove_empty(folder: Path) -> None:
    with suppress(OSError, ValueError):
        folder.rmdir()


@contextmanager
def placed(path: Path) -> Iterator[Path]:
    """Yield a path to write a file to, which is moved to `path` once it is there whole."""
    with staged(path.parent) as folder:
        part = folder / f"part{path.suffix}"
        yield part
        part.replace(path)
        keep(path, f"{path} is written")


def keep(path: Path, text: str) -> None:
    """Say what stays where it is should the process be ended while a path is there."""
    if (path, text) not in _kept:
        _kept.append((path, text))


def end() -> str:
    """Remove what is not whole, as the process ends at once; return what is kept, in words."""
    for here, is_made in tuple(_staging.items()):
        shutil.rmtree(here, ignore_errors=True)
        if is_made:
            _remove_empty(here.parent)
    return "; ".join(text for path, text in _kept if path.exists()) or "nothing was written"


def _remove_orphans(folder: Path) -> None:
    """Remove what processes that were killed have staged in a folder."""
    for other in folder.glob(f"{_MARK}.*"):
        machine, _, process = other.name.removeprefix(f"{_MARK}.").partition(".")
        with suppress(OSError):
            old = time.time() - other.stat().st_mtime > _DAY
            if old or (machine == _machine() and _is_over(other, process.partition(".")[0])):
                shutil.rmtree(other, ignore_errors=True)


def _is_over(folder: Path, process: str) -> bool:
    """Return whether a process of this machine that staged in a folder is there no more."""
    if process == str(os.getpid()):
        return folder not in _staging
    if os.name != "posix" or not process.isdigit():
        return False
    try:
        os.kill(int(process), 0)
    except (ProcessLookupError, OverflowError):
        return True
    except PermissionError:
        return False
    return False


def _machine() -> str:
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it is there whole or not at all."""
    with placed(path) as part:
        part.write_bytes(content)


def write_together(folder: Path, contents: dict[str, bytes]) -> None:
    """Write files into a folder, which is made if need be: all of them, or on an error none.

    They are staged in a folder inside it first, so that a full disk spoils nothing; a folder in the
    place of one of them is refused before. Raises FileError.
    """
    try:
        with staged(folder, make=True) as here:
            for name, content in contents.items():
                if (folder / name).is_dir():
                    raise IsADirectoryError(errno.EISDIR, f"{name} in it is a folder")
                (here / name).write_bytes(content)
            for name in contents:
                (here / name).replace(folder / name)
            keep(folder, f"{', '.join(contents)} in {folder} are written")
    except (OSError, ValueError) as reason:
        text = f"no file was written in this folder: {why(reason)}"
        raise FileError(str(folder), "", text) from None


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


def why(reason: OSError | ValueError) -> str:
    """Return why a file cannot be read or written, in the system's words."""
    text = reason.strerror if isinstance(reason, OSError) else None
    return (text or str(reason)).lower()


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
