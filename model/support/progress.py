"""Long work: how far it is, and how long it may go on.

Loops that take long report (`tell`) and look whether their time is over (`check_time`). A public
function that is called by a user shows a line, on a terminal or in a notebook, once it takes more
than `DELAY` seconds (`with_progress`); what such functions call inside of each other reports to
that one line. All reports go to the log too, logger `octoplan.model.support.progress`, level INFO.
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

from octoplan.model.support.checks import positive
from octoplan.model.support.errors import InputError, TimeLimitError, UnsettledContactError

P = ParamSpec("P")
T = TypeVar("T")

_log = logging.getLogger(__name__)
_line: ContextVar[ProgressLine | None] = ContextVar("line", default=None)
# After how many seconds a line is shown, and how often the time that has passed is written anew.
DELAY, _EVERY = 2.0, 0.5
# How long what leads to no progress may take, in processor time [s].
PATIENCE = 20.0
# How long after a time limit what was found by then may be verified [s].
GRACE = 1.0
# What reaching the time limit leaves undone, in the words of certificates.
OUT_OF_TIME = "the time limit was reached before it was verified"
_end: ContextVar[float] = ContextVar("end", default=math.inf)
# The end of the innermost time limit without what `reserve` keeps; None if nothing may be kept.
_full_end: ContextVar[float | None] = ContextVar("full_end", default=None)
_ended: ContextVar[Callable[[], bool] | None] = ContextVar("ended", default=None)


def with_progress(function: Callable[P, T]) -> Callable[P, T]:
    """Let a function show how far it is, as its keyword argument `progress` says.

    None: on terminals and in notebooks, once it takes more than two seconds; True: anywhere, from
    the beginning; False: never. Inside of a call that shows a line already, that one goes on.
    """

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        progress = kwargs.get("progress")
        if progress is None and _line.get() is not None:
            return function(*args, **kwargs)
        with ProgressLine(progress):
            return function(*args, **kwargs)

    return call


def tell(what: str, done: float = 0, of: float = 0) -> None:
    """Say that `done` parts `of` all are done, of something that takes long; of 0: not known."""
    text = f"{what}: {done:g} of {of:g}" if of else what
    _log.info(text)
    if (line := _line.get()) is not None:
        line.show(text)


def reported(what: str, items: Sequence[T]) -> Iterator[T]:
    """Yield items and tell how many are done; what is told for the sake of one is not heard."""
    for i, item in enumerate(items):
        tell(what, i, len(items))
        with ProgressLine(False):
            yield item


@dataclass(eq=False)
class ProgressLine:
    """Show how far things are inside a `with` block; see with_progress. Raises InputError.

    A line of tqdm's on stderr, in notebooks on stdout: the phase and the time that has passed. A
    thread, which the first report starts, writes it, also while a phase reports nothing more.
    """

    progress: Any = None
    begin: float = field(default_factory=time.monotonic)
    text: str = ""
    clock: threading.Thread | None = None
    closed: threading.Event = field(init=False)
    token: Token[ProgressLine | None] = field(init=False)

    def __enter__(self) -> None:
        if not (self.progress is None or isinstance(self.progress, bool)):
            allowed = "None (after 2 s, on terminals and in notebooks), True or False"
            raise InputError("progress", self.progress, allowed)
        self.token = _line.set(self)

    def __exit__(self, *_: object) -> None:
        _line.reset(self.token)
        if self.clock is not None:
            self.closed.set()
            self.clock.join()

    def show(self, text: str) -> None:
        """Let the line tell a phase, where someone looks."""
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

        # Of a terminal that does not tell its size tqdm would write nothing.
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
    """Return where someone may look: a terminal's stderr, or in a notebook stdout; None: nowhere.

    In a notebook stderr would leave a red bar where the line was.
    """
    notebook: Any = sys.modules.get("IPython")
    shell: Any = notebook.get_ipython() if hasattr(notebook, "get_ipython") else None
    if shell is not None and "IPKernelApp" in shell.config:
        return sys.stdout
    return sys.stderr if sys.stderr is not None and sys.stderr.isatty() else None


class OutOfTime(Exception):  # noqa: N818  (a signal between loops, not an error that users see)
    """The time limit is reached; whoever set it takes what there is so far."""


@contextmanager
def time_limit(seconds: float | None, reserves: bool = False) -> Iterator[None]:
    """Let what is inside go on for so long, no longer than limits further out; None is no limit.

    If it `reserves`, calls of `reserve` inside end it early.
    """
    limit = math.inf if seconds is None else time.monotonic() + seconds
    limit = min(limit, _end.get())
    token, full_token = _end.set(limit), _full_end.set(limit if reserves else None)
    try:
        yield
    finally:
        _full_end.reset(full_token)
        _end.reset(token)


@contextmanager
def limited(seconds: Any, reserves: bool = False) -> Iterator[None]:
    """As time_limit, for what has nothing to show before its end: raises TimeLimitError.

    And InputError for what is no time.
    """
    limit = None if seconds is None else positive("time_limit", seconds)
    with time_limit(limit, reserves):
        try:
            yield
        except OutOfTime:
            if limit is None:
                raise
            raise TimeLimitError(limit) from None


def shorten(seconds: float) -> None:
    """Let what goes on inside of the innermost time_limit go on for no longer than that."""
    _end.set(min(_end.get(), time.monotonic() + seconds))


def reserve(seconds: float) -> None:
    """End the innermost time_limit so many seconds early, if it reserves time.

    For what follows it under the same limit. Replaces the reserve before.
    """
    if (full := _full_end.get()) is not None:
        _end.set(full - seconds)


def seconds_left() -> float:
    """Return the time until the innermost time_limit ends [s]; infinite without one."""
    return _end.get() - time.monotonic()


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
