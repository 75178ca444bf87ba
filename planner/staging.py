"""Where files are written before they take their places, so that none is ever there in part."""

from __future__ import annotations

import hashlib
import os
import platform
import secrets
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

# Folders in which files are staged, beside where they go, are named after machine and process:
# what a killed process leaves there is known by that, and after a day by its age.
_MARK = ".octoplan.part"
_DAY = 86400.0
_staging: set[Path] = set()
# Folders that take finished parts of long work, as files that are there whole or not at all.
_folders: set[Path] = set()
# What a command has finished writing, in words, for whoever interrupts it; None outside of one.
_kept: list[str] | None = None


@contextmanager
def staged(folder: Path) -> Iterator[Path]:
    """Yield a new folder inside a folder, which is gone afterwards, and so are orphans of it."""
    _remove_orphans(folder)
    here = folder / f"{_MARK}.{_machine()}.{os.getpid()}.{secrets.token_hex(4)}"
    _staging.add(here)
    try:
        here.mkdir()
        yield here
    finally:
        shutil.rmtree(here, ignore_errors=True)
        _staging.discard(here)


@contextmanager
def placed(path: Path) -> Iterator[Path]:
    """Yield a path to write a file to, which is moved to `path` once it is there whole."""
    with staged(path.parent) as folder:
        part = folder / f"part{path.suffix}"
        yield part
        part.replace(path)
        keep(f"{path} is written")


@contextmanager
def remembered() -> Iterator[None]:
    """Remember, inside the block, what is kept of the work in it."""
    global _kept
    _kept = []
    try:
        yield
    finally:
        _kept = None
        _folders.clear()


def keep(what: str) -> None:
    """Say what stays where it is should the work be interrupted from now on."""
    if _kept is not None:
        _kept.append(what)


def told_kept() -> str:
    """Return what is kept of a command's work, in words."""
    told = [
        f"what is finished is kept in {folder}: the same command goes on from there"
        for folder in _folders
        if any(folder.glob("*.npz"))
    ]
    return "; ".join([*told, *(_kept or ())]) or "nothing was written"


def keep_folder(folder: Path) -> None:
    """Say that a folder takes finished parts, should the work be interrupted from now on."""
    if _kept is not None:
        _folders.add(folder)


def abandon() -> None:
    """Remove what this process has staged, and parts that are not whole, before it ends at once."""
    for folder in tuple(_staging):
        shutil.rmtree(folder, ignore_errors=True)
    for folder in tuple(_folders):
        for part in folder.glob("*.part"):
            part.unlink(missing_ok=True)
        with suppress(OSError):
            folder.rmdir()


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
