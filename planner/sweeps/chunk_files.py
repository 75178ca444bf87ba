"""Chunks of a sweep as files in a folder beside its output: each is there whole or not at all.

A file's name holds the sweep's identity and the chunk's number; which files are there is all that
is known of an earlier run.
"""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError, OctoplanError
from planner.io.files import keep_folder, why
from planner.sweeps.definition import Sweep
from planner.sweeps.variables import Rows


class FullDiskError(OctoplanError):
    """What a sweep has computed cannot be written.

    Attributes
    ----------
    path : str
        What could not be written.
    reason : str
        Why, in the system's words.
    """

    def __init__(self, path: str, reason: str) -> None:
        self.path, self.reason = path, reason
        super().__init__(
            f"{path} cannot be written: {reason}; what is finished is kept: start the sweep again "
            "once it can, and it goes on"
        )

    def __reduce__(self) -> tuple[type, tuple[str, str]]:
        return type(self), (self.path, self.reason)


def folder_of(out: Path) -> Path:
    """Return the folder of the chunks of a sweep that is to be written to a path."""
    return out.with_name(f"{out.name}.chunks")


@dataclass(frozen=True)
class ChunkFiles:
    """The chunks of a sweep that are finished, as files.

    Attributes
    ----------
    folder : Path
        Made with the first of them.
    sweep : Sweep
    """

    folder: Path
    sweep: Sweep

    def __post_init__(self) -> None:
        """Raise InputError where the folder is another sweep's."""
        there = self.folder.glob("*.npz")
        if not all(path.name.startswith(self._prefix) for path in there):
            allowed = (
                "chunks of this same sweep: these are of another, or of another version; "
                "name another output, or remove it"
            )
            raise InputError("out", str(self.folder), allowed)
        keep_folder(self.folder)

    @property
    def left(self) -> list[int]:
        """The chunks that are not finished."""
        there = {path.name for path in self.folder.glob("*.npz")}
        return [i for i in range(self.sweep.chunks) if self._path(i).name not in there]

    def write(self, chunk: int, rows: Rows) -> None:
        """Keep a chunk; it is on the disk when this returns. Raises FullDiskError."""
        path = self._path(chunk)
        part = path.with_suffix(f".{os.getpid()}.part")
        try:
            self.folder.mkdir(exist_ok=True)
            with part.open("wb") as stream:
                np.savez(stream, allow_pickle=False, **rows)
                stream.flush()
                os.fsync(stream.fileno())
            part.replace(path)
        except OSError as reason:
            with suppress(OSError):
                part.unlink(missing_ok=True)
                self.folder.rmdir()  # where nothing was kept
            raise FullDiskError(str(path), why(reason)) from None

    def read(self, chunk: int, name: str) -> NDArray[Any]:
        """Return a variable of a chunk that is finished; InputError where its file was spoilt."""
        path = self._path(chunk)
        try:
            with np.load(path, allow_pickle=False) as stored:
                return np.asarray(stored[name])
        except (OSError, ValueError, KeyError, EOFError, BadZipFile):
            allowed = "a chunk as it was written: remove it, start again, and it is computed anew"
            raise InputError("out", str(path), allowed) from None

    def remove(self) -> None:
        """Remove all chunks, whose sweep is written."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _path(self, chunk: int) -> Path:
        return self.folder / f"{self._prefix}{chunk:06d}.npz"

    @property
    def _prefix(self) -> str:
        return f"{self.sweep.identity[:16]}-"


class ChunksInMemory(dict[int, Rows]):
    """The chunks of a sweep that is not written."""

    write = dict.__setitem__

    def read(self, chunk: int, name: str) -> NDArray[Any]:
        """Return a variable of a chunk."""
        return self[chunk][name]
