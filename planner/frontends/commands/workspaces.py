"""The command `workspace`: tips within the limits of a scene, as a Dataset and a figure."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from cyclopts.validators import Number

from octoplan.model import OctoplanError
from octoplan.model.support.progress import OutOfTime, time_limit
from octoplan.model.support.text import columns, shortened_lines
from octoplan.planner.frontends.cli import FileOptions, Output, ScenePath
from octoplan.planner.frontends.io.calls import check_complete
from octoplan.planner.frontends.io.mistakes import error_context
from octoplan.planner.frontends.io.records import WorkspaceRecord, record
from octoplan.planner.frontends.io.scene_file import load
from octoplan.planner.frontends.report import figure
from octoplan.planner.frontends.sweeps.store import open_dataset
from octoplan.planner.frontends.workspaces.definition import (
    ACCURACY,
    PROBES,
    SAMPLES,
    workspace_of,
    write_workspace,
)
from octoplan.planner.frontends.workspaces.verdicts import KINDS

_DEFAULT = FileOptions()
_ACCURACY = Parameter(
    validator=Number(gte=1e-12, lte=0.1), help=f"Tip error over arm length ({ACCURACY:g})."
)


def workspace(
    scene: ScenePath,
    /,
    *,
    samples: Annotated[int, Parameter(validator=Number(gte=1))] = SAMPLES,
    probes: Annotated[int, Parameter(validator=Number(gte=0))] = PROBES,
    drawn: bool = False,
    seed: Annotated[int, Parameter(validator=Number(gte=0))] = 0,
    accuracy: Annotated[float, _ACCURACY] = ACCURACY,
    compile: bool = False,  # noqa: A002  (the name of the option)
    jobs: int = 1,
    scheduler: str | None = None,
    options: FileOptions = _DEFAULT,
) -> Output:
    """Find the tips that the arm reaches within the limits of the scene; resume if interrupted.

    --out DIR writes the Dataset, DIR/workspace.nc. A workspace that --time-limit stopped resumes
    with the same command.

    Parameters
    ----------
    samples
        Number of tension sets (500).
    probes
        Number of plans for points in the gaps between tips and beyond the boundary (400).
    drawn
        Keep the drawn tensions of samples; do not plan the least effort for their tips.
    seed
        Seed of the tension sets (0).
    compile
        Compile the equations, see octoplan plan.
    jobs
        Number of processes; -1 is one per processor (1).
    scheduler
        tcp://HOST:PORT of a Dask scheduler, whose workers compute.
    """
    question = load(scene)
    check_complete(question, "limits")
    with error_context(question.name, "limits"):
        wanted = workspace_of(
            question.arm,
            question.scene,
            limits=question.options["limits"],
            samples=samples,
            probes=probes,
            least_effort=not drawn,
            accuracy=accuracy,
            seed=seed,
            compile=compile or question.options["compile"],
            time_limit=question.time_limit,
        )
    with ExitStack() as stack:
        folder = options.out or Path(stack.enter_context(TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / "workspace.nc"
        try:
            with time_limit(options.time_limit):
                is_earlier = write_workspace(wanted, path, jobs=jobs, scheduler=scheduler)
        except OutOfTime:
            kept = "finished chunks are kept: run the command again to compute the others"
            limit = f"the time limit of {options.time_limit:g} s was reached"
            raise OctoplanError(f"{limit}; {kept}" if options.out else limit) from None
        data = stack.enter_context(open_dataset(path)).load()
    tips = data.tip.values[data.settled.values]
    result = record(
        WorkspaceRecord,
        data,
        file=str(path) if options.out else None,
        tip_min_m=tips.min(axis=0).tolist(),
        tip_max_m=tips.max(axis=0).tolist(),
        effort_max_N=float(np.nanmax(data.effort)),
        earlier=is_earlier,
        failures=json.loads(data.attrs["failures"]),
        largest_gap_m=float(data.attrs["largest_gap_m"]),
        **{kind: int(data.attrs[kind]) for kind in KINDS},
    )
    draw = figure("workspace", "plot_workspace")
    return Output(lambda: _text(result), result, "workspace", lambda: draw(data))


def _text(result: WorkspaceRecord) -> str:
    """Return counts, extents, the largest gap, and the reasons of refusals."""
    lines = ["finished by an earlier run, nothing was computed"] * result.earlier
    lines += [f"{result.file}"] * (result.file is not None)
    counts = result.sample, result.probe, result.boundary, result.refused
    lines.append(
        "{} samples, {} probes, {} tips on the boundary, {} points refused".format(*counts)
    )
    rows = [["  tips [mm]", "from", "to"]]
    for axis, low, high in zip("xyz", result.tip_min_m, result.tip_max_m, strict=True):
        rows.append([f"  {axis}", f"{1e3 * low:.1f}", f"{1e3 * high:.1f}"])
    lines += columns(rows)
    lines.append(f"  largest effort {result.effort_max_N:.4g} N")
    lines.append(f"  largest gap that no plan has classified {1e3 * result.largest_gap_m:.1f} mm")
    failures = [f"  {count} x for example: {text}" for text, count in result.failures.items()]
    return "\n".join([*lines, *shortened_lines(failures, 4)])
