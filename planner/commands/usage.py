"""The parser of the command line; its mistakes are errors that say what to write instead."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import Any, NoReturn

from model import OctoplanError
from model.errors import shortened
from planner.commands.command import EXIT_CODES, Command
from planner.commands.output import say
from planner.io.files import versions
from planner.io.key_paths import hint


class UsageError(OctoplanError):
    """The command line is not one that the program knows."""


class Parser(argparse.ArgumentParser):
    """Raises UsageError in place of leaving."""

    def error(self, message: str) -> NoReturn:
        """Raise UsageError with where to read on."""
        raise UsageError(f"{shortened(_plain(message))} (see {self.prog} --help)")

    def _print_message(self, message: str, file: Any = None) -> None:
        """Say what --help and --version ask for; argparse would not notice a full disk."""
        say(message)


def _plain(message: str) -> str:
    """Return what argparse says as errors of files are told: what was given, what is allowed."""
    choice = re.fullmatch(r"argument (\S+): invalid choice: '(.*)' \(choose from (.*)\)", message)
    if choice:
        name, given, listed = choice.groups()
        known = re.findall(r"'([^']*)'|([\w-]+)", listed)
        texts = [quoted or bare for quoted, bare in known]
        told = f'{name.upper() if name[0] != "-" else name}: got "{given}"'
        return f"{told}, allowed is one of {', '.join(texts)}{hint(given, texts)}"
    number = re.fullmatch(r"argument (\S+): invalid (int|float) value: '(.*)'", message)
    if number:
        wanted = {"int": "a whole number", "float": "a number"}[number[2]]
        return f'{number[1]}: got "{number[3]}", allowed is {wanted}'
    message = re.sub(r"^argument (\S+): expected one argument$", r"\1: a value is missing", message)
    message = re.sub(r"^the following arguments are required: ", "missing: ", message)
    return re.sub(r"^argument ", "", message)


def parse(argv: Sequence[str], commands: Sequence[Command]) -> argparse.Namespace:
    """Return the arguments, with `run` that answers them; raises UsageError."""
    _check_command(argv, [command.name for command in commands])
    parser, subs = _parser(commands)
    args, others = parser.parse_known_args(argv)
    if others:
        sub = subs[args.command]
        known = [text for action in sub._actions for text in action.option_strings]
        sub.error(f"no such argument: {others[0]}{hint(others[0].split('=')[0], known)}")
    return args


def _parser(commands: Sequence[Command]) -> tuple[Parser, dict[str, Parser]]:
    parser = Parser(
        prog="octoplan",
        description="Which tendons to pull, and how hard, so that a soft arm takes a shape.",
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    told = ", ".join(f"{name} {number}" for name, number in versions().items())
    parser.add_argument("--version", action="version", version=told)
    choices = parser.add_subparsers(required=True, metavar="COMMAND", dest="command")
    subs = {}
    for command in commands:
        sub = choices.add_parser(
            command.name,
            help=command.help,
            description=command.help,
            epilog=EXIT_CODES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.add(sub)
        sub.set_defaults(run=command.run)
        subs[command.name] = sub
    return parser, subs


def _check_command(argv: Sequence[str], names: list[str]) -> None:
    first = shortened(argv[0]) if argv else ""
    listed = f"commands: {', '.join(names)}; see octoplan --help"
    if not argv:
        raise UsageError(f"no command; to begin: octoplan new ({listed})")
    if first.startswith("-") or first in names:
        return
    if first.endswith(".toml"):
        raise UsageError(f"what to do with {first}? For example: octoplan plan {first} ({listed})")
    raise UsageError(f'no command "{first}"{hint(first, names)} ({listed})')
