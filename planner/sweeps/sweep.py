"""Run a sweep: what is left of its points, by whoever works, gathered in a Dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from model.errors import InputError
from model.progress import tell
from model.time_limit import check_time
from planner.extras import needed
from planner.sweeps.asked import Sweep
from planner.sweeps.cluster import on_cluster
from planner.sweeps.dataset import dataset
from planner.sweeps.file import load_sweep
from planner.sweeps.journal import Journal
from planner.sweeps.store import check_store, opened, save
from planner.sweeps.tally import Tally
from planner.sweeps.variables import blank
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
        Where to write the Dataset, .nc or .zarr. Memory does not grow with the number of points
        then, and what is returned reads its numbers from there when they are looked at. Without,
        all is held in memory, and no journal kept.
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
    if out is not None:
        written(file, out, jobs=jobs, scheduler=scheduler)
        return opened(Path(out))
    asked = _checked(file, jobs)
    rows = blank(asked.job.compute, asked.job.tendons, asked.size)
    for chunk, found in _found(asked, list(range(asked.chunks)), jobs, scheduler):
        rows.put(chunk * asked.chunk, found)
    return dataset(asked, rows)


def written(
    file: str | Path, out: str | Path, *, jobs: int = 1, scheduler: str | None = None
) -> tuple[Sweep, Tally]:
    """As sweep, but return what was asked and what became of its points."""
    asked, path = _checked(file, jobs), Path(out)
    check_store(path)
    like = blank(asked.job.compute, asked.job.tendons, 0)
    with Journal(journal_of(path), asked.identity, asked.chunks, like) as journal:
        for chunk, rows in _found(asked, journal.left, jobs, scheduler):
            journal.add(chunk, rows)
        tally = save(asked, journal, path)
        journal.remove()
    return asked, tally


def _checked(file: str | Path, jobs: int) -> Sweep:
    """Return what a sweep file asks; whatever hinders it is told before anything runs."""
    asked = load_sweep(file)
    needed("xarray", "sweep")
    if isinstance(jobs, bool) or not isinstance(jobs, int) or (jobs < 1 and jobs != -1):
        raise InputError("jobs", jobs, "a whole number from 1, or -1 for all processors")
    return asked


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
