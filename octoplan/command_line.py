"""The command line as cyclopts knows it: its commands, loaded when they are used, and their help.

It loads nothing of the project, so that help is there at once.
"""

from __future__ import annotations

import io
import shutil
import sys
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

from cyclopts import App, Parameter
from rich.console import Console

COMMANDS = {
    "new": "Write a commented file to start from.",
    "plan": "Find the tensions of least effort for the scene's target.",
    "trajectory": "Find tensions over time through the scene's waypoints.",
    "settle": "Find the shape under the scene's tensions or lengths.",
    "stiffness": "Find how the shape under the scene's tensions answers to a small force.",
    "live": "Open a page on which the scene's target is dragged and the arm follows.",
    "effects": "Tell which effects matter to the scene's shape, and what they cost.",
    "sweep": "Find shapes, plans or stiffness at many values of a scene, and go on where it was "
    "killed.",
    "calibrate": "Find numbers of an arm from measured shapes.",
    "design": "Find the arm for which several tasks take least effort.",
    "export": "Write the map from tensions to shape or its inverse as C, or the settled arm as a "
    "mesh or links.",
    "schema": "Print the JSON Schema of scene files, or of what a command prints.",
}
"""Each command with what it does: the function of its name in planner/frontends/commands."""
# The module of each, but for those in `scenes`.
_MODULES = dict.fromkeys(("new", "sweep", "calibrate", "design", "schema"), "files")
EXIT_CODES = """\
Exit codes:
  0    certified, settled or written
  1    not reached, not certified, or the arm does not settle
  2    bad input: the message says where, what was given, what is allowed;
       or a package is missing: it says how to install that
  74   standard output is full or closed
  130  interrupted (Ctrl-C); 141 whoever read the output went away;
       143 terminated"""


def app() -> App:
    """Return the command line; it prints to memory, see printed."""
    is_terminal = sys.stdout is not None and sys.stdout.isatty()
    columns = shutil.get_terminal_size().columns
    packages = ("octoplan", "casadi", "numpy")
    line = App(
        "octoplan",
        help="Which tendons to pull, and how hard, so that a soft arm takes a shape.",
        help_epilogue=EXIT_CODES,
        help_format="plaintext",
        console=Console(file=io.StringIO(), width=columns, force_terminal=is_terminal),
        version=", ".join(f"{name} {version(name)}" for name in packages),
        default_parameter=Parameter(negative=(), show_default=False),
    )
    for place, (name, sentence) in enumerate(COMMANDS.items()):
        path = f"octoplan.planner.frontends.commands.{_MODULES.get(name, 'scenes')}:{name}"
        line.command(path, name=name, help=sentence, sort_key=place)
    line.register_install_completion_command(help="Install completion for the shell that is used.")
    return line


def printed(line: App, show: Callable[[], Any]) -> str:
    """Return what the library prints; standard output may be full, which it would not tell."""
    show()
    text: str = line.console.file.getvalue()  # type: ignore[attr-defined]
    return text
