"""octoplan new: a commented file to start from, for each command that takes one."""

from __future__ import annotations

import argparse
from pathlib import Path

from model import InputError
from planner.commands.command import OK, Answer, Command
from planner.io.files import why, write_new
from planner.io.templates import TEMPLATES, first_files

_SHOWN = {
    "plan": "plan {} --out out",
    "trajectory": "trajectory {} --out out",
    "sweep": "sweep {}",
    "calibrate": "calibrate {}",
    "design": "design {}",
}


def add(parser: argparse.ArgumentParser) -> None:
    """Add the file to write, and its kind."""
    parser.add_argument(
        "file", type=Path, nargs="?", default=None, help="scene.toml unless given, or KIND.toml"
    )
    parser.add_argument(
        "--kind", choices=list(TEMPLATES), default="plan", help="the command that it is for (plan)"
    )


def run(args: argparse.Namespace) -> Answer:
    """Write the file, and what it needs beside it; never over a file that is there."""
    path = args.file or Path("scene.toml" if args.kind == "plan" else f"{args.kind}.toml")
    if path.suffix.lower() != ".toml":
        raise InputError("FILE", str(path), "a file name that ends in .toml")
    files = first_files(args.kind, path.name)
    try:
        write_new(path.parent, {name: text.encode() for name, text in files.items()})
    except FileExistsError as reason:
        raise InputError("FILE", str(reason.filename), "a file that does not exist yet") from None
    except (OSError, ValueError) as reason:
        told = f"a file that can be written: {why(reason)}"
        raise InputError("FILE", str(path), told) from None
    written = " and ".join(str(path.with_name(name)) for name in files)
    verb = "is" if len(files) == 1 else "are"
    told = f"{written} {verb} written; next: octoplan {_SHOWN[args.kind].format(path)}"
    return Answer(OK, lambda: told)


COMMAND = Command("new", "write a commented file to start from", add, run)
