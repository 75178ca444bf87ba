"""What CasADi and its solvers write to the standard streams goes to a log instead."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, redirect_stderr, redirect_stdout


@contextmanager
def logged(log: logging.Logger, stdout: bool = False) -> Iterator[None]:
    """Keep stderr, and stdout if wanted, from the terminal; what was said is logged at DEBUG."""
    said = io.StringIO()
    try:
        with redirect_stderr(said), redirect_stdout(said) if stdout else nullcontext():
            yield
    finally:
        if said.getvalue():
            log.debug(said.getvalue().strip())
