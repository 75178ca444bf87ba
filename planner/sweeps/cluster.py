"""The workers of a Dask cluster at work on a sweep."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from typing import Any

from model.errors import InputError, OctoplanError
from planner.extras import needed
from planner.files import versions
from planner.sweeps.file import Sweep
from planner.sweeps.points import Job, Point
from planner.sweeps.variables import Rows
from planner.sweeps.workers import Found, WorkersLostError, one

# Chunks under way for each thread of the cluster, and seconds until it has to have a worker.
_AHEAD, _PATIENCE = 3, 60


class VersionsError(OctoplanError):
    """A worker computes with other versions, whose digits may be others.

    Attributes
    ----------
    own, wanted : dict of str
        Versions of the worker, and of whoever asks.
    """

    def __init__(self, own: dict[str, str], wanted: dict[str, str]) -> None:
        self.own, self.wanted = own, wanted
        super().__init__(f"a worker of the cluster has {own}, this process {wanted}; install alike")

    def __reduce__(self) -> tuple[type, tuple[dict[str, str], dict[str, str]]]:
        return type(self), (self.own, self.wanted)


def _for_others(
    wanted: dict[str, str], job: Job, chunk: int, points: list[Point]
) -> tuple[int, Rows]:
    """As one, on a machine that has to have the same versions of what computes."""
    if versions() != wanted:
        raise VersionsError(versions(), wanted)
    return one(job, chunk, points)


def on_cluster(sweep: Sweep, chunks: Iterable[int], scheduler: str) -> Found:
    """Yield what is found at chunks by the workers of a Dask cluster.

    Few chunks are under way at a time. Raises InputError where there is no scheduler, or none of
    its workers comes; WorkersLostError.
    """
    distributed = needed("distributed", "cluster")
    left = dict.fromkeys(chunks)
    waiting = iter(list(left))
    with _client(scheduler) as client:
        threads = sum(client.nthreads().values())
        tasks = (
            client.submit(_for_others, versions(), sweep.job, c, sweep.points(c), pure=False)
            for c in waiting
        )
        running = distributed.as_completed(islice(tasks, _AHEAD * threads), loop=client.loop)
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
