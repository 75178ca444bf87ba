"""Checks of random tensions: wrong shapes are found, rotations of loads, refusals, the command."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from octoplan import check_arm
from octoplan.model import Arm, InputError, Scene, settle
from octoplan.model.arm import conical
from octoplan.model.effects import (
    Current,
    Extension,
    LineLoad,
    PointLoad,
    PointMass,
    TipLoad,
    Weight,
)
from octoplan.model.extensions.contact import Contact
from octoplan.model.extensions.obstacles import Sphere
from octoplan.planner.frontends import arm_check
from octoplan.planner.frontends.cli import main
from octoplan.planner.limits import TendonLimits

ARM = conical(0.3, (0.012, 0.006), [(0.3, 5e-3, 2e-3)])
TURN = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
LOADS = {
    "weight": Weight((1.0, 2.0, -3.0)),
    "tip load": TipLoad((1e-3, 2e-3, 3e-3), (1e-5, 0.0, 2e-5)),
    "follower": TipLoad((1e-3, 2e-3, 3e-3), follower=True),
    "point moment": PointLoad(0.2, (1e-3, 0.0, 2e-3), moment=(1e-5, 0.0, 2e-5)),
    "line load": LineLoad((1e-2, 2e-2, 3e-2), (1e-4, 0.0, 2e-4), begin=0.1),
    "line follower": LineLoad((1e-2, 2e-2, 3e-2), (1e-4, 0.0, 2e-4), follower=True),
    "point load": PointLoad(0.2, (1e-3, 2e-3, 3e-3)),
    "current": Current((0.02, 0.05, -0.03)),
}


@pytest.mark.parametrize("load", LOADS.values(), ids=LOADS)
def test_a_rotated_load_rotates_the_shape(load: Any) -> None:
    scene = Scene(Extension(), load)
    frame = TURN @ np.array(ARM.base_frame)
    turned = replace(ARM, base_frame=tuple(map(tuple, frame.tolist())))
    rotated = arm_check.rotated_scene(scene, TURN)
    tip = settle(ARM, [0.1, 0, 0, 0.2], scene).tip
    assert settle(turned, [0.1, 0, 0, 0.2], rotated).tip == pytest.approx(TURN @ tip, abs=1e-12)


def test_contact_is_not_rotated() -> None:
    assert arm_check.rotated_scene(Scene(Contact(Sphere((1, 1, 1), 0.1))), TURN) is None


def test_random_rotations_are_rotations() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        R = arm_check.random_rotation(rng)
        assert pytest.approx(np.eye(3), abs=1e-14) == R @ R.T
        assert np.linalg.det(R) == pytest.approx(1.0)


def test_random_tensions_are_within_limits() -> None:
    limits = TendonLimits.of(ARM, [1.0, 2.0, 3.0, 4.0], 0.1, 2.0)
    rng = np.random.default_rng(0)
    T = np.array([arm_check.random_tensions(limits, rng) for _ in range(200)])
    assert (T >= 0.1 - 1e-15).all()
    assert (np.array(limits.upper) >= T).all()
    assert T.sum(axis=1).max() <= 2.0 + 1e-12
    assert 0.3 < np.mean(T == 0.1) < 0.7


def test_shapes_under_loads_agree_in_all_ways() -> None:
    loads = Weight(), PointMass(0.2, 1e-3), Current((0.0, 0.05, 0.0))
    result = check_arm(ARM, Scene(Extension(), *loads), 0.5, samples=2)
    assert result.passed
    names = [each.name for each in result.comparisons]
    assert names[-3:] == ["other integrator", "base and loads rotated", "loads after tensions"]
    assert all(len(each.disagreements) == 2 for each in result.comparisons)
    assert "2 of 2 tension sets settle, 0 do not" in result.outcome


def test_a_wrong_coarse_shape_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(arm: Arm, T: Any, scene: Scene, accuracy: float = 1e-6, **more: Any) -> Any:
        bent = np.multiply(T, 1.2) if accuracy == 1e-4 else T
        return settle(arm, bent, scene, accuracy, **more)

    monkeypatch.setattr(arm_check, "settle", wrong)
    result = check_arm(ARM, Scene(), 1.0, samples=3)
    assert not result.passed
    assert [each.name for each in result.comparisons if each.n_beyond] == ["accuracy 1e-04"]
    assert "disagree" in result.outcome


def test_refusals_that_differ_in_numbers_are_one_kind() -> None:
    result = check_arm(ARM, Scene(Extension()), 1e3, samples=6)
    assert len(result.refusals) > 1
    ((count, text),) = result.reasons()
    assert count == len(result.refusals)
    assert "crushed" in text


@pytest.mark.parametrize(
    ("field", "options"),
    [
        ("tension_max", {"tension_max": np.inf}),
        ("samples", {"samples": 0}),
        ("seed", {"seed": -1}),
    ],
)
def test_bad_arguments_are_named(field: str, options: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=field):
        check_arm(ARM, Scene(), **{"tension_max": 1.0, **options})


def test_the_command_prints_the_outcome_and_draws(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "scene.toml"
    path.write_text("[arm]\npreset = 'section-5.2'\n[limits]\ntension_max = 0.5\n")
    out = tmp_path / "out"
    assert main(["check", str(path), "--samples", "2", "--out", str(out)]) == 0
    assert capsys.readouterr().out.startswith("2 of 2 tension sets settle")
    assert (out / "check.png").stat().st_size > 10_000
    found = json.loads((out / "check.json").read_text())
    assert found["passed"]
    assert np.shape(found["tensions_N"]) == (2, 4)
    path.write_text("[arm]\npreset = 'section-5.2'\n")
    assert main(["check", str(path)]) == 2
    assert "limits: missing" in capsys.readouterr().err
