"""The command line `octoplan`; the commands are in planner/commands, `--help` tells exit codes."""

from __future__ import annotations

import logging
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from model import InputError, OctoplanError, UnitWarning
from model.errors import CompilerError, MissingExtraError, TimeLimitError, shortened
from model.progress import progress_line, tell
from model.time_limit import OutOfTime, time_limit
from planner.commands.options import (
    BAD_INPUT,
    FIGURES,
    GRACE,
    NOT_REACHED,
    OK,
    Answer,
    FileOptions,
    Options,
    UsageError,
    figure,
    parse,
)
from planner.io.files import to_json, why, write_together

NO_OUTPUT, BROKEN_PIPE = 74, 141
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


# Output


class OutputError(OctoplanError):
    """Standard output takes nothing."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(f"standard output cannot be written to: {reason}")


def deliver(answer: Answer, options: Options) -> None:
    """Write the files that --out asks for, then what --json or people are shown."""
    if isinstance(options, FileOptions) and options.out is not None:
        _write(options.out, answer, options.figure or FIGURES[0])
    shown = to_json(answer.record).decode() if options.json else answer.text()
    say(shown + "\n")


def _write(folder: Path, answer: Answer, kind: str) -> None:
    """Write data and figure into a folder: all of them, or on an error none."""
    files = {name: content() for name, content in answer.tables.items()}
    files[f"{answer.name}.json"] = to_json(answer.record)
    if answer.draw is not None:
        files[f"{answer.name}.{kind}"] = figure("plan", "drawn", answer.draw(), kind)()
    write_together(folder, files)


def say(text: str) -> None:
    """Write to standard output; BrokenPipeError where its reader is gone, else OutputError."""
    if sys.stdout is None:
        raise OutputError("it is closed")
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except (OSError, ValueError) as reason:
        raise OutputError(why(reason)) from None


def discard() -> None:
    """Let what is left in the buffer go nowhere, so that Python does not complain at its end."""
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
