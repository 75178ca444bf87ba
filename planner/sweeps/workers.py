"""Who works on a sweep: this process, or processes of this machine; for a cluster see cluster.

All hand out the same chunks, and yield what is found as it comes. Workers that are killed lose the
chunks in their hands; these are handed out again.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Iterable, Iterator

from model.errors import OctoplanError
from model.extras import needed
from model.time_limit import end as end_of_limit
from model.time_limit import until
from planner.sweeps.definition import Sweep
from planner.sweeps.variables import Rows
from planner.sweeps.worker import Job, Point, run

Found = Iterator[tuple[int, Rows]]
TRIES = 3


class WorkersLostError(OctoplanError):
    """Workers were killed again and again with nothing finished between, or all were lost.

    Attributes
    ----------
    left : int
        How many chunks of points are not finished.
    """

    def __init__(self, left: int) -> None:
        self.left = left
        super().__init__(
            f"workers were lost again and again, or their scheduler was; {left} chunks of points "
            "are left, what is finished is kept: start the sweep again, with more memory for each"
        )

    def __reduce__(self) -> tuple[type, tuple[int]]:
        return type(self), (self.left,)


def one(job: Job, chunk: int, points: list[Point], end: float = math.inf) -> tuple[int, Rows]:
    """Return a chunk's number and what is found at its points; OutOfTime after an end."""
    with until(end):
        return chunk, run(job, points)


def _end_with(parent: int) -> None:
    """Watch, from now on, whether this process was left alone by one that was killed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def here(sweep: Sweep, chunks: Iterable[int]) -> Found:
    """Yield what is found at chunks in this process, in order."""
    return (one(sweep.job, chunk, sweep.points(chunk)) for chunk in chunks)


def on_machine(sweep: Sweep, chunks: Iterable[int], jobs: int) -> Found:
    """Yield what is found at chunks by processes of this machine; WorkersLostError."""
    joblib = needed("joblib", "sweep")
    broken = needed("joblib.externals.loky.process_executor", "sweep").BrokenProcessPool
    left, losses = dict.fromkeys(chunks), 0
    begun = {"initializer": _end_with, "initargs": (os.getpid(),)}
    while left:
        end = end_of_limit()
        work = (joblib.delayed(one)(sweep.job, c, sweep.points(c), end) for c in list(left))
        pool = joblib.Parallel(jobs, return_as="generator_unordered", batch_size=1, **begun)
        try:
            for chunk, rows in pool(work):
                del left[chunk]
                losses = 0
                yield chunk, rows
        except broken:
            losses += 1
            if losses == TRIES:
                raise WorkersLostError(len(left)) from None
