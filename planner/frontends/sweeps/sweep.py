"""Run a sweep: what is left of its points, by whoever works, gathered in a Dataset."""

from __future__ import annotations

import logging
import math
import os
import shutil
import signal
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from itertools import islice
from multiprocessing import resource_tracker
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from octoplan.model.arm import Arm
from octoplan.model.support.checks import kind, positive
from octoplan.model.support.errors import InputError, OctoplanError, needed
from octoplan.model.support.progress import check_time, report, with_progress
from octoplan.model.support.progress import end as end_of_limit
from octoplan.model.support.progress import time_limit as within
from octoplan.planner.frontends.io.files import path_of, versions
from octoplan.planner.frontends.sweeps.definition import Sweep, load_sweep, sweep_of
from octoplan.planner.frontends.sweeps.points import Job, Point, Rows, computed
from octoplan.planner.frontends.sweeps.store import (
    ChunkFiles,
    attributes_in,
    check_store,
    folder_of,
    gathered,
    in_order,
    opened,
    save,
)

Computed = Iterator[tuple[int, Rows]]
# Chunks under way for each thread of a cluster, and seconds until it has to have a worker.
_AHEAD, _PATIENCE = 3, 60
# What is told of locks and folders that a process which was ended has left, once they are removed.
_TIDIED = "ignore::UserWarning:joblib.externals.loky.backend.resource_tracker"


class WorkersLostError(OctoplanError):
    """Workers were killed, or the scheduler of a cluster was.

    Attributes
    ----------
    left : int
        How many chunks of points are not finished.
    """

    def __init__(self, left: int) -> None:
        self.left = left
        super().__init__(
            f"workers were killed, by hand or for lack of memory, or their scheduler was; {left} "
            "chunks of points are left; what is finished is kept where the sweep has an output: "
            "start it again, and it goes on"
        )


class VersionsError(OctoplanError):
    """A worker computes with other versions, whose digits may be others.

    Attributes
    ----------
    own, wanted : dict of str
        Versions of the worker, and of whoever asks.
    """

    def __init__(self, entries: dict[str, str], wanted: dict[str, str]) -> None:
        self.own, self.wanted = entries, wanted
        super().__init__(
            f"a worker of the cluster has {entries}, this process {wanted}; install alike"
        )


def on_machine(sweep: Sweep, chunks: Iterable[int], jobs: int) -> Computed:
    """Yield what processes of this machine compute; in this one for one job. WorkersLostError."""
    joblib = needed("joblib", "sweep")
    broken = needed("joblib.externals.loky.process_executor", "sweep").BrokenProcessPool
    left, more = dict.fromkeys(chunks), (end_of_limit(), versions())
    one = joblib.delayed(_one)
    work = (one(sweep.job, chunk, sweep.points(chunk), *more) for chunk in list(left))
    alone = {} if jobs == 1 else {"initializer": _end_with, "initargs": (os.getpid(),)}
    pool = joblib.Parallel(jobs, return_as="generator_unordered", batch_size=1, **alone)
    try:
        with _undisturbed():
            results = pool(work)
        for chunk, rows in results:
            del left[chunk]
            yield chunk, rows
    except broken:
        raise WorkersLostError(len(left)) from None


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Let processes that begin inside the block never hear Ctrl-C, as terminals send it to all.

    This process hears it after the block. Its workers end with it, and have nothing to say; nor has
    joblib's process that tidies up after them.
    """
    own = os.environ.get("PYTHONWARNINGS", "")
    quiet = patch.dict(os.environ, PYTHONWARNINGS=f"{own},{_TIDIED}".removeprefix(","))
    with quiet, ExitStack() as stack:
        if hasattr(signal, "pthread_sigmask"):
            # Which would let signals through once it has begun.
            resource_tracker.ensure_running()
            before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            stack.callback(signal.pthread_sigmask, signal.SIG_SETMASK, before)
        yield


def _one(
    job: Job, chunk: int, points: list[Point], end: float, wanted: dict[str, str]
) -> tuple[int, Rows]:
    """Return a chunk's number and what is computed at its points; OutOfTime after an end.

    Raises VersionsError where others compute than who asks has.
    """
    if versions() != wanted:
        raise VersionsError(versions(), wanted)
    with within(end - time.monotonic()):
        return chunk, computed(job, points)


def _end_with(parent: int) -> None:
    """Watch, from now on, whether this process was left alone by one that was killed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def on_cluster(sweep: Sweep, chunks: Iterable[int], scheduler: str) -> Computed:
    """Yield what the workers of a Dask cluster compute, few chunks being under way at a time.

    Not by joblib's backend for Dask, which waits forever once workers are lost. The cluster hands
    out again what a worker had that dies. Raises InputError where there is no scheduler, or none of
    its workers comes; WorkersLostError where the scheduler goes, or a chunk kills its workers again
    and again; VersionsError.
    """
    distributed = needed("distributed", "cluster")
    left, more = dict.fromkeys(chunks), (math.inf, versions())
    with _client(scheduler) as client:
        tasks = (
            client.submit(_one, sweep.job, chunk, sweep.points(chunk), *more, pure=False)
            for chunk in list(left)
        )
        first = islice(tasks, _AHEAD * sum(client.nthreads().values()))
        running = distributed.as_completed(first, loop=client.loop)
        try:
            for task in running:
                chunk, rows = task.result()
                task.release()
                del left[chunk]
                running.update(islice(tasks, 1))
                yield chunk, rows
        except (distributed.KilledWorker, distributed.CancelledError, OSError):
            raise WorkersLostError(len(left)) from None


