"""How long a computation may go on: a time that its long loops look at."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from model.checks import positive
from model.errors import TimeLimitError, UnsettledContactError

# How long what leads to no progress may take, in processor time [s].
PATIENCE = 20.0
_end: ContextVar[float] = ContextVar("end", default=math.inf)
_ended: ContextVar[Callable[[], bool] | None] = ContextVar("ended", default=None)


class OutOfTime(Exception):  # noqa: N818  (a signal between loops, not an error that users see)
    """The time limit is reached; whoever set it takes what there is so far."""


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Let what is inside go on for so long, no longer than limits further out; None is no limit."""
    limit = math.inf if seconds is None else time.monotonic() + seconds
    token = _end.set(min(limit, _end.get()))
    try:
        yield
    finally:
        _end.reset(token)


@contextmanager
def limited(seconds: Any) -> Iterator[None]:
    """As time_limit, for what has nothing to show before its end: raises TimeLimitError.

    And InputError for what is no time.
    """
    limit = None if seconds is None else positive("time_limit", seconds)
    with time_limit(limit):
        try:
            yield
        except OutOfTime:
            if limit is None:
                raise
            raise TimeLimitError(limit) from None


def shorten(seconds: float) -> None:
    """Let what goes on inside of the innermost time_limit go on for no longer than that."""
    _end.set(min(_end.get(), time.monotonic() + seconds))


def end() -> float:
    """Return the time of `time.monotonic`, of all processes, when it is reached; inf for never."""
    return _end.get()


@contextmanager
def unless(ended: Callable[[], bool]) -> Iterator[None]:
    """Let what is inside go on until that returns True, asked often, as if its time were over."""
    outer = _ended.get()
    token = _ended.set(lambda: ended() or (outer is not None and outer()))
    try:
        yield
    finally:
        _ended.reset(token)


def check_time() -> None:
    """Raise OutOfTime once the time limit is reached, or what goes on is to end."""
    end, ended = _end.get(), _ended.get()
    if (end < math.inf and time.monotonic() > end) or (ended is not None and ended()):
        raise OutOfTime


@contextmanager
def before_long(factor: float = 1.0) -> Iterator[None]:
    """Let an equilibrium with contact, at a load factor, be found before long, or not at all."""
    end = time.process_time() + PATIENCE
    try:
        with unless(lambda: time.process_time() > end):
            yield
    except OutOfTime:
        check_time()
        raise UnsettledContactError(factor, f"none is found within {PATIENCE:g} s") from None
