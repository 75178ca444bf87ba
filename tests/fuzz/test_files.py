"""Any scene, sweep or plan file: an answer that is checked or a sentence, in time."""

from __future__ import annotations

import contextlib
import io
import shutil
import time
from pathlib import Path

import pytest

from octoplan.model import OctoplanError
from octoplan.model.support.progress import OutOfTime, time_limit
from octoplan.planner import load_plan
from octoplan.planner.frontends.cli import main
from tests.fuzz.mutations import WRITTEN

LIMIT = 0.5
COMMANDS = (["plan"], ["settle"], ["stiffness"], ["settle", "--json"], ["export"], ["effects"])
CODES = {0, 1, 2}


def ending(kind: str, seed: int, folder: Path) -> tuple[int, float]:
    """Return the exit code of a file and the time [s]; raise all other errors."""
    name = "file.json" if kind == "plan" else "file.toml"
    (folder / name).write_bytes(WRITTEN[kind](seed))
    begin, said = time.monotonic(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = _used(kind, seed, str(folder / name), folder / "out")
    took = time.monotonic() - begin
    assert code in CODES
    assert "Traceback" not in said.getvalue()
    _check_files(folder, name, code)
    return code, took


def _used(kind: str, seed: int, file: str, out: Path) -> int:
    if kind == "plan":
        try:
            with time_limit(LIMIT):
                assert load_plan(file).outcome
        except OctoplanError:
            return 2
        except OutOfTime:
            return 1
        return 0
    if kind == "sweep":
        out.mkdir()
        return main(["sweep", file, "--out", str(out / "a.nc"), "--time-limit", str(LIMIT)])
    command, *options = COMMANDS[seed % len(COMMANDS)]
    if command == "export":
        options = ["--to", str(out)]
    elif seed % 5 == 0:
        options = [*options, "--out", str(out)]
    return main([command, file, *options, "--time-limit", str(LIMIT)])


def _check_files(folder: Path, name: str, code: int) -> None:
    """Check that only the file and complete results exist, and remove the results."""
    left = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*")}
    allowed = {name, "out"}
    assert all(path in allowed or path.startswith("out/") for path in left), left
    assert not [path for path in left if "/." in path or path.startswith(".")], left
    if code == 2:
        assert not [path for path in left.values() if path.is_file() and path.name != name], left
    for path in left.values():
        if path.is_file():
            path.unlink()
    shutil.rmtree(folder / "out", ignore_errors=True)


@pytest.mark.parametrize("kind", WRITTEN)
def test_a_few_files_end_in_an_answer_or_a_sentence(kind: str, tmp_path: Path) -> None:
    for seed in range(12):
        ending(kind, seed, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("kind", WRITTEN)
def test_many_files_end_in_an_answer_or_a_sentence(kind: str, tmp_path: Path) -> None:
    for seed in range(1000, 6000):
        ending(kind, seed, tmp_path)
