"""Sweeps on a Dask cluster: a scheduler and two worker processes on loopback."""

import math
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from octoplan import planner
from octoplan.planner.frontends.sweeps.definition import load_sweep
from octoplan.planner.frontends.sweeps.sweep import (
    VersionsError,
    WorkersLostError,
    _run_chunk,
    run_on_cluster,
)
from tests.sweeps.cases import DRAWN, GRID, STIFFNESS, written

ROOT = Path(__file__).parents[2]
AXES = GRID + STIFFNESS + DRAWN
# 64 chunks of compliances, and 18.
MORE, FEW = "draws = 32", "draws = 3"


def _free_port() -> int:
    with socket.socket() as own:
        own.bind(("127.0.0.1", 0))
        return int(own.getsockname()[1])


@pytest.fixture
def cluster(tmp_path: Path) -> "Iterator[tuple[str, list[subprocess.Popen[bytes]]]]":
    """Start a scheduler and two workers; yield the address and the three processes."""
    address = f"tcp://127.0.0.1:{_free_port()}"
    quiet = {"cwd": ROOT, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = [*_dask("scheduler"), "--host", address, "--no-dashboard"]
    worker = [*_dask("worker"), address, "--nthreads", "1", "--no-dashboard", "--no-nanny"]
    worker += ["--local-directory", str(tmp_path / "dask")]
    started = [subprocess.Popen(command, **quiet) for command in (scheduler, worker, worker)]
    yield address, started
    for process in started[::-1]:
        process.kill()
        process.wait()


def _dask(what: str) -> list[str]:
    return [sys.executable, "-m", f"distributed.cli.dask_{what}"]


def test_a_worker_with_other_versions_is_refused(tmp_path: Path) -> None:
    asked = load_sweep(written(tmp_path, GRID))
    with pytest.raises(VersionsError, match="install the same versions"):
        _run_chunk(asked.job, 0, asked.points(0), math.inf, {"octoplan": "0"})


def _killing(
    process: "subprocess.Popen[bytes]", found: list[int], after: int = 10
) -> Callable[..., Iterator]:
    """Return run_on_cluster, which kills a process when so many chunks are found."""

    def watched(*asked: object) -> Iterator:
        for chunk, rows in run_on_cluster(*asked):
            found.append(chunk)
            if len(found) == after:
                os.kill(process.pid, signal.SIGKILL)
            yield chunk, rows

    return watched


@pytest.mark.slow
@pytest.mark.parametrize(("more", "chunks", "after"), [(FEW, 18, 3), (MORE, 64, 10)], ids=[18, 64])
def test_a_cluster_finds_what_one_process_finds_though_a_worker_is_killed(
    tmp_path: Path,
    cluster: tuple,
    monkeypatch: pytest.MonkeyPatch,
    more: str,
    chunks: int,
    after: int,
) -> None:
    address, (_, first, second) = cluster
    path, found = written(tmp_path, AXES, "stiffness", more), []
    monkeypatch.setattr(
        planner.frontends.sweeps.sweep, "run_on_cluster", _killing(first, found, after)
    )
    data = planner.sweep(path, scheduler=address)
    assert sorted(found) == list(range(chunks))
    assert first.wait() == -signal.SIGKILL
    assert second.poll() is None
    assert data.identical(planner.sweep(path))


@pytest.mark.slow
def test_a_cluster_that_loses_its_scheduler_is_told_and_the_sweep_goes_on_without(
    tmp_path: Path, cluster: tuple, monkeypatch: pytest.MonkeyPatch
) -> None:
    address, (scheduler, *_) = cluster
    path, out, found = written(tmp_path, AXES, "stiffness", MORE), tmp_path / "out.nc", []
    monkeypatch.setattr(
        planner.frontends.sweeps.sweep, "run_on_cluster", _killing(scheduler, found)
    )
    with pytest.raises(WorkersLostError, match="inished chunks are kept"):
        planner.sweep(path, out, scheduler=address)
    assert 10 <= len(found) < 64
    assert planner.sweep(path, out).identical(planner.sweep(path))
