"""Run a sweep: what is left of its points, by whoever works, gathered in a Dataset."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from model.arm import Arm
from model.checks import positive
from model.errors import InputError, needed
from model.progress import tell, with_progress
from model.time_limit import check_time
from planner.sweeps.definition import Sweep, load_sweep, sweep_of
from planner.sweeps.store import (
    ChunkFiles,
    ChunksInMemory,
    attributes_in,
    check_store,
    folder_of,
    gathered,
    in_order,
    opened,
    save,
)
from planner.sweeps.workers import on_cluster, on_machine

_log = logging.getLogger("planner.sweeps")


@with_progress
def sweep(
    request: str | Path | Arm,
    out: str | Path | None = None,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    axes: Mapping[str, Any] | None = None,
    time_limit: float | None = None,
    progress: bool | None = None,
    **others: Any,
) -> Any:
    """Return what is asked for at many values of a scene, as an xarray Dataset.

    The numbers do not depend on how many work on them, nor on interruptions. A sweep that was
    killed goes on where it was when it is started again: each chunk of points that is finished is a
    file in the folder OUT.chunks beside `out`, which is removed when `out` is written. Where `out`
    holds this same sweep already, nothing is run: it is opened, and the log says so (logger
    planner.sweeps). A point that fails is a row whose `outcome` says why, its numbers nan.

    Parameters
    ----------
    request : path or Arm
        The sweep file, see planner.sweeps.definition; or an arm, with `axes` and what follows.
    out : path
        Where to write the Dataset, .nc or .zarr. Memory does not grow with the number of points
        then, and what is returned reads its numbers from there when they are looked at. Without,
        all is held in memory, and nothing is kept of a sweep that is killed.
    jobs : int
        How many processes of this machine work on it; -1 is one for each processor.
    scheduler : str
        Address of a Dask scheduler, "tcp://HOST:PORT", whose workers work on it in place of those.
    axes : mapping
        With an Arm: by the key that the value has in a scene file, in its unit, the values; or what
        a [[sweep.axes]] table holds, such as {"distribution": "uniform", "low": 80, "high": 120}.
    time_limit : float
        Of each point [s], in place of the scene's `time_limit_s`: the best plan by then, else a
        point that failed.
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
        For arguments that are not allowed, and where chunks of another sweep are in the way.
    MissingExtraError
        Naming the command that installs what is missing.
    WorkersLostError
        If workers are killed; what is finished is kept beside `out`.
    VersionsError
        If a worker of the cluster has other versions of what computes.
    FullDiskError
        If something cannot be written; what is finished is kept.
    """
    seconds = None if time_limit is None else positive("time_limit", time_limit)
    if isinstance(request, Arm):
        wanted = sweep_of(request, axes, **others, time_limit=seconds)
    elif axes is not None or others:
        surplus = ", ".join([*(["axes"] if axes is not None else []), *others])
        raise InputError(surplus, "given beside a sweep file", "with an Arm in place of the file")
    else:
        wanted = load_sweep(request, seconds)
    if out is not None:
        _, is_earlier = written(wanted, out, jobs=jobs, scheduler=scheduler)
        if is_earlier:
            _log.info("%s holds this sweep already; it is not run again", out)
        return opened(Path(out))
    _check(jobs)
    chunks = ChunksInMemory()
    _compute(wanted, list(range(wanted.chunks)), chunks, jobs, scheduler)
    with in_order():
        return gathered(wanted, chunks.read).load()


def written(
    wanted: Sweep, out: str | Path, *, jobs: int = 1, scheduler: str | None = None
) -> tuple[dict[str, Any], bool]:
    """Write what a sweep computes; return the Dataset's attributes, and whether it was there."""
    path = Path(out)
    _check(jobs)
    check_store(path)
    attributes = attributes_in(path)
    is_earlier = attributes.get("identity") == wanted.identity
    chunks = ChunkFiles(folder_of(path), wanted)
    if not is_earlier:
        _compute(wanted, chunks.left, chunks, jobs, scheduler)
        data = gathered(wanted, chunks.read)
        attributes = data.attrs
        save(data, path)
    chunks.remove()
    return attributes, is_earlier


def _check(jobs: int) -> None:
    """Tell whatever hinders a sweep before anything runs."""
    for package in ("xarray", "dask"):
        needed(package, "sweep")
    if isinstance(jobs, bool) or not isinstance(jobs, int) or (jobs < 1 and jobs != -1):
        raise InputError("jobs", jobs, "a whole number from 1, or -1 for all processors")


def _compute(
    wanted: Sweep,
    left: list[int],
    chunks: ChunkFiles | ChunksInMemory,
    jobs: int,
    scheduler: str | None,
) -> None:
    """Compute the chunks that are left, by whoever works, and keep each as it comes."""
    if not left:
        return
    if scheduler is not None:
        computed = on_cluster(wanted, left, scheduler)
    else:
        computed = on_machine(wanted, left, jobs)
    for done, (chunk, rows) in enumerate(computed, start=wanted.chunks - len(left) + 1):
        chunks.write(chunk, rows)
        check_time()
        tell("points", done * wanted.size // wanted.chunks, wanted.size)
