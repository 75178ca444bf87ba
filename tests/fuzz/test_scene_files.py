"""Any scene file ends in an answer that is checked, or in an error of ours; nothing hangs."""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from model import OctoplanError, settle
from model.time_limit import OutOfTime, time_limit
from planner import plan
from planner.cli import main
from planner.io.scene_file import read
from tests.fuzz.mutations import mutated

# Whatever takes so much longer than its limit hangs [s].
LIMIT, HANGS = 2.0, 300
PLANNED = 40


@contextmanager
def watched() -> Iterator[None]:
    """Fail where the block hangs."""
    signal.alarm(HANGS)
    try:
        yield
    finally:
        signal.alarm(0)


def ending(seed: int) -> str:
    """Return how a mutated scene file ends: what is wrong with it, or what came of it."""
    try:
        question = read(mutated(seed))
    except OctoplanError as problem:
        assert str(problem)
        return "refused"
    try:
        with time_limit(LIMIT):
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
            accuracy=question.accuracy,
            time_limit=LIMIT,
            **question.options,
        )
    except OctoplanError as problem:
        assert str(problem)
        return "refused"
    assert np.all(np.isfinite(found.tensions))
    return "certified" if found.reached else found.outcome[:12]


def some(seeds: range) -> None:
    ends = Counter(ending(seed) for seed in seeds)
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


@pytest.mark.parametrize("seed", range(7000, 7012))
def test_the_command_line_leaves_whole_files_or_none(
    seed: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, out = tmp_path / "scene.toml", tmp_path / "out"
    scene.write_bytes(mutated(seed))
    with watched():
        code = main(["settle", str(scene), "--out", str(out), "--accuracy", "1e-3"])
    told = capsys.readouterr()
    assert code in (0, 1, 2) and bool(told.err) == (code != 0)
    left = {path.name for path in out.iterdir()} if out.is_dir() else set()
    assert not any(name.startswith(".") for name in left)
    assert bool(left) == (code == 0)
    assert {path.name for path in tmp_path.iterdir()} <= {"scene.toml", "out"}
