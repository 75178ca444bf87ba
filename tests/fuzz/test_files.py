"""Any scene, sweep or plan file: an answer that is checked or a sentence, in time."""

from __future__ import annotations

import contextlib
import io
import shutil
import signal
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from model import OctoplanError, settle
from model.time_limit import OutOfTime, time_limit
from planner import load_plan, plan
from planner.cli import main
from planner.io.scene_file import read
from tests.fuzz.mutations import WRITTEN, mutated

LIMIT = 0.5
COMMANDS = (["plan"], ["settle"], ["stiffness"], ["settle", "--json"], ["export"], ["effects"])
CODES = {0, 1, 2}


def ending(kind: str, seed: int, folder: Path) -> tuple[int, float]:
    """Return with which code a file ends, after how long [s]; whatever else happens is raised."""
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
    """Check that there is nothing but the file and results, these whole; and take these away."""
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
    for seed in range(1000, 3000):
        ending(kind, seed, tmp_path)


# Whatever takes so much longer than its limit hangs [s].
SECONDS, HANGS = 2.0, 300
PLANNED = 40


@contextmanager
def watched() -> Iterator[None]:
    """Fail where the block hangs."""
    signal.alarm(HANGS)
    try:
        yield
    finally:
        signal.alarm(0)


def answered(seed: int) -> str:
    """Return how a mutated scene file ends: what is wrong with it, or what came of it."""
    try:
        question = read(mutated(seed))
    except OctoplanError as problem:
        assert str(problem)
        return "refused"
    try:
        with time_limit(SECONDS):
            if question.tensions is not None:
                shape = settle(question.arm, question.tensions, question.scene, question.accuracy)
                assert np.all(np.isfinite(shape.states)) and shape.error <= question.accuracy
    except OutOfTime:
        return "out of time"
    except OctoplanError as problem:
        assert str(problem)
        return "not settled"
    return "settled" if question.tensions is not None else "read"


def planned(seed: int) -> str:
    """Return how a plan for a mutated scene file ends."""
    try:
        question = read(mutated(seed))
        if not question.targets or "tension_max" not in question.options:
            return "no question"
        found = plan(
            question.arm,
            question.targets,
            question.scene,
            **question.but(time_limit=SECONDS).of(plan),
        )
    except OctoplanError as problem:
        assert str(problem)
        return "refused"
    assert np.all(np.isfinite(found.tensions))
    return "certified" if found.reached else found.outcome[:12]


def some(seeds: range) -> None:
    ends = Counter(answered(seed) for seed in seeds)
    assert ends["refused"] > 0.2 * len(seeds) and ends["settled"] > 0.02 * len(seeds)
    ends += Counter(planned(seed) for seed in seeds[::PLANNED])
    print(dict(ends))


def test_a_few_hundred_files_end_in_an_answer_or_an_error_of_ours() -> None:
    with watched():
        some(range(400))


@pytest.mark.slow
@pytest.mark.parametrize("part", range(20))
def test_twenty_thousand_files_end_in_an_answer_or_an_error_of_ours(part: int) -> None:
    signal.alarm(0)
    some(range(1000 * (part + 1), 1000 * (part + 2)))
