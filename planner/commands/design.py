"""octoplan design: the arm for which several tasks take least effort."""

from __future__ import annotations

import argparse
from pathlib import Path

from planner.commands.command import NOT_REACHED, OK, Answer, Command, add_time_limit
from planner.fit.design_file import run_design
from planner.fit.designed import Design
from planner.io.saved_records import design_record


def add(parser: argparse.ArgumentParser) -> None:
    """Add the file and how to answer."""
    parser.add_argument("file", type=Path, metavar="FILE.toml", help="design file")
    parser.add_argument(
        "--json",
        action="store_true",
        help="print JSON, in SI units; `octoplan schema` tells its keys",
    )
    add_time_limit(parser)
    parser.add_argument(
        "-v", "--verbose", action="store_true", help="show the solver's own log on stderr"
    )


def run(args: argparse.Namespace) -> Answer:
    """Design the arm of the file."""
    found = run_design(args.file)
    code = OK if found.feasible else NOT_REACHED
    return Answer(code, lambda: _text(found), design_record(found))


def _text(found: Design) -> str:
    width = max(len(own.name) for own in found.unknowns)
    rows = zip(found.unknowns, found.values, found.parameters.start, strict=True)
    lines = [
        f"  {own.name:<{width}}  {value:.5g} (was {old:.5g}) {found.parameters.unit(own)}".rstrip()
        for own, value, old in rows
    ]
    efforts = ", ".join(f"{own.effort:.4g}" for own in found.plans)
    return "\n".join([found.outcome, *lines, f"  efforts of the tasks [N]: {efforts}"])


COMMAND = Command("design", "find the arm for which several tasks take least effort", add, run)
