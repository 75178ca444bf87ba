"""Progress reports and time limits of long computations.

Long loops report their progress (`report`) and check the time limit (`check_time`). A public
function decorated with `with_progress` shows a progress line, on a terminal or in a notebook, after
`DELAY` seconds; functions called inside it report to the same line. All reports are also logged:
logger `octoplan.model.support.progress`, level INFO.
"""

from __future__ import annotations

import logging
import math
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar, Token
from dataclasses import dataclass, field
from functools import wraps
from shutil import get_terminal_size
from typing import Any, ParamSpec, TextIO, TypeVar

import numpy as np

from octoplan.model.support.checks import positive
from octoplan.model.support.errors import InputError, TimeLimitError, UnsettledContactError

P = ParamSpec("P")
T = TypeVar("T")

_log = logging.getLogger(__name__)
_line: ContextVar[ProgressLine | None] = ContextVar("line", default=None)
# Time before the progress line is shown [s].
DELAY = 2.0
# Interval at which the elapsed time is refreshed [s].
_EVERY = 0.5
# Processor time allowed for one equilibrium with contact [s].
PATIENCE = 20.0
# Time for the certificate of a result after the time limit [s].
GRACE = 1.0
# Entry of a certificate for a check that the time limit cut off.
OUT_OF_TIME = "the time limit was reached before it was verified"
_end: ContextVar[float] = ContextVar("end", default=math.inf)
# End of the innermost time limit before `reserve` shortens it; None if no time can be reserved.
_full_end: ContextVar[float | None] = ContextVar("full_end", default=None)
_ended: ContextVar[Callable[[], bool] | None] = ContextVar("ended", default=None)


def with_progress(function: Callable[P, T]) -> Callable[P, T]:
    """Show a progress line while a function runs; its keyword argument `progress` selects when.

    With None, show the line on terminals and in notebooks, after two seconds; with True, always and
    at once; with False, never. With None, a call inside a decorated call uses the line of the outer
    call.
    """

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        progress = kwargs.get("progress")
        if progress is None and _line.get() is not None:
            return function(*args, **kwargs)
        with ProgressLine(progress):
            return function(*args, **kwargs)

    return call


def report(phase: str, done: float = 0, total: float = 0) -> None:
    """Report that `done` of `total` parts of a phase are complete; total 0: unknown."""
    text = f"{phase}: {done:g} of {total:g}" if total else phase
    _log.info(text)
    if (line := _line.get()) is not None:
        line.show(text)


def track(phase: str, items: Sequence[T]) -> Iterator[T]:
    """Yield items and report the number done; reports made while an item is used are not shown."""
    for i, item in enumerate(items):
        report(phase, i, len(items))
        with ProgressLine(False):
            yield item


@dataclass(eq=False)
class ProgressLine:
    """Show the progress of a `with` block; see with_progress. Raises InputError.

    The line shows the phase and the elapsed time, by tqdm, on stderr or in notebooks on stdout. A
    thread, started by the first report, refreshes the line between reports.
    """

    progress: Any = None
    begin: float = field(default_factory=time.monotonic)
    text: str = ""
    clock: threading.Thread | None = None
    closed: threading.Event = field(init=False)
    token: Token[ProgressLine | None] = field(init=False)

    def __enter__(self) -> None:
        if not (self.progress is None or isinstance(self.progress, bool | np.bool_)):
            allowed = "None (after 2 s, on terminals and in notebooks), True or False"
            raise InputError("progress", self.progress, allowed)
        self.token = _line.set(self)

    def __exit__(self, *_: object) -> None:
        _line.reset(self.token)
        if self.clock is not None:
            self.closed.set()
            self.clock.join()

    def show(self, text: str) -> None:
        """Show a phase in the line if output is enabled."""
        self.text = text
        if self.clock is None and (_output_stream() if self.progress is None else self.progress):
            self.closed = threading.Event()
            self.clock = threading.Thread(target=self._write, daemon=True)
            self.clock.start()

    def _write(self) -> None:
        delay = 0.0 if self.progress else self.begin + DELAY - time.monotonic()
        if self.closed.wait(max(delay, 0.0)):
            return
        from tqdm import tqdm  # type: ignore[import-untyped]

        # tqdm writes nothing to a terminal of unknown size; pass a size explicitly.
        size = get_terminal_size()
        room = {"ncols": size.columns - 1, "nrows": size.lines}
        with tqdm(
            file=_output_stream() or sys.stderr, leave=False, bar_format="{desc}", **room
        ) as line:
            while True:
                minutes, seconds = divmod(int(time.monotonic() - self.begin), 60)
                line.set_description_str(f"{self.text} [{minutes:02d}:{seconds:02d}]")
                if self.closed.wait(_EVERY):
                    return


