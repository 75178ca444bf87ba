"""The journal of a sweep: what is finished, line by line, so that a killed sweep goes on.

Each line is JSON with a checksum of its body. A line that a kill has torn, or a disk has spoilt,
is as if it were not there: its points are found again.
"""

from __future__ import annotations

import os
import zlib
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec
import numpy as np

from model.errors import InputError
from planner.staging import begun, keep
from planner.sweeps.variables import Rows

_NAME = "octoplan sweep journal 1"


class _Head(msgspec.Struct, forbid_unknown_fields=True):
    """The first line's body: whose journal this is."""

    journal: str
    identity: str


class _Done(msgspec.Struct, forbid_unknown_fields=True):
    """A further line's body: a chunk, its arrays as little-endian doubles, its outcomes."""

    chunk: int
    values: dict[str, bytes]
    outcomes: list[str]


class _Line(msgspec.Struct):
    crc: int
    body: msgspec.Raw


class Journal:
    """The journal of a sweep, open to be written on; what an earlier run has left is kept.

    Parameters
    ----------
    path : Path
        Made if it is not there.
    identity : str
        Of the sweep.
    chunks : int
        How many chunks the sweep has.
    like : Rows
        Rows of the sweep, if need be none: arrays get their shape, but for the first size.

    Attributes
    ----------
    places : (chunks,)
        Where the line of each chunk begins in the file; -1 where it is not finished.

    Raises
    ------
    InputError
        If the journal is another sweep's, or cannot be written.
    """

    def __init__(self, path: Path, identity: str, chunks: int, like: Rows) -> None:
        self.path, self._like, self._is_told = path, like, False
        self.places = np.full(chunks, -1)
        if not path.exists():
            begun(path)
        try:
            self._stream = path.open("a+b", buffering=0)
        except OSError as reason:
            raise _refused(path, reason) from None
        try:
            self._begin(identity)
            self._look()
        except BaseException:
            self._stream.close()
            raise

    def _begin(self, identity: str) -> None:
        """Check the head, or write it; end a last line that was torn."""
        first = _line(_Head(_NAME, identity))
        self._stream.seek(0)
        head = _body(self._stream.readline(), _Head)
        size = self._stream.seek(0, os.SEEK_END)
        if head is not None and (head.journal, head.identity) != (_NAME, identity):
            allowed = (
                "the journal of this same sweep: this one is of another, or of another version; "
                "name another output, or remove it"
            )
            raise InputError("journal", str(self.path), allowed)
        if head is None and size:
            self._stream.truncate(0)
            size = 0
        self._empty = len(first)
        if size:
            self._stream.seek(size - 1)
            if self._stream.read(1) != b"\n":
                self._write(b"\n")
        else:
            self._write(first)

    def _look(self) -> None:
        """Find the chunks that are finished."""
        begin = 0
        with self.path.open("rb") as stream:
            for line in stream:
                found = _body(line, _Done)
                if found is not None and found.chunk < self.places.size:
                    self.places[found.chunk] = begin
                begin += len(line)
        if np.any(self.places >= 0):
            self._tell_kept()

    def _tell_kept(self) -> None:
        if not self._is_told:
            self._is_told = True
            keep(f"what is finished is kept in {self.path}: the same command goes on from there")

    @property
    def left(self) -> list[int]:
        """The chunks that are not finished."""
        return list(np.flatnonzero(self.places < 0).tolist())

    def read(self, chunk: int) -> Rows:
        """Return a chunk that is finished."""
        with self.path.open("rb") as stream:
            stream.seek(int(self.places[chunk]))
            found = _body(stream.readline(), _Done)
        if found is None:
            raise InputError("journal", str(self.path), "what was written to it: it was changed")
        return _rows(found, self._like)

    def add(self, chunk: int, rows: Rows) -> None:
        """Write that a chunk is finished; it is on the disk when this returns."""
        values = {name: own.astype("<f8").tobytes() for name, own in rows.values.items()}
        begin = self._stream.seek(0, os.SEEK_END)
        self._write(_line(_Done(chunk, values, rows.outcomes)))
        self.places[chunk] = begin
        self._tell_kept()

    def remove(self) -> None:
        """Remove the journal, whose sweep is written."""
        self.path.unlink(missing_ok=True)

    def _write(self, line: bytes) -> None:
        try:
            left = memoryview(line)
            while left:
                left = left[self._stream.write(left) :]
            os.fsync(self._stream.fileno())
        except OSError as reason:
            raise _refused(self.path, reason) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the journal; one in which nothing is finished is of no use."""
        self._stream.close()
        with suppress(FileNotFoundError):
            if self.path.stat().st_size == self._empty:
                self.path.unlink()


def _refused(path: Path, reason: OSError) -> InputError:
    told = (reason.strerror or str(reason)).lower()
    return InputError("journal", str(path), f"a file that can be written: {told}")


def _line(body: Any) -> bytes:
    text = msgspec.json.encode(body)
    return msgspec.json.encode(_Line(zlib.crc32(text), msgspec.Raw(text))) + b"\n"


def _body(line: bytes, kind: Any) -> Any:
    """Return the body of a line; None where it is torn or of another kind."""
    try:
        found = msgspec.json.decode(line, type=_Line)
        return msgspec.json.decode(found.body, type=kind) if _holds(found) else None
    except msgspec.DecodeError:
        return None


def _holds(line: _Line) -> bool:
    return zlib.crc32(bytes(line.body)) == line.crc


def _rows(found: _Done, like: Rows) -> Rows:
    shapes = {name: own.shape[1:] for name, own in like.values.items()}
    values = {
        name: np.frombuffer(found.values[name], "<f8").reshape(-1, *shape)
        for name, shape in shapes.items()
    }
    return Rows(values, found.outcomes)
