"""Standard output, which may be full, closed, or read by nobody any more."""

from __future__ import annotations

import os
import sys

from model import OctoplanError
from planner.io.files import why


class OutputError(OctoplanError):
    """Standard output takes nothing."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(f"standard output cannot be written to: {reason}")

    def __reduce__(self) -> tuple[type, tuple[str]]:
        return type(self), (self.reason,)


def say(text: str) -> None:
    """Write to standard output; BrokenPipeError where its reader is gone, else OutputError."""
    if sys.stdout is None:
        raise OutputError("it is closed")
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except (OSError, ValueError) as reason:
        raise OutputError(why(reason)) from None


def discard() -> None:
    """Let what is left in the buffer go nowhere, so that Python does not complain at its end."""
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
