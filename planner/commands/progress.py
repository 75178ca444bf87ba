"""A progress line on stderr for what takes more than two seconds; none where nobody looks."""

from __future__ import annotations

import sys
import threading
import time
from shutil import get_terminal_size
from typing import Any

from tqdm import tqdm  # type: ignore[import-untyped]

DELAY = 2.0
# How often the time that has passed is written anew [s].
_EVERY = 0.5


class Bar:
    """Hears how far a computation is, see model.progress, and shows it after two seconds.

    The phase and the time that has passed, also while a phase says nothing more. Nothing is written
    where stderr is no terminal.
    """

    def __init__(self) -> None:
        self._begin, self._told = time.monotonic(), "working"
        self._bar: Any = None
        self._closed, self._lock = threading.Event(), threading.Lock()
        self._clock = threading.Thread(target=self._go_on, daemon=True)
        self._clock.start()

    def __call__(self, what: str, done: float, of: float) -> None:
        """Show that `done` parts `of` all of something are done."""
        self._told = f"{what}: {done:g} of {of:g}" if of else what
        self._show()

    def close(self) -> None:
        """Take the line away."""
        self._closed.set()
        self._clock.join()
        if self._bar is not None:
            self._bar.close()

    def _go_on(self) -> None:
        while not self._closed.wait(_EVERY):
            self._show()

    def _show(self) -> None:
        passed = time.monotonic() - self._begin
        if passed < DELAY:
            return
        with self._lock:
            if self._bar is None:
                # Of a terminal that does not tell its size tqdm would write nothing.
                size = get_terminal_size()
                self._bar = tqdm(
                    file=sys.stderr,
                    disable=None,
                    leave=False,
                    bar_format="{desc}",
                    ncols=size.columns - 1,
                    nrows=size.lines,
                )
            minutes, seconds = divmod(int(passed), 60)
            self._bar.set_description_str(f"{self._told} [{minutes:02d}:{seconds:02d}]")
