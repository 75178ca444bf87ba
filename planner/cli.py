"""The command line `octoplan`; the commands are in planner/commands, `--help` tells exit codes."""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from model import InputError, OctoplanError
from model.errors import CompilerError
from model.progress import listening
from planner.commands.command import BAD_INPUT, BROKEN_PIPE, INTERRUPTED, NOT_REACHED
from planner.commands.deliver import deliver
from planner.commands.progress import Bar
from planner.commands.register import COMMANDS
from planner.commands.usage import UsageError, parse
from planner.extras import MissingExtraError


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    try:
        return _run(sys.argv[1:] if argv is None else argv)
    except (CompilerError, InputError, UsageError, MissingExtraError) as reason:
        return _told(reason, BAD_INPUT)
    except OctoplanError as reason:
        return _told(reason, NOT_REACHED)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # What is left in the buffer goes nowhere, and Python does not complain of it at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE


def _run(argv: Sequence[str]) -> int:
    args = parse(argv, COMMANDS)
    verbose = getattr(args, "verbose", False)
    with _ended_by_interrupt(), _logged() if verbose else _shown():
        answer = args.run(args)
    deliver(answer, args)
    return int(answer.code)


def _told(reason: Exception, code: int) -> int:
    print(f"octoplan: {reason}", file=sys.stderr)
    return code


@contextmanager
def _ended_by_interrupt() -> Iterator[None]:
    """Let Ctrl-C end the program from inside the block, at once.

    A KeyboardInterrupt would not: CasADi makes a warning of it in the middle of ipopt, which goes
    on. Nothing is written inside the block that could be left in half.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def _shown() -> Iterator[None]:
    """Show how far things are inside the block."""
    bar = Bar()
    try:
        with listening(bar):
            yield
    finally:
        bar.close()


@contextmanager
def _logged() -> Iterator[None]:
    """Show the logs of planner and model inside the block."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(name)s: %(message)s"))
    loggers = [logging.getLogger(name) for name in ("planner", "model")]
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        for logger in loggers:
            logger.removeHandler(handler)
            logger.setLevel(logging.NOTSET)


if __name__ == "__main__":
    sys.exit(main())
