"""The command line: what it prints, writes and returns."""

import json
from pathlib import Path

import pytest

from planner.cli import main

SCENES = Path(__file__).parents[2] / "studies" / "scenes"


def test_a_plan_is_shown_as_a_table_with_its_certificate(capsys: pytest.CaptureFixture) -> None:
    assert main(["plan", str(SCENES / "bending_135.toml")]) == 0
    shown = capsys.readouterr().out
    assert "T_13" in shown
    assert "certificate: PASSED" in shown


def test_given_tensions_are_settled(capsys: pytest.CaptureFixture) -> None:
    assert main(["settle", str(SCENES / "figure_15.toml"), "--json", "--accuracy", "1e-9"]) == 0
    tip = json.loads(capsys.readouterr().out)["tip_m"]
    assert tip == pytest.approx([0.04314773918701631, -0.06442327980356158, -0.03984290693421615])


def test_a_compiler_that_is_not_there_is_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "nowhere")
    scene = "compile = true\narm = { preset = 'table-4' }\ntensions = [0,0,0,0,0,0,0,0,0,0,0,1]"
    for command in (
        ["settle", _scene(tmp_path, scene)],
        ["plan", str(SCENES / "bending_135.toml"), "--compile"],
    ):
        assert main(command) == 2
        assert "C compiler" in capsys.readouterr().err


def _scene(tmp_path: Path, text: str) -> str:
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return str(path)


def test_tensions_that_crush_the_arm_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    text = (
        "tensions = [9,9,9,9,9,9,9,9,9,9,9,9]\n[arm]\npreset='table-4'\n[effects]\nextension=true"
    )
    assert main(["settle", _scene(tmp_path, text)]) == 1
    assert "crushed" in capsys.readouterr().err


def test_a_target_out_of_reach_returns_1(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    text = """
    arm = { preset = "table-4" }
    effects = { extension = true }
    target = { type = "tip-position", position_mm = [600, 0, 0] }
    limits = { tension_max = 20 }
    """
    assert main(["plan", _scene(tmp_path, text)]) == 1
    assert "Not reached" in capsys.readouterr().out
