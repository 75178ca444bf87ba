"""A worker that does the newest of what it is asked: what is overtaken is left out."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from model.time_limit import OutOfTime, unless

LOG = logging.getLogger(__name__)
Job = Callable[[], None]


class Latest:
    """One thread; a job waits until the one before is done, and is dropped for a newer one.

    Once nothing was asked for `rest` seconds after a job, `at_rest` is called, in the same thread;
    it is cut short by the next job.
    """

    def __init__(self, at_rest: Job, rest: float = 0.2) -> None:
        self._at_rest, self._rest = at_rest, rest
        self._changed, self._ended = threading.Condition(), False
        self._job: Job | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def put(self, job: Job) -> None:
        """Ask for a job; one that waits is forgotten."""
        with self._changed:
            self._job = job
            self._changed.notify()

    def go_on(self, job: Job) -> None:
        """Ask for a job unless one waits, which is newer."""
        with self._changed:
            self._job = self._job or job
            self._changed.notify()

    def end(self) -> None:
        """Let the thread end, and wait for that: a job that goes on is cut short."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        worked = False
        while True:
            with self._changed:
                self._changed.wait_for(self._called, self._rest if worked else None)
                if self._ended:
                    return
                job, self._job = self._job, None
            try:
                with unless(lambda: self._ended) if job else unless(self._called):
                    (job or self._at_rest)()
            except OutOfTime:
                LOG.debug("a job was cut short")
            except Exception:  # what goes wrong at one job ends none of the others
                LOG.exception("a job failed")
            worked = job is not None

    def _called(self) -> bool:
        return self._ended or self._job is not None
