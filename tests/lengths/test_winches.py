"""Plans and scene files for winches: lengths, strokes, and the effect of their errors."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from octoplan.model import Arm, InputError, Scene, settle, settle_many
from octoplan.model.compliance import length_error
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, Weight
from octoplan.model.support.errors import FileError
from octoplan.model.support.units import UnitWarning
from octoplan.model.tendons import rest_lengths
from octoplan.planner import load_plan, plan, stiffness
from octoplan.planner.extensions.trajectory.question import Rates
from octoplan.planner.frontends.cli import main
from octoplan.planner.frontends.io.scene_file import load
from octoplan.planner.limits import Limits, TendonLimits
from octoplan.planner.targets import TipPosition
from tests.warned import detailed

ARM = Arm.from_paper("table-2")
SCENE = Scene(Extension(), ExactTendons())
HEAD = '[arm]\npreset = "table-2"\n[effects]\nextension = true\nexact_tendons = true\n'
STROKES = "[[0, 5, 0, -6.0], [0, 0, 3, -3.0], [0, -1, 0, 2.0]]"


def test_a_plan_tells_what_winches_do() -> None:
    found = plan(ARM, TipPosition((0.28, 0.06, -0.08)), SCENE, 20.0)
    assert found.tip == pytest.approx([0.28, 0.06, -0.08], abs=1e-6)
    assert found.lengths.shape == found.strokes.shape == (3, 4)
    assert found.strokes.ravel() == pytest.approx(rest_lengths(ARM) - found.lengths.ravel())
    taut = np.ravel(found.tensions) > 1e-9
    lengths = np.where(taut, found.lengths.ravel(), 1.0)
    again = settle(ARM, scene=SCENE, accuracy=1e-7, lengths=lengths)
    assert again.tip == pytest.approx(found.tip, abs=1e-5 * ARM.length)
    text = str(found)
    assert "strokes [mm]" in text
    assert "; largest for T_" in text


def test_what_a_wrong_length_does_is_what_it_does() -> None:
    shape = settle(ARM, [0.5, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0], SCENE)
    found = length_error(shape)
    assert list(found) == ["T_11", "T_22"]
    lengths = shape.tendon_lengths + 1.0 * (shape.tensions == 0)
    lengths[0] += 1e-5
    moved = settle(ARM, scene=SCENE, accuracy=1e-8, lengths=lengths)
    off = np.linalg.norm(moved.tip - shape.tip) / 1e-5
    assert found["T_11"] == pytest.approx(off, rel=1e-2)


def scene_file(folder: Path, text: str) -> Path:
    """Write a scene file with keys above its tables."""
    path = folder / "scene.toml"
    path.write_text(f"{text}\n{HEAD}")
    return path


def test_scene_files_have_strokes_or_lengths(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["settle", str(scene_file(tmp_path, f"strokes_mm = {STROKES}")), "--json"]) == 0
    by_strokes = json.loads(capsys.readouterr().out)
    rest = 1e3 * rest_lengths(ARM)
    lengths = (rest - np.ravel(json.loads(STROKES))).tolist()
    path = scene_file(tmp_path, f"lengths_mm = {lengths}")
    assert main(["settle", str(path), "--json"]) == 0
    by_lengths = json.loads(capsys.readouterr().out)
    assert by_lengths["tip_m"] == pytest.approx(by_strokes["tip_m"], abs=1e-12)
    assert 1e3 * np.array(by_lengths["strokes_m"]) == pytest.approx(np.ravel(json.loads(STROKES)))
    assert by_lengths["slack"] == (np.ravel(by_lengths["tensions_N"]) < 1e-8).tolist()
    assert main(["settle", str(path)]) == 0
    assert "slack: T_11, T_13" in capsys.readouterr().out
    assert main(["stiffness", str(path)]) == 0
    assert "lengths locked" in capsys.readouterr().out


def test_scene_files_may_hold_some_tendons_by_tension(tmp_path: Path) -> None:
    strokes = "[[nan, 5, 0, -6.0], [0, 0, 3, -3.0], [0, -1, 0, 2.0]]"
    pulls = "[[0.1, nan, nan, nan], [nan, nan, nan, nan], [nan, nan, nan, nan]]"
    asked = load(scene_file(tmp_path, f"strokes_mm = {strokes}\ntensions = {pulls}"))
    shape = settle(asked.arm, asked.tensions, asked.scene, **asked.of(settle))
    assert shape.tensions[0] == 0.1


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("strokes_mm = [[0, 5, 0], [0, 0, 3, -3.0], [0, -1, 0, 2.0]]", "3 rows of 3, 4, 4"),
        ("strokes_mm = [1, 2, 3]", "3 numbers"),
        (f"strokes_mm = {[1] * 13}", "strokes = 13 numbers"),  # the last was left out
        (
            f"strokes_mm = {[*[1] * 11, 400]}",
            r"T_34.*400 mm: must be below \S+ mm, its length",
        ),
        (
            f"strokes_mm = {[*[1] * 11, 'inf']}".replace("'", ""),
            r"T_34.*inf mm: must be below",
        ),
        ("lengths_mm = [-1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]", "a number from 0 to"),
        (f"strokes_mm = {STROKES}\nlengths_mm = {STROKES}", "omitted if lengths_mm are given"),
        (f"strokes_mm = {STROKES}\ntensions = {STROKES.replace('-', '')}", "None or nan"),
        ("tendon_EA = 100.0", "omitted without lengths_mm or strokes_mm"),
    ],
)
def test_what_is_wrong_in_a_scene_file_is_told(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(FileError, match=told):
        load(scene_file(tmp_path, text))


@pytest.mark.slow
def test_units_of_strokes_and_lengths_that_are_likely_others_are_told(tmp_path: Path) -> None:
    with detailed(UnitWarning, "strokes_mm .* if metres were meant"):
        load(scene_file(tmp_path, f"strokes_mm = {[0.005] * 12}"))
    with (
        detailed(UnitWarning, "lengths are all .* if metres were meant"),
        pytest.raises(InputError, match="T_11"),
    ):
        settle(Arm.from_paper("section-5.2"), scene=Scene(), lengths=[2.7e-4] * 4)
    with detailed(UnitWarning, "stroke_max .* if metres were meant"):
        TendonLimits.of(ARM, 20.0).with_strokes(ARM, 2e-5)
    with detailed(UnitWarning, "stroke_min .* 1000 times too much"):
        TendonLimits.of(ARM, 20.0).with_strokes(ARM, 0.1, -100.0)
    with detailed(UnitWarning, "stroke_rate_max .* if metres were meant"):
        Rates.of(ARM, None, 2e-5)


@pytest.mark.slow
def test_strokes_count_from_where_winches_are_zeroed() -> None:
    water, target = Scene.silicone(Weight(), Buoyancy()), TipPosition((0.28, 0.06, -0.08))
    hanging = settle(ARM, np.zeros(12), water)
    asked = {"tension_max": 20.0, "accuracy": 1e-5}
    for zero in ("at rest", hanging, hanging.lengths):
        found = plan(ARM, target, water, stroke_zero=zero, **asked)
        assert found.strokes == pytest.approx(hanging.lengths - found.lengths, abs=1e-9)
    most = 0.8 * float(found.strokes.max())
    held = plan(ARM, target, water, stroke_zero="at rest", limits=Limits(stroke_max=most), **asked)
    assert held.strokes.max() <= most * (1 + 1e-6)
    assert held.certificate.strokes <= 1e-9


def test_where_winches_are_zeroed_is_kept_in_files(tmp_path: Path) -> None:
    bent = settle(ARM, [0.5, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0], SCENE)
    found = plan(ARM, TipPosition((0.28, 0.06, -0.08)), SCENE, 20.0, stroke_zero=bent)
    again = load_plan(found.save(tmp_path / "plan.json"))
    assert again == found
    np.testing.assert_array_equal(again.strokes, found.strokes)
    limits = '[limits]\ntension_max = 9\nstroke_zero = "at rest"\n'
    path = tmp_path / "scene.toml"
    path.write_text(HEAD + limits)
    assert load(path).options["stroke_zero"] == "at rest"


@pytest.mark.parametrize("tension", [2e-17, 3e-17, 1e-10])
def test_tendons_that_pull_by_rounding_alone_are_slack(tension: float) -> None:
    tensions = [0.5, tension, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0]
    shape = settle(ARM, tensions, SCENE)
    assert shape.slack.ravel().tolist() == [own < 0.1 for own in tensions]
    assert list(length_error(shape)) == ["T_11", "T_22"]
    assert "T_12" in stiffness(ARM, tensions, SCENE, hold="length").slack
    assert settle_many(ARM, [tensions], SCENE).slack.sum() == 10


def test_a_tendon_is_slack_below_what_shortens_all_by_1e_8_of_the_arm() -> None:
    """Return the straight arm's compliance, the sum of the integrals of y2/EJ + 1/EA."""
    C = 0.0
    for section in ARM.sections:
        s = np.linspace(0, section.at, 4001)
        R, y = ARM.radius.evaluate(s, ARM.length)[0], section.offset.evaluate(s, section.at)[0]
        EJ = ARM.material.E * np.pi * R**4 / 4
        C += len(section.angles) * np.trapezoid((y**2 + R**2 / 4) / EJ, s)
    for factor, slack in ((0.99, True), (1.01, False)):
        tensions = [0.5, factor * 1e-8 * ARM.length / C, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0]
        assert settle(ARM, tensions, SCENE).slack.ravel()[1] == slack
