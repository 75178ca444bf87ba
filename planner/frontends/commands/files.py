"""Commands for files other than scenes: new, sweep, calibrate, design, schema."""

from __future__ import annotations

import json
import os
from pathlib import Path
from shlex import quote
from typing import Annotated, Any, Literal

import msgspec
from cyclopts import Parameter

from octoplan.model import InputError, OctoplanError
from octoplan.model.support.progress import OutOfTime, time_limit
from octoplan.model.support.text import shortened_lines, to_text
from octoplan.planner.extensions.fit.calibrate import calibrate as find_calibration
from octoplan.planner.frontends.cli import FileOptions, Options, Output
from octoplan.planner.frontends.io.files import to_json, write_together
from octoplan.planner.frontends.io.fit_files import (
    CalibrationFile,
    DesignFile,
    load_asked,
    run_design,
)
from octoplan.planner.frontends.io.records import (
    AccuracyRecord,
    CheckRecord,
    EffectsRecord,
    ExportRecord,
    ShapeRecord,
    StiffnessRecord,
    SweepRecord,
    TrajectoryRecord,
    WorkspaceRecord,
    record,
)
from octoplan.planner.frontends.io.saved_records import CalibrationRecord, DesignRecord, PlanRecord
from octoplan.planner.frontends.io.scene_tables import SceneTable
from octoplan.planner.frontends.report import figure
from octoplan.planner.frontends.sweeps.definition import load_sweep
from octoplan.planner.frontends.sweeps.sweep import write_sweep

_DEFAULT = FileOptions()
# Commented files of each kind, which run unchanged.
TEMPLATES = Path(__file__).with_name("templates")
Kind = Literal["plan", "trajectory", "sweep", "calibrate", "design"]


def new(
    file: Annotated[Path | None, Parameter(help="default: scene.toml, or KIND.toml")] = None,
    /,
    *,
    kind: Kind = "plan",
) -> Output:
    """Write a commented example file that runs unchanged; existing files are kept.

    Parameters
    ----------
    kind
        The command that reads the file.
    """
    path = file or Path("scene.toml" if kind == "plan" else f"{kind}.toml")
    if path.suffix.lower() != ".toml":
        raise InputError("FILE", str(path), "a file name that ends in .toml")
    contents = {path.name: (TEMPLATES / f"{kind}.toml").read_text("utf-8")}
    if kind == "calibrate":
        shapes = "calibrate_shapes.csv"
        beside = f"{path.stem}_shapes.csv"
        contents = {path.name: contents[path.name].replace(shapes, beside)}
        contents[beside] = (TEMPLATES / shapes).read_text("utf-8")
    for there in map(path.with_name, contents):
        if os.path.lexists(there):
            raise InputError("FILE", str(there), "a file that does not exist yet")
    if not path.parent.is_dir():
        raise InputError("FILE", str(path), "a file in an existing folder")
    write_together(path.parent, {name: text.encode() for name, text in contents.items()})
    names = " and ".join(str(path.with_name(name)) for name in contents)
    verb = "is" if len(contents) == 1 else "are"
    more = " --out out" * (kind != "sweep")
    return Output(lambda: f"{names} {verb} written; next: octoplan {kind} {quote(str(path))}{more}")


def sweep(
    file: Annotated[Path, Parameter(help="sweep file, SWEEP.toml")],
    /,
    *,
    out: Path | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    options: Options = _DEFAULT,
) -> Output:
    """Compute shapes, plans or stiffness at many values of a scene; resume if interrupted.

    A sweep that --time-limit stopped resumes with the same command.

    Parameters
    ----------
    out
        The Dataset, .nc (NetCDF) or .zarr; default: the name of the sweep file with .nc.
    jobs
        Number of processes; -1 is one per processor (1).
    scheduler
        tcp://HOST:PORT of a Dask scheduler, whose workers compute.
    """
    to = file.with_suffix(".nc") if out is None else out
    try:
        with time_limit(options.time_limit):
            wanted = load_sweep(file)
            attributes, is_earlier = write_sweep(wanted, to, jobs=jobs, scheduler=scheduler)
    except OutOfTime:
        kept = "finished chunks are kept: run the sweep again to compute the others"
        limit = f"the time limit of {options.time_limit:g} s was reached"
        raise OctoplanError(f"{limit}; {kept}") from None
    more = {"met": int(attributes["met"]), "failures": json.loads(attributes["failures"])}
    result = record(SweepRecord, wanted, file=str(to), earlier=is_earlier, **more)
    return Output(lambda: _sweep_text(result), result)


