"""The suite's cases are the same again, and what it keeps of a failure makes the failure again."""

from __future__ import annotations

import contextlib
import io
from dataclasses import replace
from pathlib import Path

import pytest

from model import Scene, effects
from studies import planner_suite, unreachable
from studies.planner_suite import keep, run, written
from studies.reachable import SCENES


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_written_as_python_that_makes_it(name: str) -> None:
    scene = SCENES[name][1]
    assert eval(written(scene), vars(effects) | {"Scene": Scene}) == scene


@pytest.mark.parametrize("number", range(3), ids=["tip", "pose", "plane"])
def test_what_is_kept_of_a_case_ends_as_the_case_did(number: int, tmp_path: Path) -> None:
    case = run((number, 3, 0))
    assert case.reached and not case.wrong
    keep([case, replace(case, reached=False)], tmp_path)
    (script,) = tmp_path.iterdir()
    assert script.name == f"none_{number}_{case.kind}.py"
    with contextlib.redirect_stdout(io.StringIO()) as said:
        exec(script.read_text(), {})
    assert said.getvalue().strip() == case.outcome


def test_a_plan_that_is_called_reached_and_is_not_counts_as_wrong() -> None:
    case = replace(run((2, 3, 0)), error=1e-5)
    assert case.wrong
    assert not replace(case, reached=False).wrong


def test_the_suite_prints_a_line_for_all(capsys: pytest.CaptureFixture[str]) -> None:
    planner_suite.report([run((2, 3, 1))])
    assert "all                1   100.0%      0      100.0%" in capsys.readouterr().out


def test_the_nearest_shape_is_as_near_as_random_starts_find(
    capsys: pytest.CaptureFixture[str],
) -> None:
    unreachable.main(["--targets", "1", "--best-of", "8"])
    assert "100.0%    1.000" in capsys.readouterr().out.splitlines()[-1]
