"""Exported C on a Cortex-M7, emulated: agrees with Python, and in how many instructions."""

from __future__ import annotations

import pytest

from studies.microcontroller import main as study
from studies.microcontroller import measured, missing
from tests.export.cases import SCENES

needs_tools = pytest.mark.skipif(bool(missing()), reason=f"not installed: {missing()}")


@needs_tools
@pytest.mark.parametrize("precision", ["float", pytest.param("double", marks=pytest.mark.slow)])
def test_it_agrees_there_and_serves_a_kilohertz_loop(precision: str) -> None:
    arm, scene, T = SCENES["the paper's"]
    cost = measured(arm, scene, T, 1e-3, precision)
    assert set(cost.instructions) == set(cost.stack) == {"tip", "nodes", "jacobian"}
    assert cost.instructions["tip"] < cost.instructions["nodes"] < cost.instructions["jacobian"]
    # A count, not a time: 480 MHz allow for 480 000 a millisecond.
    assert cost.instructions["nodes"] + cost.instructions["jacobian"] < 480_000
    assert cost.flash < 64 * 1024
    assert cost.static < 8192
    assert max(cost.stack.values()) < 4096


@needs_tools
@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(SCENES) - {"the paper's"}))
def test_other_scenes_agree_there(name: str) -> None:
    arm, scene, T = SCENES[name]
    assert measured(arm, scene, T, 1e-3, "double").instructions["tip"] > 0


def test_the_study_prints_its_table_or_what_is_missing(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("studies.microcontroller.TOOLS", ("no-such-tool",))
    study()
    assert capsys.readouterr().out == "not measured, not installed: no-such-tool\n"
