"""The command line `octoplan`; the commands are in planner/commands, `--help` tells exit codes."""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from model import InputError, OctoplanError, UnitWarning
from model.errors import CompilerError, MissingExtraError, TimeLimitError, shortened
from model.progress import progress_line, tell
from model.time_limit import OutOfTime, time_limit
from planner.commands.answer import (
    BAD_INPUT,
    BROKEN_PIPE,
    NO_OUTPUT,
    NOT_REACHED,
    OK,
    Answer,
    OutputError,
    deliver,
    discard,
    say,
)
from planner.commands.options import GRACE, Options, UsageError, parse

# Of messages, in characters.
_LONG = 2000


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    try:
        return _run(sys.argv[1:] if argv is None else argv)
    except OutputError as reason:
        discard()
        return _told(reason, NO_OUTPUT)
    except (CompilerError, InputError, UsageError, MissingExtraError) as reason:
        return _told(reason, BAD_INPUT)
    except OctoplanError as reason:
        return _told(reason, NOT_REACHED)
    except BrokenPipeError:
        discard()
        return BROKEN_PIPE


def _run(argv: Sequence[str]) -> int:
    command, options = parse(argv)
    try:
        with time_limit(None if options.time_limit is None else options.time_limit + GRACE):
            with _warned(), _reported(options):
                answer = command()
            if not isinstance(answer, Answer):
                say(answer)
                return OK
            deliver(answer, options)
    except OutOfTime:
        assert options.time_limit is not None
        raise TimeLimitError(options.time_limit) from None
    return int(answer.code)


def _told(reason: Exception, code: int) -> int:
    print(f"octoplan: {shortened(str(reason), _LONG)}", file=sys.stderr)
    return code


@contextmanager
def _warned() -> Iterator[None]:
    """Tell warnings as sentences, each once."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UnitWarning)
        try:
            yield
        finally:
            for text in dict.fromkeys(str(item.message) for item in caught):
                sys.stderr.write(f"octoplan: beware: {shortened(text, _LONG)}\n")


@contextmanager
def _reported(options: Options) -> Iterator[None]:
    """Show how far things are inside the block, or the logs of planner and model if wanted."""
    if not options.verbose:
        with progress_line():
            tell("working")
            yield
        return
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
