"""The workers of a Dask cluster at work on a sweep."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from typing import Any

from model.errors import InputError, OctoplanError
from model.extras import needed
from planner.files import versions
from planner.sweeps.definition import Sweep
from planner.sweeps.variables import Rows
from planner.sweeps.worker import Job, Point
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
    its workers comes; WorkersLostError where the scheduler goes, or workers do again and again;
    VersionsError.
    """
    distributed = needed("distributed", "cluster")
    left = dict.fromkeys(chunks)
    with _client(scheduler) as client:
        try:
            for chunk, rows in _handed_out(client, sweep, list(left)):
                del left[chunk]
                yield chunk, rows
        except (distributed.KilledWorker, distributed.CancelledError, OSError):
            raise WorkersLostError(len(left)) from None


def _handed_out(client: Any, sweep: Sweep, chunks: list[int]) -> Found:
    """Yield what is found at chunks; a further one is handed out for each that comes back."""
    own = versions()
    tasks = (
        client.submit(_for_others, own, sweep.job, chunk, sweep.points(chunk), pure=False)
        for chunk in chunks
    )
    first = islice(tasks, _AHEAD * sum(client.nthreads().values()))
    running = needed("distributed", "cluster").as_completed(first, loop=client.loop)
    for task in running:
        yield task.result()
        task.release()
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
