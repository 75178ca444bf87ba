"""What CasADi and its solvers write to the standard streams goes to a log instead."""

from __future__ import annotations

import io
import logging
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
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
    said = io.StringIO()
    try:
        with ExitStack() as held:
            for name in ("stderr", "stdout")[: 1 + stdout]:
                held.enter_context(_apart(name, said))
            yield
    finally:
        if said.getvalue():
            log.debug(said.getvalue().strip())


@contextmanager
def _apart(name: str, said: io.StringIO) -> Iterator[None]:
    """Let this thread write to `said` in place of a standard stream."""
    with _CHANGING:
        if not _depth[name]:
            setattr(sys, name, _Split(name, getattr(sys, name)))
        _depth[name] += 1
    kept = vars(_kept).setdefault(name, [])
    kept.append(said)
    try:
        yield
    finally:
        kept.pop()
        with _CHANGING:
            _depth[name] -= 1
            stream = getattr(sys, name)
            if not _depth[name] and isinstance(stream, _Split):
                setattr(sys, name, stream.before)
