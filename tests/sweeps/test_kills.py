"""Killed sweeps, or sweeps with killed workers, end with the results of undisturbed sweeps."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest
import xarray

from octoplan import planner
from octoplan.model import InputError
from octoplan.planner.frontends.sweeps.definition import Sweep
from octoplan.planner.frontends.sweeps.points import Job
from octoplan.planner.frontends.sweeps.store import folder_of
from octoplan.planner.frontends.sweeps.sweep import WorkersLostError
from tests.sweeps.cases import DRAWN, GRID, STIFFNESS, written

ROOT = Path(__file__).parents[2]
# 64 chunks of compliances, and 30: enough to be hit in the middle.
AXES = GRID + STIFFNESS + DRAWN
MORE, FEW = "draws = 32", "draws = 5"


def _started(path: Path, out: Path, jobs: int, **options: Any) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-m", "octoplan", "sweep", str(path), "--out", str(out)]
    return subprocess.Popen(
        [*command, "--jobs", str(jobs)],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        **options,
    )


def _finished(out: Path) -> int:
    return len(list(folder_of(out).glob("*.npz")))


def _await_chunks(out: Path, chunks: int, process: "subprocess.Popen[bytes]") -> None:
    """Wait until so many chunks are finished."""
    while _finished(out) < chunks:
        assert process.poll() is None, process.stderr and process.stderr.read().decode()
        time.sleep(0.01)


def _workers(pid: int) -> list[psutil.Process]:
    """Return the processes below a process that are joblib's workers."""
    workers = []
    for process in psutil.Process(pid).children(recursive=True):
        with suppress(psutil.Error):
            if any("popen_loky" in word for word in process.cmdline()):
                workers.append(process)
    return workers


def _awaited_workers(process: "subprocess.Popen[bytes]") -> list[psutil.Process]:
    """Return the workers of a sweep as soon as there are any."""
    while not (workers := _workers(process.pid)):
        assert process.poll() is None
        time.sleep(0.01)
    return workers


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_sweep_killed_twice_and_resumed_finds_what_an_undisturbed_one_finds(
    tmp_path: Path, jobs: int
) -> None:
    path, out = written(tmp_path, AXES, "stiffness", MORE), tmp_path / "out.nc"
    for chunks in (10, 25):
        process = _started(path, out, jobs)
        _await_chunks(out, chunks, process)
        workers = _workers(process.pid)
        assert len(workers) == (2 if jobs == 2 else 0)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
        # Workers notice that the main process ended.
        psutil.wait_procs(workers)
        assert process.stderr is not None
        process.stderr.close()
        assert not out.exists()
        assert _finished(out) >= chunks
    resumed = planner.sweep(path, out)
    assert not folder_of(out).exists()
    undisturbed = planner.sweep(path)
    assert resumed.identical(undisturbed)
    assert xarray.load_dataset(out).identical(undisturbed)


@pytest.mark.slow
def test_workers_that_wait_for_their_first_points_end_with_the_sweep_too(tmp_path: Path) -> None:
    process = _started(written(tmp_path, AXES, "stiffness", MORE), tmp_path / "out.nc", 2)
    workers = _awaited_workers(process)
    process.kill()
    process.communicate()
    assert not psutil.wait_procs(workers, timeout=60)[1]


@pytest.mark.slow
@pytest.mark.parametrize("chunks", [0, 3])
def test_ctrl_c_in_a_terminal_is_one_sentence_though_all_processes_are_sent_it(
    tmp_path: Path, chunks: int
) -> None:
    """Workers that were still loading printed a traceback each."""
    path, out = written(tmp_path, AXES, "stiffness", MORE), tmp_path / "out.nc"
    process = _started(path, out, 2, start_new_session=True)
    workers = _awaited_workers(process)
    _await_chunks(out, chunks, process)
    time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)
    told = process.communicate()[1].decode()
    assert process.returncode == 130
    kept = "inished chunks are kept" if chunks else ""
    assert told.startswith("octoplan: interrupted; ") and kept in told
    assert len(told.splitlines()) == 1
    assert not psutil.wait_procs(workers, timeout=60)[1]


def test_what_is_finished_is_not_found_again_and_resumes_no_other_sweep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, out = written(tmp_path, AXES, "stiffness", FEW), tmp_path / "out.nc"
    process = _started(path, out, 1)
    _await_chunks(out, 5, process)
    process.kill()
    process.communicate()
    finished, scene = _finished(out), tmp_path / "scene.toml"
    text = scene.read_text()
    scene.write_text(text.replace("6.0", "6.5"))
    with pytest.raises(InputError, match="choose another output, or remove the folder"):
        planner.sweep(path, out)
    assert _finished(out) == finished
    assert not out.exists()
    scene.write_text(text)
    rows = Job.rows
    chunks = []
    monkeypatch.setattr(Job, "rows", lambda *asked: chunks.append(1) or rows(*asked))
    planner.sweep(path, out)
    assert len(chunks) == 30 - finished


@pytest.mark.slow
def test_a_sweep_whose_worker_is_killed_says_so_and_goes_on_when_started_again(
    tmp_path: Path,
) -> None:
    path, out = written(tmp_path, AXES, "stiffness", MORE), tmp_path / "out.nc"
    process = _started(path, out, 2)
    _await_chunks(out, 5, process)
    _workers(process.pid)[0].kill()
    told = process.communicate()[1].decode()
    assert process.returncode == 1
    assert "workers were killed" in told
    assert "inished chunks are kept" in told
    assert "Traceback" not in told
    assert _finished(out) >= 5
    assert planner.sweep(path, out, jobs=2).identical(planner.sweep(path))


class _Deadly:
    """Ends the process that unpickles this object."""

    def __reduce__(self) -> tuple:
        return os._exit, (1,)


@pytest.mark.slow
def test_points_that_kill_their_workers_are_told_and_the_others_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, out = written(tmp_path, GRID), tmp_path / "out.nc"
    good = Sweep.points
    monkeypatch.setattr(
        Sweep, "points", lambda own, chunk: [_Deadly()] if chunk == 2 else good(own, chunk)
    )
    with pytest.raises(WorkersLostError, match="kept"):
        planner.sweep(path, out, jobs=2)
    monkeypatch.undo()
    assert planner.sweep(path, out).identical(planner.sweep(path))
