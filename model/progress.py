"""How far a long computation is, for whoever listens; nobody does unless asked to."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

Listener = Callable[[str, float, float], None]
T = TypeVar("T")

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def listening(listener: Listener | None) -> Iterator[None]:
    """Let a listener hear what is told inside the block; None hears nothing."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def tell(what: str, done: float = 0, of: float = 0) -> None:
    """Say that `done` parts `of` all are done, of something that takes long; of 0: not known."""
    listener = _listener.get()
    if listener is not None:
        listener(what, done, of)


def told(what: str, items: Sequence[T]) -> Iterator[T]:
    """Yield items and tell how many are done; what is told for the sake of one is not heard."""
    listener = _listener.get()
    with listening(None):
        for i, item in enumerate(items):
            if listener is not None:
                listener(what, i, len(items))
            yield item