def _output_stream() -> TextIO | None:
    """Return stderr of a terminal, stdout of a notebook, or None for other outputs.

    Output to stderr leaves a red bar in a notebook.
    """
    notebook: Any = sys.modules.get("IPython")
    shell: Any = notebook.get_ipython() if hasattr(notebook, "get_ipython") else None
    if shell is not None and "IPKernelApp" in shell.config:
        return sys.stdout
    return sys.stderr if sys.stderr is not None and sys.stderr.isatty() else None


class OutOfTime(Exception):  # noqa: N818  (a signal between loops, not an error that users see)
    """The time limit is reached; the caller that set the limit returns the best result so far."""


@contextmanager
def time_limit(seconds: float | None, reserves: bool = False) -> Iterator[None]:
    """Limit the time of a `with` block, within outer limits; None is no limit.

    If `reserves` is set, calls of `reserve` inside the block shorten this limit.
    """
    limit = math.inf if seconds is None else time.monotonic() + seconds
    limit = min(limit, _end.get())
    token = _end.set(limit)
    full_token = _full_end.set(limit if reserves else None)
    try:
        yield
    finally:
        _full_end.reset(full_token)
        _end.reset(token)


@contextmanager
def limited(seconds: Any, reserves: bool = False) -> Iterator[None]:
    """Limit the time of a block that has no partial result; see time_limit.

    Raises TimeLimitError if the limit is reached, InputError if `seconds` is not positive.
    """
    limit = None if seconds is None else positive("time_limit", seconds)
    with time_limit(limit, reserves):
        try:
            yield
        except OutOfTime:
            if limit is None:
                raise
            raise TimeLimitError(limit) from None


def tighten_limit(seconds: float) -> None:
    """Shorten the innermost time_limit to at most this time from now."""
    _end.set(min(_end.get(), time.monotonic() + seconds))


def reserve(seconds: float) -> None:
    """End the innermost time_limit early by this time [s], if the limit was set with `reserves`.

    The reserved time is for computations after the block. Each call replaces the last reserve.
    """
    if (full := _full_end.get()) is not None:
        _end.set(full - seconds)


def seconds_left() -> float:
    """Return the time until the innermost time_limit ends [s]; infinite without one."""
    return _end.get() - time.monotonic()


def end() -> float:
    """Return the `time.monotonic` time of the limit, shared by all processes; inf without limit."""
    return _end.get()


@contextmanager
def cancel_when(cancelled: Callable[[], bool]) -> Iterator[None]:
    """Raise OutOfTime inside the block once `cancelled()` is True; check_time calls it often."""
    outer = _ended.get()
    token = _ended.set(lambda: cancelled() or (outer is not None and outer()))
    try:
        yield
    finally:
        _ended.reset(token)


def check_time() -> None:
    """Raise OutOfTime if the time limit is reached or the computation is cancelled."""
    end = _end.get()
    ended = _ended.get()
    if (end < math.inf and time.monotonic() > end) or (ended is not None and ended()):
        raise OutOfTime


@contextmanager
def timeout(factor: float = 1.0) -> Iterator[None]:
    """Raise UnsettledContactError if a block takes longer than PATIENCE, in processor time."""
    end = time.process_time() + PATIENCE
    try:
        with cancel_when(lambda: time.process_time() > end):
            yield
    except OutOfTime:
        check_time()
        raise UnsettledContactError(factor, f"none is found within {PATIENCE:g} s") from None
