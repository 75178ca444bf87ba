"""What solvers write to the standard streams: kept from the terminal, and logged."""

from __future__ import annotations

import io
import logging
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_CHANGING = threading.Lock()
# What each thread keeps from a stream, by the stream's name; the innermost block's comes last.
_kept = threading.local()
_depth = {"stdout": 0, "stderr": 0}


class _Split:
    """A standard stream, but for what threads inside of `logged` write."""

    def __init__(self, name: str, before: Any) -> None:
        self.name, self.before = name, before

    def write(self, text: str) -> int:
        """Write to what this thread keeps, or to the stream."""
        kept = vars(_kept).get(self.name)
        return int((kept[-1] if kept else self.before).write(text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.before, name)


@contextmanager
def logged(log: logging.Logger, stdout: bool = False) -> Iterator[None]:
    """Keep stderr, and stdout if wanted, from the terminal; what was said is logged at DEBUG.

    What other threads write goes where it went.
    """
    said, names = io.StringIO(), ("stderr", "stdout")[: 1 + stdout]
    kept = [vars(_kept).setdefault(name, []) for name in names]
    with _CHANGING:
        for name, each in zip(names, kept, strict=True):
            if not _depth[name]:
                setattr(sys, name, _Split(name, getattr(sys, name)))
            _depth[name] += 1
            each.append(said)
    try:
        yield
    finally:
        with _CHANGING:
            for name, each in zip(names, kept, strict=True):
                each.pop()
                _depth[name] -= 1
                stream = getattr(sys, name)
                if not _depth[name] and isinstance(stream, _Split):
                    setattr(sys, name, stream.before)
        if said.getvalue():
            log.debug(said.getvalue().strip())
