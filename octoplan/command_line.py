"""The command line for cyclopts: commands, imported at first use, and their help.

This module imports no other module of the project, so that help is fast.
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
    "new": "Write a commented example file.",
    "plan": "Find the tensions of least effort for the target of the scene.",
    "trajectory": "Find tensions over time through the waypoints of the scene.",
    "settle": "Find the shape for the tensions or lengths of the scene.",
    "stiffness": "Find the compliance of the shape of the scene.",
    "live": "Open a web page on which the target is dragged and the arm follows.",
    "accuracy": "Measure error over time of settling and planning the scene; recommend an "
    "accuracy.",
    "effects": "Compare shape and run time of the scene with and without each effect.",
    "check": "Settle random tensions within the limits in several ways; compare the tips.",
    "sweep": "Compute shapes, plans or stiffness at many values of a scene; resume if interrupted.",
    "workspace": "Find the tips that the arm reaches within the limits of the scene, and their "
    "boundary.",
    "calibrate": "Fit parameters of an arm to measured shapes.",
    "design": "Find the arm for which several tasks need the least effort.",
    "export": "Write the map from tensions to shape or its inverse as C code, or the settled arm "
    "as a mesh or links.",
    "schema": "Print the JSON Schema of files, or of the JSON output of a command.",
}
"""Commands with descriptions; the functions are in planner/frontends/commands."""
# More help on the page of a command.
_DETAILS = {
    "stiffness": """\
Keys of the table [stiffness] in the scene file:
  hold       "tension" or "length": the quantity that the motors hold;
             default: "length" if the scene has lengths, else "tension"
  at_mm      arc length of the loaded point; default: the tip
  tendon_EA  stiffness E A of tendons of held length in N;
             default: inextensible; at the top of files with lengths
  release    false: tendons without tension are held, too""",
}
# Modules of the commands; `scenes` for all others.
_MODULES = dict.fromkeys(("new", "sweep", "calibrate", "design", "schema"), "files")
_MODULES["workspace"] = "workspaces"
EXIT_CODES = """\
Exit codes:
  0    certified, settled or written
  1    not reached, not certified, or no equilibrium found
  2    invalid input: the message has the field, the value and the rule;
       or a missing package: the message has the command that installs it
  74   standard output is full or closed
  130  interrupted (Ctrl-C); 141 the reader of the output has exited;
       143 terminated
"""
"""Meaning of the exit codes, for the help of all commands and docs/command_line.rst."""


def app() -> App:
    """Return the command line; its output goes to memory, see printed."""
    is_terminal = sys.stdout is not None and sys.stdout.isatty()
    columns = shutil.get_terminal_size().columns
    packages = ("octoplan", "casadi", "numpy")
    line = App(
        "octoplan",
        help="Find the tendon tensions with which a soft arm takes a shape.",
        help_epilogue=EXIT_CODES.rstrip(),
        help_format="plaintext",
        console=Console(file=io.StringIO(), width=columns, force_terminal=is_terminal),
        version=", ".join(f"{name} {version(name)}" for name in packages),
        default_parameter=Parameter(negative=(), show_default=False),
    )
    for place, (name, sentence) in enumerate(COMMANDS.items()):
        path = f"octoplan.planner.frontends.commands.{_MODULES.get(name, 'scenes')}:{name}"
        text = "\n\n".join([sentence, *filter(None, [_DETAILS.get(name)])])
        line.command(path, name=name, help=text, sort_key=place)
    line.register_install_completion_command(help="Install completion for the current shell.")
    return line


def printed(line: App, show: Callable[[], Any]) -> str:
    """Return the output of cyclopts; the caller prints it and detects errors of stdout."""
    show()
    text: str = line.console.file.getvalue()  # type: ignore[attr-defined]
    return text
