"""A progress bar on stderr for what takes more than two seconds; none where nobody looks."""

from __future__ import annotations

import sys
import time
from typing import Any

from tqdm import tqdm  # type: ignore[import-untyped]

PATIENCE = 2.0


class Bar:
    """Hears how far a computation is, see model.progress, and shows it after two seconds.

    Nothing is written where stderr is no terminal.
    """

    def __init__(self) -> None:
        self._begin = time.monotonic()
        self._bar: Any = None

    def __call__(self, what: str, done: float, of: float) -> None:
        """Show that `done` parts `of` all of something are done."""
        if time.monotonic() - self._begin < PATIENCE:
            return
        if self._bar is None:
            self._bar = tqdm(
                file=sys.stderr,
                disable=None,
                leave=False,
                bar_format="{desc} [{elapsed}]",
            )
        self._bar.set_description_str(f"{what}: {done:g} of {of:g}" if of else what)

    def close(self) -> None:
        """Take the bar away."""
        if self._bar is not None:
            self._bar.close()
