"""The command line: what it prints, writes, returns, and says where something is in the way."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import pytest

from planner.cli import main
from planner.io.scene_file import load

SCENES = Path(__file__).parents[2] / "studies" / "scenes"


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


SCENE = """
tensions = [[0.3, 0.2, 0.0, 0.1]]
accuracy = 1e-4
[arm]
preset = "section-5.2"
[effects]
extension = true
"""
REACH = """
[target]
type = "tip-position"
position_mm = [300, 0, 900]
[limits]
tension_max = 2.0
"""


def written(folder: Path, text: str, name: str = "scene.toml") -> str:
    (folder / name).write_text(text)
    return str(folder / name)


def said(capsys: pytest.CaptureFixture[str], argv: list[str], code: int = 2) -> str:
    assert main(argv) == code
    return capsys.readouterr().err.strip()


def test_a_figure_goes_into_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = written(tmp_path, SCENE)
    message = said(capsys, ["settle", scene, "--figure", "pdf"])
    assert "--figure pdf with --out DIR" in message
    assert main(["settle", scene, "--out", str(tmp_path / "out"), "--figure", "pdf"]) == 0
    assert (tmp_path / "out" / "shape.pdf").exists()


def test_a_full_disk_is_told_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, out = written(tmp_path, SCENE), tmp_path / "out"

    def full(self: Path, data: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    message = said(capsys, ["settle", scene, "--out", str(out)])
    assert (
        message == f"octoplan: {out}: no file was written in this folder: no space left on device"
    )
    assert not out.exists()


def test_two_exports_do_not_share_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = SCENE.replace("accuracy = 1e-4", "accuracy = 1e-3")
    one, other = written(tmp_path, text, "one.toml"), written(tmp_path, text, "other.toml")
    to = tmp_path / "c"
    assert main(["export", one, "--to", str(to)]) == 0
    before = {path.name: path.read_bytes() for path in to.iterdir()}
    assert main(["export", one, "--to", str(to)]) == 0
    message = said(capsys, ["export", other, "--to", str(to)])
    assert f"{to}: another export is there" in message
    assert str(to / "other") in message
    assert {path.name: path.read_bytes() for path in to.iterdir()} == before


def test_a_scene_file_has_a_time_limit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = "time_limit_s = 0.001\n" + SCENE + REACH
    scene = written(tmp_path, text)
    assert load(scene).time_limit == 0.001
    code = main(["plan", scene])
    captured = capsys.readouterr()
    assert code == 1
    assert "Stopped at the time limit" in captured.out or "time limit of 0.001 s" in captured.err
    assert main(["settle", scene, "--time-limit", "60"]) == 0
    scene = written(tmp_path, text.replace("0.001", "-3"))
    capsys.readouterr()
    assert "time_limit_s: got -3, allowed is a number above 0" in said(capsys, ["plan", scene])


def test_a_target_out_of_reach_is_told_in_plain_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = written(tmp_path, SCENE + REACH.replace("2.0", "1e3"))
    assert main(["plan", scene, "--accuracy", "1e-3"]) == 1
    shown = capsys.readouterr().out
    assert "Not reached: the nearest attainable shape is off in tip position by" in shown
    assert "initial guess" in shown


def test_silicone_is_a_key(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from model import Scene
    from model.effects import NeoHookean, Weight

    text = SCENE.replace("extension = true", "silicone = true\nweight = {}")
    assert load(written(tmp_path, text)).scene == Scene.silicone(Weight())
    text = SCENE.replace("extension = true", "silicone = true\nanticlastic = true")
    swollen = Scene.silicone(NeoHookean(anticlastic=True))
    assert load(written(tmp_path, text)).scene == swollen
