"""How a command is ended from outside: Ctrl-C and SIGTERM."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from planner.commands.answer import INTERRUPTED, TERMINATED
from planner.io.files import abandon, remembered, told_kept

_CODES = {signal.SIGINT: INTERRUPTED, signal.SIGTERM: TERMINATED}
SAID = {INTERRUPTED: "interrupted", TERMINATED: "terminated"}


@contextmanager
def ended_from_outside() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM end the program from inside the block, at once.

    A KeyboardInterrupt would not: CasADi makes a warning of it in the middle of ipopt, which goes
    on. What is being written is staged beside where it goes; that is removed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heard = [number for number in _CODES if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, _end) for number in heard}
    try:
        with remembered():
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _end(number: int, _: Any) -> None:
    code, kept = _CODES[signal.Signals(number)], told_kept()
    abandon()
    with suppress(OSError):
        os.write(2, f"octoplan: {SAID[code]}; {kept}\n".encode())
    os._exit(code)
