"""Who works on a sweep: processes of this machine, by joblib, or a cluster's, by Dask.

Both hand out the same chunks, and yield what is computed as it comes.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any

from model.errors import InputError, OctoplanError, needed
from model.time_limit import end as end_of_limit
from model.time_limit import until
from planner.io.files import versions
from planner.sweeps.definition import Sweep
from planner.sweeps.points import Job, Point, Rows, computed

Computed = Iterator[tuple[int, Rows]]
# Chunks under way for each thread of a cluster, and seconds until it has to have a worker.
_AHEAD, _PATIENCE = 3, 60


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
    left, job, end = dict.fromkeys(chunks), sweep.job, end_of_limit()
    work = (joblib.delayed(_one)(job, chunk, sweep.points(chunk), end) for chunk in list(left))
    alone = {} if jobs == 1 else {"initializer": _end_with, "initargs": (os.getpid(),)}
    pool = joblib.Parallel(jobs, return_as="generator_unordered", batch_size=1, **alone)
    try:
        for chunk, rows in pool(work):
            del left[chunk]
            yield chunk, rows
    except broken:
        raise WorkersLostError(len(left)) from None


def _one(job: Job, chunk: int, points: list[Point], end: float = math.inf) -> tuple[int, Rows]:
    """Return a chunk's number and what is computed at its points; OutOfTime after an end."""
    with until(end):
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
    left, job, same = dict.fromkeys(chunks), sweep.job, versions()
    with _client(scheduler) as client:
        tasks = (
            client.submit(_for_others, same, job, chunk, sweep.points(chunk), pure=False)
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


def _for_others(
    wanted: dict[str, str], job: Job, chunk: int, points: list[Point]
) -> tuple[int, Rows]:
    """As _one, on a machine that has to have the same versions of what computes."""
    if versions() != wanted:
        raise VersionsError(versions(), wanted)
    return _one(job, chunk, points)


def _client(scheduler: str) -> Any:
    distributed = needed("distributed", "cluster")
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
