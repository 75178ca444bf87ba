"""The command line, parsed: what answers it, and by which options."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, get_args, get_type_hints

from cyclopts import CycloptsError

from model import OctoplanError
from octoplan.command_line import COMMANDS, app, printed
from planner.commands.options import Options


class UsageError(OctoplanError):
    """The command line is not one that the program knows."""


def parse(argv: Sequence[str]) -> tuple[Callable[[], Any], Options]:
    """Return what answers a command line, and the options that it has; raises UsageError.

    What it returns is an Answer, or a text where help or versions are wanted.
    """
    if not argv:
        raise UsageError("no command; to begin: octoplan new (see octoplan --help)")
    if argv[0].endswith(".toml"):
        raise UsageError(f"what to do with {argv[0]}? For example: octoplan plan {argv[0]}")
    line = app()
    try:
        call, bound, _ = line.parse_args(
            argv, exit_on_error=False, print_error=False, verbose=False
        )
    except CycloptsError as reason:
        command = next((own for own in argv if own in COMMANDS), "")
        where = " ".join(["octoplan", command]).strip()
        raise UsageError(f"{reason} (see {where} --help)") from None
    if call.__name__ not in COMMANDS:
        return partial(printed, line, partial(call, *bound.args, **bound.kwargs)), Options()
    kinds = get_type_hints(call)
    if "options" in kinds and "options" not in bound.arguments:
        bound.arguments["options"] = get_args(kinds["options"])[0]()
    options = bound.arguments.get("options", Options())
    return partial(call, *bound.args, **bound.kwargs), options
