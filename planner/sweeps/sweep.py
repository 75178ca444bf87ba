"""Run a sweep: what is left of its points, by whoever works, gathered in a Dataset."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from model.arm import Arm
from model.errors import InputError
from model.extras import needed
from model.progress import tell, with_progress
from model.time_limit import check_time
from planner.sweeps.cluster import on_cluster
from planner.sweeps.dataset import dataset
from planner.sweeps.definition import Sweep
from planner.sweeps.file import load_sweep, sweep_of
from planner.sweeps.journal import Journal
from planner.sweeps.objects import sweep_table
from planner.sweeps.store import check_store, identity_in, opened, save, summary_in
from planner.sweeps.summary import Summary
from planner.sweeps.variables import blank
from planner.sweeps.workers import Found, here, on_machine

_log = logging.getLogger("planner.sweeps")


@with_progress
def sweep(
    asked: str | Path | Arm,
    out: str | Path | None = None,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    axes: Mapping[str, Any] | None = None,
    progress: bool | None = None,
    **others: Any,
) -> Any:
    """Return what is asked for at many values of a scene, as an xarray Dataset.

    The numbers do not depend on how many work on them, nor on interruptions. A sweep that was
    killed goes on where it was when it is started again: what is finished is kept in a journal
    beside `out`, which is removed when `out` is written. Where `out` holds this same sweep already,
    nothing is run: it is opened, and the log says so (logger planner.sweeps). A point that fails is
    a row whose `outcome` says why, its numbers nan.

    Parameters
    ----------
    asked : path or Arm
        The sweep file, see planner.sweeps.tables; or an arm, with `axes` and what follows.
    out : path
        Where to write the Dataset, .nc or .zarr. Memory does not grow with the number of points
        then, and what is returned reads its numbers from there when they are looked at. Without,
        all is held in memory, and no journal kept.
    jobs : int
        How many processes of this machine work on it; -1 is one for each processor.
    scheduler : str
        Address of a Dask scheduler, "tcp://HOST:PORT", whose workers work on it in place of those.
    axes : mapping
        With an Arm: by the key that the value has in a scene file, in its unit, the values; or what
        a [[sweep.axes]] table holds, such as {"distribution": "uniform", "low": 80, "high": 120}.
    progress : bool
        Whether a line tells how far it is: unless given, after two seconds, on terminals and in
        notebooks.
    **others
        With an Arm: `scene`, `target` (one or several), `tensions` [N], `tension_max` [N];
        `compute`, "plan" with a target and else "settle", or "stiffness"; `draws`, `seed`; and
        further keys of scene files, such as accuracy, limits={...} or stiffness={...}.

    Raises
    ------
    FileError
        For what the sweep or its scene must not have, before anything runs.
    InputError
        For arguments that are not allowed, and a journal of another sweep.
    MissingExtraError
        Naming the command that installs what is missing.
    WorkersLostError
        If workers are killed again and again; what is finished is kept.
    VersionsError
        If a worker of the cluster has other versions of what computes.
    """
    if isinstance(asked, Arm):
        wanted = sweep_of(sweep_table(asked, axes, **others))
    elif axes is not None or others:
        given = ", ".join([*(["axes"] if axes is not None else []), *others])
        raise InputError(given, "given beside a sweep file", "with an Arm in place of the file")
    else:
        wanted = load_sweep(asked)
    _check(jobs)
    if out is not None:
        found = written(wanted, out, jobs=jobs, scheduler=scheduler)
        if found.earlier:
            _log.info("%s holds this sweep already; it is not run again", out)
        return opened(Path(out))
    rows = blank(wanted.job.compute, wanted.job.tendons, wanted.size)
    for chunk, part in _found(wanted, list(range(wanted.chunks)), jobs, scheduler):
        rows.put(chunk * wanted.chunk, part)
    return dataset(wanted, rows)


@dataclass(frozen=True)
class Written:
    """What became of a sweep's points, and whether an earlier run had found and written them."""

    summary: Summary
    earlier: bool


def written(
    asked: Sweep, out: str | Path, *, jobs: int = 1, scheduler: str | None = None
) -> Written:
    """Write what a sweep asks for, unless it is there already."""
    path = Path(out)
    _check(jobs)
    check_store(path)
    if not journal_of(path).exists() and identity_in(path) == asked.identity:
        return Written(summary_in(path, asked), True)
    like = blank(asked.job.compute, asked.job.tendons, 0)
    with Journal(journal_of(path), asked.identity, asked.chunks, like) as journal:
        for chunk, rows in _found(asked, journal.left, jobs, scheduler):
            journal.add(chunk, rows)
        summary = save(asked, journal, path)
        journal.remove()
    return Written(summary, False)


def _check(jobs: int) -> None:
    """Tell whatever hinders a sweep before anything runs."""
    needed("xarray", "sweep")
    if isinstance(jobs, bool) or not isinstance(jobs, int) or (jobs < 1 and jobs != -1):
        raise InputError("jobs", jobs, "a whole number from 1, or -1 for all processors")


def journal_of(out: Path) -> Path:
    """Return where the journal of a sweep is that is to be written to a path."""
    return out.with_name(f"{out.name}.journal")


def _found(asked: Sweep, left: list[int], jobs: int, scheduler: str | None) -> Found:
    """Yield what is found at chunks by whoever works, and tell how far they are."""
    done = asked.chunks - len(left)
    for chunk, rows in _working(asked, left, jobs, scheduler):
        done += 1
        yield chunk, rows
        check_time()
        tell("points", min(done * asked.chunk, asked.size), asked.size)


def _working(asked: Sweep, left: list[int], jobs: int, scheduler: str | None) -> Found:
    if not left:
        return iter(())
    if scheduler is not None:
        return on_cluster(asked, left, scheduler)
    return here(asked, left) if jobs == 1 else on_machine(asked, left, jobs)
