"""What a command answers, its exit codes, and how it is handed out."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from model import OctoplanError
from planner.commands.options import FIGURES, FileOptions, Options
from planner.io.files import to_json, why, write_together

OK, NOT_REACHED, BAD_INPUT = 0, 1, 2
NO_OUTPUT, BROKEN_PIPE = 74, 141


@dataclass(frozen=True)
class Answer:
    """What a command computed, in the forms in which it can be handed out.

    Attributes
    ----------
    code : int
        The exit code.
    text : function
        Returns what people read.
    record : msgspec.Struct or dict
        What machines read.
    name : str
        Of the files, without suffix.
    draw : function or None
        Returns the figure.
    tables : mapping
        Functions that return the contents of further files, by name, such as "plan.csv".
    """

    code: int
    text: Callable[[], str]
    record: Any = None
    name: str = ""
    draw: Callable[[], Any] | None = None
    tables: Mapping[str, Callable[[], bytes]] = field(default_factory=dict)


def figure(module: str, function: str, *value: Any) -> Callable[[], Any]:
    """Return what draws a figure by a function of planner.plots, which is loaded only then."""
    return lambda: getattr(import_module(f"planner.plots.{module}"), function)(*value)


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
