"""octoplan new: a commented file to start from, for each command that takes one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from model import InputError
from planner.commands.answer import OK, Answer
from planner.io.files import why, write_new
from planner.io.templates import first_files

Kind = Literal["plan", "trajectory", "sweep", "calibrate", "design"]
_NEXT = {
    "plan": "plan {} --out out",
    "trajectory": "trajectory {} --out out",
    "sweep": "sweep {}",
    "calibrate": "calibrate {} --out out",
    "design": "design {} --out out",
}


def new(
    file: Annotated[Path | None, Parameter(help="scene.toml unless given, or KIND.toml")] = None,
    /,
    *,
    kind: Kind = "plan",
) -> Answer:
    """Write a commented file to start from, that runs as it is; never over one that is there.

    Parameters
    ----------
    kind
        The command that it is for.
    """
    path = file or Path("scene.toml" if kind == "plan" else f"{kind}.toml")
    if path.suffix.lower() != ".toml":
        raise InputError("FILE", str(path), "a file name that ends in .toml")
    contents = first_files(kind, path.name)
    try:
        write_new(path.parent, {name: text.encode() for name, text in contents.items()})
    except FileExistsError as reason:
        raise InputError("FILE", str(reason.filename), "a file that does not exist yet") from None
    except (OSError, ValueError) as reason:
        allowed = f"a file that can be written: {why(reason)}"
        raise InputError("FILE", str(path), allowed) from None
    written = " and ".join(str(path.with_name(name)) for name in contents)
    verb = "is" if len(contents) == 1 else "are"
    text = f"{written} {verb} written; next: octoplan {_NEXT[kind].format(path)}"
    return Answer(OK, lambda: text)
