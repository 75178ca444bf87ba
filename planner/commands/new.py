"""octoplan new: a commented scene to start from."""

from __future__ import annotations

import argparse
from pathlib import Path

from model import InputError
from planner.commands.command import OK, Answer, Command
from planner.files import why
from planner.scenes.template import TEMPLATE


def add(parser: argparse.ArgumentParser) -> None:
    """Add the file to write."""
    parser.add_argument(
        "file", type=Path, nargs="?", default=Path("scene.toml"), help="scene.toml unless given"
    )


def run(args: argparse.Namespace) -> Answer:
    """Write the scene; never over a file that is there."""
    path: Path = args.file
    if path.suffix.lower() != ".toml":
        raise InputError("FILE", str(path), "a file name that ends in .toml")
    try:
        with path.open("x", encoding="utf-8") as stream:
            stream.write(TEMPLATE)
    except FileExistsError:
        raise InputError("FILE", str(path), "a file that does not exist yet") from None
    except (OSError, ValueError) as reason:
        told = f"a file that can be written: {why(reason)}"
        raise InputError("FILE", str(path), told) from None
    return Answer(OK, lambda: f"{path} is written; next: octoplan plan {path} --out out")


COMMAND = Command("new", "write a commented scene file to start from", add, run)
