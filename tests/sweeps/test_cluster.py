"""Sweeps on a Dask cluster: a scheduler and two worker processes on loopback."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import planner
from planner.sweeps import cluster as on_dask
from planner.sweeps.file import load_sweep
from tests.sweeps.cases import DRAWN, GRID, STIFFNESS, written

ROOT = Path(__file__).parents[2]
AXES, MORE = GRID + STIFFNESS + DRAWN, "draws = 32"


def _free_port() -> int:
    with socket.socket() as own:
        own.bind(("127.0.0.1", 0))
        return int(own.getsockname()[1])


@pytest.fixture
def cluster(tmp_path: Path) -> "Iterator[tuple[str, list[subprocess.Popen[bytes]]]]":
    """Start a scheduler and two workers; yield its address and the workers."""
    address = f"tcp://127.0.0.1:{_free_port()}"
    quiet = {"cwd": ROOT, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = [*_dask("scheduler"), "--host", address, "--no-dashboard"]
    worker = [*_dask("worker"), address, "--nthreads", "1", "--no-dashboard", "--no-nanny"]
    worker += ["--local-directory", str(tmp_path / "dask")]
    started = [subprocess.Popen(command, **quiet) for command in (scheduler, worker, worker)]
    yield address, started[1:]
    for process in started[::-1]:
        process.kill()
        process.wait()


def _dask(what: str) -> list[str]:
    return [sys.executable, "-m", f"distributed.cli.dask_{what}"]


def test_a_worker_with_other_versions_is_refused(tmp_path: Path) -> None:
    asked = load_sweep(written(tmp_path, GRID))
    with pytest.raises(on_dask.VersionsError, match="install alike"):
        on_dask._for_others({"octoplan": "0"}, asked.job, 0, asked.points(0))


def test_a_cluster_finds_what_one_process_finds_though_a_worker_is_killed(
    tmp_path: Path, cluster: tuple, monkeypatch: pytest.MonkeyPatch
) -> None:
    address, processes = cluster
    path = written(tmp_path, AXES, "stiffness", MORE)
    found, on_cluster = [], on_dask.on_cluster

    def watched(*asked: object) -> Iterator:
        for chunk, rows in on_cluster(*asked):
            found.append(chunk)
            if len(found) == 10:
                os.kill(processes[0].pid, signal.SIGKILL)
            yield chunk, rows

    monkeypatch.setattr(planner.sweeps.sweep, "on_cluster", watched)
    data = planner.sweep(path, scheduler=address)
    assert sorted(found) == list(range(64))
    assert processes[0].wait() == -signal.SIGKILL
    assert processes[1].poll() is None
    assert data.identical(planner.sweep(path))
