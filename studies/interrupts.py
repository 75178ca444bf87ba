"""Ctrl-C ends a study's work, not the report of what was finished."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def keep_finished() -> Iterator[None]:
    """Leave the block at Ctrl-C and go on after it, with what was finished, and say so."""
    try:
        yield
    except KeyboardInterrupt:
        print("interrupted: what follows is of what was finished", file=sys.stderr)
