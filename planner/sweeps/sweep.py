"""Run a sweep: what is left of its points, by whoever works, gathered in a Dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from model.errors import InputError
from model.progress import tell
from planner.extras import needed
from planner.sweeps.cluster import on_cluster
from planner.sweeps.dataset import dataset, saver
from planner.sweeps.file import Sweep, load_sweep
from planner.sweeps.journal import Journal
from planner.sweeps.variables import Rows, blank
from planner.sweeps.workers import Found, here, on_machine


def sweep(
    file: str | Path,
    out: str | Path | None = None,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
) -> Any:
    """Return what a sweep file asks for, as an xarray Dataset.

    The numbers do not depend on how many work on them, nor on interruptions. A sweep that was
    killed goes on where it was when it is started again: what is finished is kept in a journal
    beside `out`, which is removed when `out` is written. A point that fails is a row whose
    `outcome` says why, its numbers nan.

    Parameters
    ----------
    file : path
        The sweep file, see planner.sweeps.tables.
    out : path
        Where to write the Dataset, .nc or .zarr; without, it is returned alone and no journal kept.
    jobs : int
        How many processes of this machine work on it; -1 is one for each processor.
    scheduler : str
        Address of a Dask scheduler, "tcp://HOST:PORT", whose workers work on it in place of those.

    Raises
    ------
    FileError
        For what the sweep file or its scene must not have, before anything runs.
    InputError
        For arguments that are not allowed, and a journal of another sweep.
    MissingExtraError
        Naming the command that installs what is missing.
    WorkersLostError
        If workers are killed again and again; what is finished is kept.
    VersionsError
        If a worker of the cluster has other versions of what computes.
    """
    asked = load_sweep(file)
    needed("xarray", "sweep")
    if isinstance(jobs, bool) or not isinstance(jobs, int) or (jobs < 1 and jobs != -1):
        raise InputError("jobs", jobs, "a whole number from 1, or -1 for all processors")
    if out is None:
        return dataset(asked, _gathered(asked, None, jobs, scheduler))
    path = Path(out)
    save = saver(path)
    with Journal(journal_of(path), asked.identity) as journal:
        data = dataset(asked, _gathered(asked, journal, jobs, scheduler))
        save(data)
        journal.remove()
    return data


def journal_of(out: Path) -> Path:
    """Return where the journal of a sweep is that is to be written to a path."""
    return out.with_name(f"{out.name}.journal")


def _gathered(asked: Sweep, journal: Journal | None, jobs: int, scheduler: str | None) -> Rows:
    """Return the rows of all points: those in the journal, and the others found now."""
    rows = blank(asked.job.compute, asked.job.tendons, asked.size)
    done = np.zeros(asked.chunks, dtype=bool)
    for chunk, found in journal.done(rows) if journal else ():
        rows.put(chunk * asked.chunk, found)
        done[chunk] = True
    for chunk, found in _found(asked, np.flatnonzero(~done).tolist(), jobs, scheduler):
        if journal:
            journal.add(chunk, found)
        rows.put(chunk * asked.chunk, found)
        done[chunk] = True
        tell("points", min(int(done.sum()) * asked.chunk, asked.size), asked.size)
    return rows


def _found(asked: Sweep, left: list[int], jobs: int, scheduler: str | None) -> Found:
    if not left:
        return iter(())
    if scheduler is not None:
        return on_cluster(asked, left, scheduler)
    return here(asked, left) if jobs == 1 else on_machine(asked, left, jobs)
