"""Interruption and logging of a solver that runs in compiled code.

CasADi's solvers regard exceptions in Python as failed evaluations. A callback therefore stops the
solver at the next iteration after Ctrl-C or at a time limit. The solver writes to the standard
output, which goes to the logger at level DEBUG.
"""

from __future__ import annotations

import io
import logging
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from typing import Any

import casadi as ca

from octoplan.model.support.progress import OutOfTime, check_time

LOG = logging.getLogger("octoplan.planner.solve.ipopt")
# Held by the thread whose solver writes to the standard output, which all threads share.
_OUTPUT_LOCK = threading.RLock()


class Watch(ca.Callback):
    """Stops the solver at the next iteration after Ctrl-C, or when the time limit is reached.

    Ctrl-C stops the main thread alone, as in Python.
    """

    def __init__(self) -> None:
        ca.Callback.__init__(self)
        self.interrupted = False
        self.construct("watch", {})

    def get_n_in(self) -> int:
        """Return the number of quantities of an iterate."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Return 1: whether to stop."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Return an empty pattern: the iterate is not used."""
        return ca.Sparsity(0, 0)

    def eval(self, arg: Any) -> list[ca.DM]:
        """Return whether to stop."""
        with suppress(OutOfTime):
            check_time()
            return [ca.DM(self.interrupted and _is_main())]
        return [ca.DM(1)]

    @contextmanager
    def defer_interrupt(self) -> Iterator[None]:
        """Defer Ctrl-C until the solver has stopped."""
        previous = signal.getsignal(signal.SIGINT)
        if not _is_main() or not callable(previous):
            yield
            return
        signal.signal(signal.SIGINT, self._interrupt)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, previous)
        if self.interrupted:
            self.interrupted = False
            previous(signal.SIGINT, None)

    def _interrupt(self, *_: Any) -> None:
        self.interrupted = True


def _is_main() -> bool:
    return threading.current_thread() is threading.main_thread()


# The callback of all solvers.
WATCH = Watch()


@contextmanager
def logged_output() -> Iterator[None]:
    """Log the standard output at level DEBUG, of one thread at a time."""
    if not LOG.isEnabledFor(logging.DEBUG):
        yield
        return
    with _OUTPUT_LOCK, redirect_stdout(io.StringIO()) as output:
        yield
    LOG.debug(output.getvalue().strip())
