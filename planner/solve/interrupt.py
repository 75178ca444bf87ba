"""Ctrl-C and time limits inside of ipopt, which takes exceptions for failed evaluations."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import casadi as ca
import numpy as np

from model.time_limit import is_out_of_time


class Watch(ca.Callback):
    """Stops ipopt at the next iteration once Ctrl-C was pressed or the time limit is reached.

    Ctrl-C is for the main thread alone, as it is in Python; others go on.
    """

    def __init__(self) -> None:
        ca.Callback.__init__(self)
        self.interrupted = False
        self.construct("watch", {})

    def get_n_in(self) -> int:
        """Return how many things an iteration is made of."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Return 1: whether to stop."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Return that none of them is wanted."""
        return ca.Sparsity(0, 0)

    def has_eval_buffer(self) -> bool:
        """Return that no matrices are made for a call."""
        return True

    def eval_buffer(self, arg: Any, res: Any) -> int:
        """Say whether to stop."""
        interrupted = self.interrupted and _is_main()
        np.frombuffer(res[0])[0] = float(interrupted or is_out_of_time())
        return 0

    @contextmanager
    def held(self) -> Iterator[None]:
        """Hold Ctrl-C back until the solver has stopped, and hand it on then."""
        before = signal.getsignal(signal.SIGINT)
        if not _is_main() or not callable(before):
            yield
            return
        signal.signal(signal.SIGINT, self._interrupt)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)
        if self.interrupted:
            self.interrupted = False
            before(signal.SIGINT, None)

    def _interrupt(self, *_: Any) -> None:
        self.interrupted = True


def _is_main() -> bool:
    return threading.current_thread() is threading.main_thread()
