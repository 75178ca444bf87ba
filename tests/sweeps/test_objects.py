"""Sweeps of arms, scenes and targets that are objects; sweeps that are finished already."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, InputError, Scene
from octoplan.model.effects import (
    Extension,
    Weight,
)
from octoplan.planner import sweep
from octoplan.planner.frontends.cli import main
from octoplan.planner.targets import (
    BendingPlane,
)
from tests.sweeps.cases import GRID, tensions, written

ARM = Arm.from_paper("table-4")
PAPER = Scene(Extension())


@pytest.mark.slow
def test_plans_and_draws_too(tmp_path: Path) -> None:
    target = BendingPlane(np.radians(135.0), np.radians(40.0))
    drawn = {"distribution": "uniform", "low": 30.0, "high": 50.0}
    asked: dict[str, Any] = {"scene": PAPER, "target": target, "tension_max": 20.0}
    out = tmp_path / "plans.nc"
    found = sweep(ARM, out, axes={"target.bend_deg": drawn}, draws=2, seed=3, **asked)
    assert found.reached.values.all()
    assert found.effort.values.shape == (2,)
    assert not np.isclose(*found.effort.values)
    again = sweep(ARM, axes={"target.bend_deg": drawn}, draws=2, seed=3, **asked)
    assert np.array_equal(again.tensions.values, found.tensions.values)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({}, "axes"),
        ({"axes": {"arm.E_MPa": [1.0]}, "tensions": [0.0] * 12}, 'did you mean "E_kPa"'),
        ({"axes": {"arm.E_kPa": [1.0]}, "scene": "silicone"}, "scene"),
        ({"axes": {"arm.E_kPa": [1.0]}, "tension": 3}, "no such key"),
        ({"axes": {"arm.E_kPa": [1.0]}}, "scene.tensions: missing: must be tensions = [[0.0"),
        ({"axes": {"arm.E_kPa": [1.0]}, "target": 3}, "must be one of"),
    ],
)
def test_bad_input_is_told(options: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError) as caught:
        sweep(ARM, **options)
    assert told in str(caught.value)


def test_a_file_and_objects_do_not_mix(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="omitted with a sweep file"):
        sweep(written(tmp_path, GRID), axes={"arm.E_kPa": [1.0]})


@pytest.mark.quick(".nc")
@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_a_finished_sweep_is_not_run_again_and_says_so(
    suffix: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path, out = written(tmp_path, GRID), tmp_path / f"out{suffix}"
    argv = ["sweep", str(path), "--out", str(out), "--json"]
    assert main(argv) == 0
    first = json.loads(capsys.readouterr().out)

    def never(*_: Any) -> Any:
        raise AssertionError("run again")

    with monkeypatch.context() as patch:
        patch.setattr("octoplan.planner.frontends.sweeps.points.Job.rows", never)
        assert main(argv) == 0
        assert json.loads(capsys.readouterr().out) == first | {"earlier": True}
        assert main(argv[:-1]) == 0
        assert "finished by an earlier run, nothing was computed" in capsys.readouterr().out
        with caplog.at_level(logging.INFO, "octoplan.planner.frontends.sweeps"):
            found = sweep(path, out)
        assert found.settled.values.all()
        assert f"{out} contains this sweep already" in caplog.text
        found.close()
    written(tmp_path, GRID.replace("0.5", "0.6"))
    assert main(argv) == 0
    assert json.loads(capsys.readouterr().out)["earlier"] is False


def test_a_scene_as_printed_is_refused_by_name(tmp_path: Path) -> None:
    given: dict[str, Any] = {"axes": {"arm.E_kPa": [100.0]}, "tensions": tensions()}
    with pytest.raises(InputError, match="settle in a scene as printed"):
        sweep(ARM, scene=Scene.as_printed(), **given)
    axis = '[[sweep.axes]]\nkey = "effects.as_printed"\nvalues = [false, true]'
    with pytest.raises(InputError, match="settle in a scene as printed"):
        sweep(written(tmp_path, axis))


def test_a_time_limit_is_that_of_each_point() -> None:
    given: dict[str, Any] = {"scene": Scene.silicone(Weight()), "tensions": tensions()}
    data = sweep(ARM, axes={"arm.E_kPa": [100.0, 120.0]}, time_limit=1e-6, **given)
    assert not data.settled.any()
    assert all("1e-06 s" in outcome for outcome in data.outcome.values)
    assert json.loads(data.attrs["scene"])["time_limit_s"] == 1e-6
    with pytest.raises(InputError, match="time_limit"):
        sweep(ARM, axes={"arm.E_kPa": [100.0]}, time_limit=0.0, **given)


def test_an_output_that_is_no_path_is_refused_by_name() -> None:
    with pytest.raises(InputError, match="out = 3: must be the name of a file or folder"):
        sweep(ARM, 3, axes={"arm.E_kPa": [100.0]}, tensions=tensions())  # type: ignore[arg-type]
