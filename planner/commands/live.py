"""octoplan live: a page on which the scene's target is dragged, and the arm follows."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from planner.commands.command import OK, Answer, Command, accuracy
from planner.commands.plan import check_asked
from planner.io.scene_file import load
from planner.live.handles import handle_of
from planner.live.page import Page
from planner.live.session import Session


def add(parser: argparse.ArgumentParser) -> None:
    """Add the scene, where the page is, how accurate plans are, and whether by machine code."""
    parser.add_argument("scene", type=Path, metavar="SCENE.toml", help="scene file")
    parser.add_argument("--host", default="localhost", help="where the page is served (localhost)")
    parser.add_argument("--port", type=int, default=8080, help="its port (8080)")
    parser.add_argument(
        "--accuracy",
        type=accuracy,
        metavar="X",
        help="tip error over arm length; else the scene's",
    )
    parser.add_argument(
        "--compile", action="store_true", help="work by machine code, see octoplan plan"
    )


def run(args: argparse.Namespace) -> Answer:
    """Serve the page until the last browser that looked at it is gone."""
    asked = load(args.scene)
    check_asked(asked, args.scene)
    wanted = asked.accuracy if args.accuracy is None else args.accuracy
    options = asked.options | {"accuracy": wanted, "compile": args.compile or asked.compile}
    handle = handle_of(asked.arm, asked.targets)
    page = Page(Session(asked.arm, asked.scene, handle, options), args.host, args.port)
    sys.stderr.write(f"octoplan: http://{args.host}:{args.port} (ends with the last browser)\n")
    page.wait()
    page.end()
    return Answer(OK, lambda: "The last browser is gone.")


COMMAND = Command(
    "live", "open a page on which the scene's target is dragged and the arm follows", add, run
)
