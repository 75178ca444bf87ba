"""octoplan sweep: a scene's shapes, plans or stiffness at many of its values, in parallel."""

from __future__ import annotations

import argparse
from pathlib import Path

from model import OctoplanError
from model.time_limit import OutOfTime, time_limit
from planner.commands.command import OK, Answer, Command, add_time_limit
from planner.io.records import SweepRecord, sweep_record
from planner.sweeps.file import load_sweep
from planner.sweeps.sweep import written

_SHOWN = 3


def add(parser: argparse.ArgumentParser) -> None:
    """Add the file, the Dataset to write, and who works."""
    parser.add_argument("sweep", type=Path, metavar="SWEEP.toml", help="sweep file")
    parser.add_argument(
        "--out",
        dest="to",
        type=Path,
        metavar="FILE",
        help="the Dataset, .nc (NetCDF) or .zarr; unless given, beside the sweep file as .nc",
    )
    parser.add_argument(
        "--jobs", type=int, default=1, metavar="N", help="processes; -1 is all processors (1)"
    )
    parser.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="a Dask scheduler, whose workers work on it"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    add_time_limit(parser)


def run(args: argparse.Namespace) -> Answer:
    """Run the sweep, or what a killed run of it has left."""
    out = args.sweep.with_suffix(".nc") if args.to is None else args.to
    try:
        with time_limit(args.time_limit):
            asked = load_sweep(args.sweep)
            found = written(asked, out, jobs=args.jobs, scheduler=args.scheduler)
    except OutOfTime:
        told = "what is finished is kept: start the sweep again, and it goes on"
        raise OctoplanError(
            f"the time limit of {args.time_limit:g} s was reached; {told}"
        ) from None
    record = sweep_record(asked, found, out)
    return Answer(OK, lambda: _text(record), record)


def _text(record: SweepRecord) -> str:
    dims = " x ".join(f"{name} ({size})" for name, size in record.dims.items())
    word = "reached" if record.compute == "plan" else "settled"
    lines = [
        "finished by an earlier run, not run again; remove the file to run it"
    ] * record.earlier
    lines += [f"{record.file}: {dims}", f"  {record.met} of {record.points} points {word}"]
    shown = list(record.failures.items())[:_SHOWN]
    lines += [f"  {count} x such as: {told}" for told, count in shown]
    others = len(record.failures) - len(shown)
    return "\n".join(lines + [f"  and {others} other kinds"] * (others > 0))


COMMAND = Command(
    "sweep",
    "find shapes, plans or stiffness at many values of a scene; goes on where it was killed",
    add,
    run,
)
