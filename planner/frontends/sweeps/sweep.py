"""Run a sweep: compute the missing chunks, in parallel, and gather all chunks in a Dataset."""

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
from octoplan.model.support.checks import kind, positive, whole
from octoplan.model.support.errors import Described, InputError, OctoplanError, needed
from octoplan.model.support.progress import check_time, report, with_progress
from octoplan.model.support.progress import end as end_of_limit
from octoplan.model.support.progress import time_limit as within
from octoplan.planner.frontends.io.files import path_of, versions
from octoplan.planner.frontends.sweeps.definition import Sweep, load_sweep, sweep_of
from octoplan.planner.frontends.sweeps.store import (
    ChunkFiles,
    attributes_in,
    check_store,
    folder_of,
    gather,
    open_dataset,
    save,
    sequential_dask,
)
from octoplan.planner.frontends.sweeps.work import Point, PointJob, Rows, Work

Computed = Iterator[tuple[int, Rows]]
# Chunks in progress per thread of a cluster.
_AHEAD = 3
# Time within which a cluster must have a worker [s].
_PATIENCE = 60
# Filter for joblib's warnings about resources of killed processes, which joblib then removes.
_TIDIED = "ignore::UserWarning:joblib.externals.loky.backend.resource_tracker"


class WorkersLostError(OctoplanError):
    """Workers or the scheduler of a cluster were killed.

    Attributes
    ----------
    left : int
        Number of unfinished chunks.
    """

    def __init__(self, left: int) -> None:
        self.left = left
        super().__init__(
            "workers were killed, for lack of memory or by a user, or the scheduler stopped; "
            f"{left} chunks of points are missing. Finished chunks are kept if the sweep has an "
            "output: run the sweep again to compute the others"
        )


class VersionsError(OctoplanError):
    """A worker has other versions of the libraries, which may give other digits.

    Attributes
    ----------
    own, wanted : dict of str
        Versions of the worker and of the calling process.
    """

    def __init__(self, own: dict[str, str], wanted: dict[str, str]) -> None:
        self.own = own
        self.wanted = wanted
        super().__init__(
            f"a worker of the cluster has {own}, this process {wanted}; install the same versions"
        )


def run_locally(work: Work, chunks: Iterable[int], jobs: int) -> Computed:
    """Yield results of processes of this machine; of this process if jobs = 1. WorkersLostError."""
    joblib = needed("joblib", "sweep")
    broken = needed("joblib.externals.loky.process_executor", "sweep").BrokenProcessPool
    left = dict.fromkeys(chunks)
    end = end_of_limit()
    wanted = versions()
    one = joblib.delayed(_run_chunk)
    tasks = (one(work.job, chunk, work.points(chunk), end, wanted) for chunk in list(left))
    alone = {} if jobs == 1 else {"initializer": _end_with, "initargs": (os.getpid(),)}
    pool = joblib.Parallel(jobs, return_as="generator_unordered", batch_size=1, **alone)
    try:
        with _sigint_blocked():
            results = pool(tasks)
        for chunk, rows in results:
            del left[chunk]
            yield chunk, rows
    except broken:
        raise WorkersLostError(len(left)) from None


@contextmanager
def _sigint_blocked() -> Iterator[None]:
    """Block SIGINT for processes that start inside the block; terminals send Ctrl-C to all.

    This process receives the signal after the block. Workers and joblib's resource tracker end with
    this process, without a message.
    """
    own = os.environ.get("PYTHONWARNINGS", "")
    quiet = patch.dict(os.environ, PYTHONWARNINGS=f"{own},{_TIDIED}".removeprefix(","))
    with quiet, ExitStack() as stack:
        if hasattr(signal, "pthread_sigmask"):
            # Started later, the resource tracker would unblock the signal.
            resource_tracker.ensure_running()
            before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            stack.callback(signal.pthread_sigmask, signal.SIG_SETMASK, before)
        yield


def _run_chunk(
    job: PointJob, chunk: int, points: list[Point], end: float, wanted: dict[str, str]
) -> tuple[int, Rows]:
    """Return the number of a chunk and the results; raise OutOfTime at the time `end`.

    Raises VersionsError if the versions differ from the calling process.
    """
    if versions() != wanted:
        raise VersionsError(versions(), wanted)
    with within(end - time.monotonic()):
        return chunk, job.rows(points)


