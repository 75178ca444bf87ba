"""octoplan calibrate: numbers of an arm from measured shapes."""

from __future__ import annotations

import argparse
from pathlib import Path

from planner.commands.command import (
    OK,
    Answer,
    Command,
    add_figure_kind,
    add_time_limit,
    check_folder,
)
from planner.fit.calibration import Calibration
from planner.fit.calibration_file import load_asked
from planner.io.saved_records import calibration_record


def add(parser: argparse.ArgumentParser) -> None:
    """Add the file and how to answer."""
    parser.add_argument("file", type=Path, metavar="FILE.toml", help="calibration file")
    parser.add_argument(
        "--json",
        action="store_true",
        help="print JSON, in SI units; `octoplan schema` tells its keys",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="also write data and figure there")
    add_figure_kind(parser)
    add_time_limit(parser)
    parser.add_argument(
        "-v", "--verbose", action="store_true", help="show the solver's own log on stderr"
    )
    parser.add_argument(
        "--leave-out", action="store_true", help="also tell how well fits predict shapes left out"
    )


def run(args: argparse.Namespace) -> Answer:
    """Calibrate the arm of the file."""
    check_folder(args)
    found = load_asked(args.file).run()
    return Answer(
        OK,
        lambda: _text(found, args.leave_out),
        calibration_record(found),
        "calibration",
        found.plot,
    )


def _text(found: Calibration, leave_out: bool) -> str:
    width = max(len(own.name) for own in found.unknowns)
    rows = zip(found.unknowns, found.values, found.std, strict=True)
    lines = [
        f"  {own.name:<{width}}  {value:.6g} +- {std:.2g} {found.parameters.unit(own)}".rstrip()
        for own, value, std in rows
    ]
    if leave_out:
        error = 1e3 * found.leave_out().mean_error
        lines.append(f"  shapes left out are predicted to {error:.3g} mm in the mean")
    return "\n".join([found.outcome, *lines])


COMMAND = Command("calibrate", "find numbers of an arm from measured shapes", add, run)
