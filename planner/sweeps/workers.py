"""Who works on a sweep: this process, processes of this machine, or a cluster.

All hand out the same chunks, and yield what is found as it comes. Workers that are killed lose the
chunks in their hands; these are handed out again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any

from model.errors import InputError, OctoplanError
from planner.extras import needed
from planner.sweeps.file import Sweep
from planner.sweeps.points import Job, Point, run
from planner.sweeps.variables import Rows

Found = Iterator[tuple[int, Rows]]
_TRIES = 3
_AHEAD = 3
_PATIENCE = 60


class WorkersLostError(OctoplanError):
    """Workers were killed again and again, with nothing finished between.

    Attributes
    ----------
    left : int
        How many chunks of points are not finished.
    """

    def __init__(self, left: int) -> None:
        self.left = left
        super().__init__(
            f"workers were killed {_TRIES} times in a row, {left} chunks of points are left; "
            "what is finished is kept, start the sweep again with fewer jobs or more memory"
        )

    def __reduce__(self) -> tuple[type, tuple[int]]:
        return type(self), (self.left,)


def _one(job: Job, chunk: int, points: list[Point]) -> tuple[int, Rows]:
    return chunk, run(job, points)


def here(sweep: Sweep, chunks: Iterable[int]) -> Found:
    """Yield what is found at chunks in this process, in order."""
    return (_one(sweep.job, chunk, sweep.points(chunk)) for chunk in chunks)


def on_machine(sweep: Sweep, chunks: Iterable[int], jobs: int) -> Found:
    """Yield what is found at chunks by processes of this machine; WorkersLostError."""
    joblib = needed("joblib", "sweep")
    broken = needed("joblib.externals.loky.process_executor", "sweep").BrokenProcessPool
    left, losses = dict.fromkeys(chunks), 0
    while left:
        work = (joblib.delayed(_one)(sweep.job, c, sweep.points(c)) for c in list(left))
        pool = joblib.Parallel(jobs, return_as="generator_unordered", batch_size=1)
        try:
            for chunk, rows in pool(work):
                del left[chunk]
                losses = 0
                yield chunk, rows
        except broken:
            losses += 1
            if losses == _TRIES:
                raise WorkersLostError(len(left)) from None


def on_cluster(sweep: Sweep, chunks: Iterable[int], scheduler: str) -> Found:
    """Yield what is found at chunks by the workers of a Dask cluster.

    Few chunks are under way at a time. Raises InputError where there is no scheduler, or none of
    its workers comes; WorkersLostError.
    """
    distributed = needed("distributed", "cluster")
    left = dict.fromkeys(chunks)
    waiting = iter(list(left))
    with _client(scheduler) as client:
        threads = sum(w["nthreads"] for w in client.scheduler_info(-1)["workers"].values())
        tasks = (client.submit(_one, sweep.job, c, sweep.points(c), pure=False) for c in waiting)
        running = distributed.as_completed(islice(tasks, _AHEAD * threads))
        for task in running:
            try:
                chunk, rows = task.result()
            except distributed.KilledWorker:
                raise WorkersLostError(len(left)) from None
            task.release()
            del left[chunk]
            yield chunk, rows
            for following in islice(tasks, 1):
                running.add(following)


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
