"""octoplan schema: the JSON Schema of files, and of what the commands print with --json."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

from planner.commands.answer import OK, Answer
from planner.io.files import to_json
from planner.io.schemas import SCHEMAS, schema_of

_WHAT = Parameter(choices=SCHEMAS, help="scene unless given")


def schema(what: Annotated[str, _WHAT] = "scene", /) -> Answer:
    """Print the JSON Schema of files, or of what a command prints with --json."""
    # It is JSON for people too.
    return Answer(OK, lambda: to_json(schema_of(what)).decode())
