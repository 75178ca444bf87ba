"""What a command is, what it answers, and the options that commands share."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from model import InputError
from model.checks import positive
from model.errors import FileError
from model.mesh_refinement import FINEST_ACCURACY, LOOSEST, checked_accuracy
from model.time_limit import shorten
from planner.io.files import why
from planner.io.scene_file import Question, load

# What a search that was stopped at the time limit has left to verify what it found [s].
GRACE = 0.7
OK, NOT_REACHED, BAD_INPUT = 0, 1, 2
NO_OUTPUT, INTERRUPTED, BROKEN_PIPE, TERMINATED = 74, 130, 141, 143
FIGURES = ("png", "pdf")
EXIT_CODES = """\
exit codes:
  0    certified, settled or written
  1    not reached, not certified, or the arm does not settle
  2    bad input: the message says where, what was given and what is allowed; or a package
       is missing: it says how to install that
  74   standard output is full or closed
  130  interrupted (Ctrl-C); 141 whoever read the output went away; 143 terminated"""


@dataclass(frozen=True)
class Answer:
    """What a command found, in the forms in which it can be handed out.

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
        Further files by name, such as "plan.csv".
    """

    code: int
    text: Callable[[], str]
    record: Any = None
    name: str = ""
    draw: Callable[[], Any] | None = None
    tables: Mapping[str, bytes] = field(default_factory=dict)


@dataclass(frozen=True)
class Command:
    """A command: its name, what it does in a sentence, its options, and what answers it."""

    name: str
    help: str
    add: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], Answer]


def add_scene_options(parser: argparse.ArgumentParser) -> None:
    """Add what all commands on scene files have: the file, how to answer, the accuracy, -v."""
    parser.add_argument("scene", type=Path, metavar="SCENE.toml", help="scene file")
    parser.add_argument(
        "--json",
        action="store_true",
        help="print JSON, in SI units; `octoplan schema` tells its keys",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="also write data and figure there")
    add_figure_kind(parser)
    parser.add_argument(
        "--accuracy",
        type=accuracy,
        metavar="X",
        help="tip error over arm length; else the scene's",
    )
    add_time_limit(parser)
    parser.add_argument(
        "-v", "--verbose", action="store_true", help="show the solver's own log on stderr"
    )


def add_figure_kind(parser: argparse.ArgumentParser) -> None:
    """Add of which kind the figure is that goes into the folder of --out."""
    parser.add_argument(
        "--figure", choices=FIGURES, help="of which kind the figure in --out is (png)"
    )


def check_folder(args: argparse.Namespace) -> None:
    """Refuse a folder that is none, and a kind of figure without a folder that it goes to."""
    if args.out is None and args.figure is not None:
        told = f"--figure {args.figure} with --out DIR, the folder that it is written to"
        raise InputError("--out", "nothing", told)
    if args.out is not None:
        _check_folder("--out", args.out)


def add_time_limit(parser: argparse.ArgumentParser) -> None:
    """Add after how long an answer has to be there."""
    parser.add_argument(
        "--time-limit",
        type=seconds,
        metavar="SECONDS",
        help="stop then, with the best that was found by then; else the scene's time_limit_s",
    )


def add_compiled_options(parser: argparse.ArgumentParser) -> None:
    """Add what commands have that may work by machine code."""
    add_scene_options(parser)
    parser.add_argument(
        "--compile",
        action="store_true",
        help="work by machine code, built by a C compiler and kept: the same digits, sooner",
    )


def question(args: argparse.Namespace) -> tuple[Question, float]:
    """Return the question of the scene file and the accuracy; FileError, InputError."""
    check_folder(args)
    asked = loaded(args)
    if getattr(args, "compile", False):
        asked = replace(asked, compile=True)
    return asked, asked.accuracy if args.accuracy is None else args.accuracy


def loaded(args: argparse.Namespace) -> Question:
    """Return the question of the scene file; its time limit holds from here on, if it alone has.

    Raises FileError.
    """
    asked = load(args.scene)
    if args.time_limit is None and asked.time_limit is not None:
        args.time_limit = asked.time_limit
        shorten(asked.time_limit + GRACE)
    return asked


def _check_folder(name: str, folder: Path) -> None:
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError(name, str(folder), "a folder to write to, or one to make")
    except OSError as reason:
        raise InputError(name, str(folder), f"a folder to write to: {why(reason)}") from None


def held_of(asked: Question, name: Path) -> dict[str, Any]:
    """Return what holds a scene file's tendons, as arguments of settle; FileError if nothing."""
    if asked.winches:
        return {"tensions": asked.tensions, **asked.winches}
    return {"tensions": tensions_of(asked, name)}


def tensions_of(asked: Question, name: Path) -> Any:
    """Return the tensions of a scene file; FileError if it has none."""
    if asked.tensions is None:
        rows = ", ".join(
            f"[{', '.join('0.0' for _ in section.angles)}]" for section in asked.arm.sections
        )
        place = "at the top of the file, above the first [table]"
        raise FileError(
            str(name), "tensions", f"missing; needed is tensions = [{rows}] (N) {place}"
        )
    return asked.tensions


def accuracy(text: str) -> float:
    """Return an accuracy given on the command line."""
    try:
        return checked_accuracy(float(text))
    except ValueError:
        allowed = f"a number from {FINEST_ACCURACY:g} to {LOOSEST:g}"
        raise argparse.ArgumentTypeError(f"got {text!r}, allowed is {allowed}") from None


def seconds(text: str) -> float:
    """Return a time given on the command line [s]."""
    try:
        return positive("--time-limit", float(text))
    except ValueError:
        raise argparse.ArgumentTypeError(f"got {text!r}, allowed is a number above 0") from None