def _client(scheduler: str) -> Any:
    distributed = needed("distributed", "cluster")
    kind("scheduler", scheduler, str, "the address of a running scheduler, tcp://HOST:PORT")
    try:
        client = distributed.Client(scheduler, set_as_default=False)
    except (OSError, ValueError) as reason:
        allowed = f"the address of a running scheduler, tcp://HOST:PORT: {reason}"
        raise InputError("scheduler", scheduler, allowed) from None
    try:
        client.wait_for_workers(1, timeout=_PATIENCE)
    except TimeoutError:
        client.close()
        raise InputError("scheduler", scheduler, "a scheduler that has workers") from None
    return client


# A sweep

_log = logging.getLogger("octoplan.planner.frontends.sweeps")


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
    octoplan.planner.frontends.sweeps). A point that fails is a row whose `outcome` says why, its
    numbers nan.

    Parameters
    ----------
    request : path or Arm
        The sweep file, see octoplan.planner.frontends.sweeps.definition; or an arm, with `axes` and
        what follows.
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
        out = path_of(out, "out")
        _, is_earlier = written(wanted, out, jobs=jobs, scheduler=scheduler)
        if is_earlier:
            _log.info("%s holds this sweep already; it is not run again", out)
        return opened(out)
    _check(jobs)
    with (
        TemporaryDirectory() as name,
        _computed(wanted, Path(name) / "chunks", jobs, scheduler) as data,
    ):
        return data.load()


def written(
    wanted: Sweep, out: str | Path, *, jobs: int = 1, scheduler: str | None = None
) -> tuple[dict[str, Any], bool]:
    """Write what a sweep computes; return the Dataset's attributes, and whether it was there."""
    path = Path(out)
    _check(jobs)
    check_store(path)
    attributes = attributes_in(path)
    is_earlier = attributes.get("identity") == wanted.identity
    if not is_earlier:
        with _computed(wanted, folder_of(path), jobs, scheduler) as data:
            save(data, path)
        attributes = data.attrs
    shutil.rmtree(folder_of(path), ignore_errors=True)
    return attributes, is_earlier


def _check(jobs: int) -> None:
    """Tell whatever hinders a sweep before anything runs."""
    for package in ("xarray", "dask"):
        needed(package, "sweep")
    if isinstance(jobs, bool) or not isinstance(jobs, int) or (jobs < 1 and jobs != -1):
        raise InputError("jobs", jobs, "a whole number from 1, or -1 for all processors")


@contextmanager
def _computed(wanted: Sweep, folder: Path, jobs: int, scheduler: str | None) -> Iterator[Any]:
    """Yield the Dataset of a sweep, to be read in the block, once what is left of it is computed.

    Each chunk is kept in a folder as it comes.
    """
    chunks = ChunkFiles(folder, wanted)
    left = chunks.left
    results: Computed = iter(())
    if left and scheduler is not None:
        results = on_cluster(wanted, left, scheduler)
    elif left:
        results = on_machine(wanted, left, jobs)
    for done, (chunk, rows) in enumerate(results, start=wanted.chunks - len(left) + 1):
        chunks.write(chunk, rows)
        check_time()
        report("points", done * wanted.size // wanted.chunks, wanted.size)
    with in_order():
        yield gathered(wanted, chunks)
