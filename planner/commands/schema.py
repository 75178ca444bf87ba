"""octoplan schema: the JSON Schema of scene files, and of what the commands print with --json."""

from __future__ import annotations

import argparse

from planner.commands.command import OK, Answer, Command
from planner.io.files import to_json
from planner.io.schemas import SCHEMAS, schema_of


def add(parser: argparse.ArgumentParser) -> None:
    """Add the choice of a schema."""
    parser.add_argument(
        "what", nargs="?", default="scene", choices=SCHEMAS, help="scene unless given"
    )


def run(args: argparse.Namespace) -> Answer:
    """Return the schema; it is JSON for people too."""
    return Answer(OK, lambda: to_json(schema_of(args.what)).decode())


COMMAND = Command(
    "schema", "print the JSON Schema of scene files, or of what a command prints", add, run
)