def _sweep_text(record: SweepRecord) -> str:
    dims = " x ".join(f"{name} ({size})" for name, size in record.dims.items())
    word = "reached" if record.compute == "plan" else "settled"
    lines = [
        "finished by an earlier run, nothing was computed; remove the file to compute again"
    ] * record.earlier
    lines += [f"{record.file}: {dims}", f"  {record.met} of {record.points} points {word}"]
    failures = [f"  {count} x for example: {text}" for text, count in record.failures.items()]
    return "\n".join([*lines, *shortened_lines(failures, 4)])


def calibrate(
    file: Annotated[Path, Parameter(help="calibration file, FILE.toml")],
    /,
    *,
    leave_out: bool = False,
    options: FileOptions = _DEFAULT,
) -> Output:
    """Fit parameters of an arm to measured shapes.

    Parameters
    ----------
    leave_out
        Also print the prediction error of each shape by a fit without it.
    """
    result = find_calibration(**load_asked(file))

    def text() -> str:
        if not leave_out:
            return to_text(result)
        error = f"{1e3 * result.leave_out().mean_error:.3g} mm on average"
        return f"{to_text(result)}\n  prediction error of omitted shapes: {error}"

    return Output(text, record(CalibrationRecord, result), "calibration", result.plot)


def design(
    file: Annotated[Path, Parameter(help="design file, FILE.toml")],
    /,
    *,
    options: FileOptions = _DEFAULT,
) -> Output:
    """Find the arm for which several tasks need the least effort."""
    result = run_design(file)
    return Output(
        lambda: to_text(result),
        record(DesignRecord, result),
        "design",
        lambda: figure("plan", "plot_together")(result.plans),
        reached=result.feasible,
    )


# Schemas

_DIALECT = "https://json-schema.org/draft/2020-12/schema"

RECORDS: dict[str, type[msgspec.Struct]] = {
    "plan": PlanRecord,
    "settle": ShapeRecord,
    "stiffness": StiffnessRecord,
    "accuracy": AccuracyRecord,
    "check": CheckRecord,
    "effects": EffectsRecord,
    "sweep": SweepRecord,
    "workspace": WorkspaceRecord,
    "calibrate": CalibrationRecord,
    "design": DesignRecord,
    "export": ExportRecord,
    "trajectory": TrajectoryRecord,
}
"""Records by command, for --json."""

FILES: dict[str, type[msgspec.Struct]] = {
    "scene": SceneTable,
    "calibration-file": CalibrationFile,
    "design-file": DesignFile,
}
"""Types of the input files."""

SCHEMAS = ("scene", *RECORDS, *(name for name in FILES if name != "scene"))


def schema_of(name: str) -> dict[str, Any]:
    """Return the JSON Schema of files ("scene") or of the JSON output of a command.

    Conditions on several keys, such as a point within the arm, are not in the schema.
    """
    title = f"octoplan {name}" if name in FILES else f"octoplan {name} --json"
    schema = msgspec.json.schema({**FILES, **RECORDS}[name])
    return {"$schema": _DIALECT, "title": title, **schema}


_WHAT = Parameter(choices=SCHEMAS, help="default: scene")


def schema(what: Annotated[str, _WHAT] = "scene", /) -> Output:
    """Print the JSON Schema of a file, or of the JSON output of a command."""
    # The text for people is JSON too.
    return Output(lambda: to_json(schema_of(what)).decode())