def _end_with(parent: int) -> None:
    """End this process when the parent process has ended."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def run_on_cluster(work: Work, chunks: Iterable[int], scheduler: str) -> Computed:
    """Yield results of the workers of a Dask cluster; a limited number of chunks is in progress.

    Joblib's backend for Dask is not used, which waits forever for lost workers. The cluster
    reassigns the chunks of a worker that dies. Raises InputError without a scheduler or workers,
    WorkersLostError if the scheduler stops or a chunk kills workers repeatedly, VersionsError.
    """
    distributed = needed("distributed", "cluster")
    left = dict.fromkeys(chunks)
    wanted = versions()
    with _client(scheduler) as client:
        tasks = (
            client.submit(
                _run_chunk, work.job, chunk, work.points(chunk), math.inf, wanted, pure=False
            )
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
    """Return results at many values of a scene, as an xarray Dataset.

    Results do not depend on the number of workers or on interruptions. Each finished chunk of
    points is a file in the folder OUT.chunks beside `out`; an interrupted sweep computes the
    missing chunks when started again, and the folder is removed when `out` is written. If `out`
    contains this sweep already, the file is opened and nothing is computed; the log has a message
    (logger octoplan.planner.frontends.sweeps). A point that fails has numbers nan, and the error as
    `outcome`.

    Parameters
    ----------
    request : path or Arm
        The sweep file, see octoplan.planner.frontends.sweeps.definition; or an arm, with `axes` and
        further keyword arguments.
    out : path
        File of the Dataset, .nc or .zarr. Memory then does not grow with the number of points, and
        the returned Dataset reads numbers from this file on demand. By default, all results are
        in memory, and lost by an interruption.
    jobs : int
        Number of processes of this machine; -1 is one per processor.
    scheduler : str
        Address of a Dask scheduler, "tcp://HOST:PORT", whose workers replace these processes.
    axes : mapping
        With an Arm: values by key of a scene file, in the unit of the key; or the contents of a
        [[sweep.axes]] table, such as {"distribution": "uniform", "low": 80, "high": 120}.
    time_limit : float
        Limit for each point [s], in place of `time_limit_s` of the scene. A plan that reaches the
        limit is the best so far; other points fail.
    progress : bool
        Whether to show a progress line; by default after two seconds, on terminals and in
        notebooks.
    **others
        With an Arm: `scene`, `target` (one or several), `tensions` [N], `tension_max` [N];
        `compute`, by default "plan" with a target and "settle" without, or "stiffness"; `draws`,
        `seed`; and further keys of scene files, such as accuracy, limits={...} or stiffness={...}.

    Raises
    ------
    FileError
        If an entry of the sweep or its scene is invalid, before anything is computed.
    InputError
        For invalid arguments, or if OUT.chunks contains chunks of another sweep.
    MissingExtraError
        If a package is missing; the message has the install command.
    WorkersLostError
        If workers are killed; finished chunks are kept beside `out`.
    VersionsError
        If a worker of the cluster has other versions of the libraries.
    FullDiskError
        If a file cannot be written; finished chunks are kept.
    """
    seconds = None if time_limit is None else positive("time_limit", time_limit)
    if isinstance(request, Arm):
        wanted = sweep_of(request, axes, **others, time_limit=seconds)
    elif axes is not None or others:
        surplus = ", ".join([*(["axes"] if axes is not None else []), *others])
        raise InputError(surplus, Described("given"), "omitted with a sweep file")
    else:
        wanted = load_sweep(request, seconds)
    if out is not None:
        out = path_of(out, "out")
        _, is_earlier = write_sweep(wanted, out, jobs=jobs, scheduler=scheduler)
        if is_earlier:
            _log.info("%s contains this sweep already; nothing is computed", out)
        return open_dataset(out)
    check_jobs(jobs)
    with (
        TemporaryDirectory() as name,
        _computed(wanted, Path(name) / "chunks", jobs, scheduler) as data,
    ):
        return data.load()


def write_sweep(
    wanted: Sweep, out: str | Path, *, jobs: int = 1, scheduler: str | None = None
) -> tuple[dict[str, Any], bool]:
    """Write the results of a sweep; return the attributes, and whether the file existed."""
    path = Path(out)
    check_jobs(jobs)
    check_store(path)
    attributes = attributes_in(path)
    is_earlier = attributes.get("identity") == wanted.identity
    if not is_earlier:
        with _computed(wanted, folder_of(path), jobs, scheduler) as data:
            save(data, path)
        attributes = data.attrs
    shutil.rmtree(folder_of(path), ignore_errors=True)
    return attributes, is_earlier


def check_jobs(jobs: int) -> None:
    """Raise MissingExtraError or InputError before anything is computed."""
    for package in ("xarray", "dask"):
        needed(package, "sweep")
    if jobs != -1:
        whole("jobs", jobs, 1)


@contextmanager
def _computed(wanted: Sweep, folder: Path, jobs: int, scheduler: str | None) -> Iterator[Any]:
    """Compute the missing chunks of a sweep, then yield the Dataset for use inside the block."""
    chunks = compute_chunks(wanted, folder, jobs, scheduler)
    with sequential_dask():
        yield gather(wanted, chunks)


def compute_chunks(
    work: Work, folder: Path, jobs: int, scheduler: str | None, phase: str = "points"
) -> ChunkFiles:
    """Compute the missing chunks of some work; write each to a folder when finished.

    `phase` names the points in reports of progress. Raises the errors of `sweep`.
    """
    chunks = ChunkFiles(folder, work)
    left = chunks.left
    results: Computed = iter(())
    if left and scheduler is not None:
        results = run_on_cluster(work, left, scheduler)
    elif left:
        results = run_locally(work, left, jobs)
    for done, (chunk, rows) in enumerate(results, start=work.chunks - len(left) + 1):
        chunks.write(chunk, rows)
        check_time()
        report(phase, done * work.size // work.chunks, work.size)
    return chunks
