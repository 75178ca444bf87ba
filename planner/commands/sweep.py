"""octoplan sweep: a scene's shapes, plans or stiffness at many of its values, in parallel."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from model import OctoplanError
from model.time_limit import OutOfTime, time_limit
from planner.commands.answer import OK, Answer
from planner.commands.options import Options
from planner.io.records import SweepRecord, sweep_record
from planner.sweeps.file import load_sweep
from planner.sweeps.sweep import written

_SHOWN = 3


def sweep(
    file: Annotated[Path, Parameter(help="sweep file, SWEEP.toml")],
    /,
    *,
    out: Path | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    options: Options | None = None,
) -> Answer:
    """Find shapes, plans or stiffness at many values of a scene, and go on where it was killed.

    Stopped by --time-limit, the same command goes on too.

    Parameters
    ----------
    out
        The Dataset, .nc (NetCDF) or .zarr; unless given, beside the sweep file as .nc.
    jobs
        Processes; -1 is all processors (1).
    scheduler
        tcp://HOST:PORT of a Dask scheduler, whose workers work on it.
    """
    options = options or Options()
    to = file.with_suffix(".nc") if out is None else out
    try:
        with time_limit(options.time_limit):
            wanted = load_sweep(file)
            result = written(wanted, to, jobs=jobs, scheduler=scheduler)
    except OutOfTime:
        kept = "what is finished is kept: start the sweep again, and it goes on"
        limit = f"the time limit of {options.time_limit:g} s was reached"
        raise OctoplanError(f"{limit}; {kept}") from None
    record = sweep_record(wanted, result, to)
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
