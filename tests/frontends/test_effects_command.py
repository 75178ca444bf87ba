"""octoplan effects: table, JSON, figure and exit codes."""

from __future__ import annotations

import json
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from octoplan.model import Arm, Scene
from octoplan.model.effects import Buoyancy, Extension, Weight
from octoplan.planner.frontends.cli import main
from octoplan.planner.frontends.effect_ablation import ProblemSize, Switch, switch_effects
from octoplan.planner.frontends.plots.results import plot_effects
from octoplan.planner.frontends.report import switch_table

ARM = "[arm]\npreset = 'section-5.2'\n"
BENT = "tensions = [[0.3, 0.2, 0.0, 0.1]]\naccuracy = 1e-5\n"
IN_WATER = "[effects]\nextension = true\nweight = {}\nbuoyancy = { density = 1000 }\n"
HELD_UP = "[effects]\nweight = { g = [-9.81, 0, 0] }\ntip_load = { force = [0.3, 0.0, 0.0] }\n"


def _scene(tmp_path: Path, text: str) -> str:
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return str(path)


def test_a_table_has_a_line_for_each_effect(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["effects", _scene(tmp_path, BENT + ARM + IN_WATER)]) == 0
    captured = capsys.readouterr()
    table, _ = captured.out.split("\n\n")
    head, *lines = table.splitlines()
    assert re.split(r" {2,}", head) == [
        "effect",
        "in scene",
        "tip moves by [mm]",
        "share of L",
        "time factor",
        "verdict",
    ]
    rows = [re.split(r" {2,}", line) for line in lines]
    assert {len(row) for row in rows} == {6}
    names = [row[0] for row in rows]
    assert names == [
        "Extension",
        "Weight and Buoyancy",
        "ExactTendons",
        "NeoHookean and ExactTendons",
        "Shear",
    ]
    assert [row[1] for row in rows] == ["yes"] * 2 + ["no"] * 3
    assert {row[-1] for row in rows[:2]} <= {"keep", "drop"}
    assert {row[-1] for row in rows[2:]} <= {"add", "leave out"}
    length = 1e3 * Arm.from_paper("section-5.2").length
    for row in rows:
        share = float(row[3].removesuffix(" %")) / 100
        assert float(row[2]) == pytest.approx(share * length, rel=0.06)
        assert (row[-1] in ("keep", "add")) is (float(row[2]) > 0.01 * length)
    assert captured.err == ""


@pytest.mark.slow
def test_the_table_names_an_arm_that_buckles_without_an_effect(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = "tensions = [0, 0, 0, 0]\naccuracy = 1e-4\n" + ARM + HELD_UP
    assert main(["effects", _scene(tmp_path, text), "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().out
    assert "\nTipLoad: the arm does not bear its loads" in shown
    assert next(x for x in shown.splitlines() if x.startswith("TipLoad ")).endswith("keep")
    assert (tmp_path / "out" / "effects.png").stat().st_size > 10_000
    rows = json.loads((tmp_path / "out" / "effects.json").read_text())["effects"]
    row = next(row for row in rows if row["effect"] == "TipLoad")
    assert row["tip_change"] is None
    assert row["time_factor"] is None
    assert row["matters"]
    assert "buckles" in row["problem"]


def _found(arm: Arm, scene: Scene) -> dict[str, Switch]:
    pulls = [[0.3, 0.2, 0.0, 0.1]]
    return {s.effect: s for s in switch_effects(arm, pulls, scene, 1e-5, repeats=1)}


def test_json_holds_the_numbers_in_full(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", _scene(tmp_path, BENT + ARM + IN_WATER), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert set(shown["versions"]) == {"octoplan", "casadi", "numpy"}
    wanted = _found(Arm.from_paper("section-5.2"), Scene(Extension(), Weight(), Buoyancy()))
    assert [row["effect"] for row in shown["effects"]] == list(wanted)
    for row in shown["effects"]:
        switch = wanted[row["effect"]]
        assert row["tip_change"] == pytest.approx(switch.tip_change, rel=1e-12)
        assert row["matters"] is switch.matters
        assert row["enabled"] is switch.enabled
        assert row["problem"] == ""
        assert np.isfinite(row["time_factor"])
        for key in ("sizes", "sizes_without"):
            assert ProblemSize(**row[key]) == getattr(switch, key)


def test_the_tolerance_decides_what_to_keep(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = _scene(tmp_path, BENT + ARM + IN_WATER)
    for tolerance, kept in (("1e-4", True), ("1", False)):
        assert main(["effects", scene, "--tolerance", tolerance, "--json"]) == 0
        shown = json.loads(capsys.readouterr().out)
        assert shown["tolerance"] == float(tolerance)
        row = next(row for row in shown["effects"] if row["effect"] == "Extension")
        assert row["matters"] is kept


def test_a_tolerance_below_the_accuracy_is_rejected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = _scene(tmp_path, BENT + ARM)
    assert main(["effects", scene, "--tolerance", "1e-4", "--accuracy", "1e-3"]) == 2
    assert "tolerance = 0.0001: must be at least 2 accuracies" in capsys.readouterr().err


def _switches(factors: tuple[float, ...]) -> tuple[Switch, ...]:
    size = ProblemSize(1, 1, 1, 1)
    return tuple(Switch("Weight", True, 1e-2, size, size, factor, True) for factor in factors)


@pytest.mark.parametrize("factors", [(0.98, 1.05, 1.2), (1.0,), (0.3, 40.0)])
def test_labels_of_time_factors_do_not_overlap(factors: tuple[float, ...]) -> None:
    figure = plot_effects(_switches(factors), 0.3, 0.01)
    figure.draw_without_rendering()
    axis = figure.axes[1].xaxis
    low, high = figure.axes[1].get_xlim()
    ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
    boxes = [tick.label1.get_window_extent() for tick in ticks if tick.label1.get_text()]
    assert len(boxes) >= 2
    assert all(a.x1 < b.x0 for a, b in pairwise(boxes))
    assert not any(text.get_text() for text in axis.get_ticklabels(minor=True))


def test_the_table_of_effects_explains_each_verdict() -> None:
    table = switch_table(_switches((1.0,)), 0.3, 0.01)
    for verdict in ("Keep or add", "Drop or leave out"):
        assert f"{verdict}: the effect moves the tip by" in table
