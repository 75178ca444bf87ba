"""Plans within the strokes of the winches."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import ExactTendons, Extension
from octoplan.planner import Plan, load_plan, plan
from octoplan.planner.frontends.io.scene_file import read
from octoplan.planner.limits import Limits
from octoplan.planner.outcome import verdict
from octoplan.planner.targets import BendingPlane, TipPosition
from tests.core.planner.cases import changed
from tests.lengths.cases import EXACT, cylinder

ARM = Arm.from_paper("table-4")
T = np.array([0.1, 0.3, 0, 0, 0, 1.2, 0, 0.5, 3.0, 0, 0, 1.5])
PAPER = Scene(Extension())


def asked(scene: Scene, **limits: Any) -> Plan:
    """Return the plan for a tip that is reachable without limits of strokes."""
    return plan(ARM, TipPosition(tuple(settle(ARM, T, scene).tip)), scene, 20.0, **limits)


@pytest.mark.quick("exact")
@pytest.mark.parametrize("scene", [PAPER, EXACT], ids=["paper", "exact"])
def test_strokes_stay_within_their_limits(scene: Scene) -> None:
    free = asked(scene)
    most = float(np.abs(free.strokes).max())
    wide = asked(scene, limits=Limits(stroke_max=1.05 * most))
    assert wide.reached
    assert wide.effort == pytest.approx(free.effort, rel=1e-6)
    held = asked(scene, limits=Limits(stroke_max=0.9 * most))
    assert np.abs(held.strokes).max() <= 0.9 * most * (1 + 1e-6)
    assert held.certificate.strokes <= 1e-9
    assert held.reached
    assert held.effort > free.effort * (1 + 1e-3)


def test_the_certificate_finds_out_strokes_beyond_their_limits_by_how_far() -> None:
    free = asked(PAPER, limits=Limits(stroke_max=1.0))
    taken, paid = float(free.strokes.max()), float(free.strokes.min())
    for least, most in ((-1.0, taken - 1e-3), (paid + 1e-3, 1.0)):
        strokes = (least,) * ARM.n_tendons, (most,) * ARM.n_tendons
        tight = changed(free, limits=replace(free.problem.limits, strokes=strokes))
        assert tight.certificate.strokes == pytest.approx(1e-3 / ARM.length, rel=1e-6)
        assert any("stroke limit" in failure for failure in tight.certificate.failures)
    total = float(free.tensions.sum()) - 1e-3
    pulled = changed(free, limits=replace(free.problem.limits, total=total))
    assert pulled.certificate.bounds == pytest.approx(1e-3, rel=1e-5)


@pytest.mark.slow
def test_a_stroke_of_one_tendon_bends_by_as_much_as_it_is_long() -> None:
    """An inextensible arm with tendons at y: the stroke of the taut tendon is y times the bend.

    By hand: a bend of 0.5 rad needs a stroke of 2 mm; with 1.9 mm the arm bends by 0.475 rad at
    most.
    """
    arm, y = cylinder((0.2,)), 4e-3
    target = BendingPlane(angle=0.0, bend=0.5, section=1)
    wide = plan(arm, target, Scene(ExactTendons()), 20.0, limits=Limits(stroke_max=1.001 * 0.5 * y))
    assert wide.reached
    assert np.abs(wide.strokes).max() == pytest.approx(0.5 * y, rel=1e-6)
    tight = plan(arm, target, Scene(ExactTendons()), 20.0, limits=Limits(stroke_max=1.9e-3))
    assert not tight.reached
    assert "at 1.9 mm" in tight.outcome
    bend = np.arccos(tight.shape.tip_frame[:, 0] @ wide.shape.frame(0.0)[:, 0])
    assert bend == pytest.approx(1.9e-3 / y, rel=1e-4)


@pytest.mark.slow
def test_how_far_winches_pay_out_is_a_limit_of_its_own() -> None:
    """The slack tendon across is longer by y times the bend: 1.9 mm allow 0.475 rad."""
    arm, y = cylinder((0.2,)), 4e-3
    target = BendingPlane(angle=0.0, bend=0.5, section=1)
    held = plan(arm, target, Scene(ExactTendons()), 20.0, limits=Limits(stroke_min=-1.9e-3))
    assert not held.reached
    assert held.strokes.min() == pytest.approx(-1.9e-3, rel=1e-6)
    assert "at -1.9 mm" in held.outcome
    bend = np.arccos(held.shape.tip_frame[:, 0] @ held.shape.frame(0.0)[:, 0])
    assert bend == pytest.approx(1.9e-3 / y, rel=1e-4)


def test_plans_with_limits_of_strokes_are_saved_and_followed(tmp_path: Path) -> None:
    held = asked(PAPER, limits=Limits(stroke_max=0.9 * float(np.abs(asked(PAPER).strokes).max())))
    assert load_plan(held.save(tmp_path / "held.json")) == held
    again = plan(
        ARM,
        held.targets,
        PAPER,
        20.0,
        near=held,
        limits=Limits(stroke_max=held.problem.limits.strokes[1]),
    )  # type: ignore[index]
    assert again.tensions == pytest.approx(held.tensions, abs=1e-6 * held.tensions.max())


def test_scene_files_have_them_in_millimetres() -> None:
    text = "[arm]\npreset = 'table-4'\n[limits]\ntension_max = 20\nstroke_max_mm = 15\n"
    assert read(text.encode()).options["limits"].stroke_max == pytest.approx(0.015)
    rows = text.replace("15", "[[15, 15, 15, 15], [9, 9, 9, 9], [9, 9, 9, 9]]")
    options = read((rows + "stroke_min_mm = -3").encode()).options
    assert options["limits"].stroke_max[1] == pytest.approx([9e-3] * 4)
    assert options["limits"].stroke_min == pytest.approx(-3e-3)


@pytest.mark.slow
def test_a_shape_beyond_stroke_limits_is_not_called_the_nearest() -> None:
    """Nothing is found within the limits, as in water with nearly no stroke at all."""
    arm, target = cylinder((0.2,)), BendingPlane(angle=0.0, bend=0.5, section=1)
    tight = plan(arm, target, Scene(ExactTendons()), 20.0, limits=Limits(stroke_max=1.9e-3))
    object.__setattr__(tight, "certificate", replace(tight.certificate, strokes=0.05))
    told = verdict(tight)
    assert "no shape within the limits of strokes is found" in told
    assert "passes them by 10 mm" in told
    assert "nearest shape found" not in told
