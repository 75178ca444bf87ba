"""Results of sweeps: the numbers of single calls for any workers, and rows for failures."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray

from octoplan import planner
from octoplan.model import Arm, InputError, OctoplanError, Scene, settle
from octoplan.model.effects import Extension
from octoplan.model.support.errors import MissingExtraError
from octoplan.planner.frontends.cli import main
from octoplan.planner.frontends.sweeps.definition import load_sweep
from tests.sweeps.cases import DRAWN, GRID, STIFFNESS, tensions, written

ARM = Arm.from_paper("table-4")
SCENE = Scene(Extension())


@pytest.mark.slow
def test_two_jobs_find_what_one_finds(tmp_path: Path) -> None:
    path = written(tmp_path, GRID + STIFFNESS + DRAWN, more="draws = 10")
    one, two = planner.sweep(path), planner.sweep(path, jobs=2)
    assert one.identical(two)


@pytest.mark.slow
def test_plans_depend_neither_on_jobs_nor_on_the_plans_before(tmp_path: Path) -> None:
    axis = (
        '[[sweep.axes]]\nkey = "target.position_mm[1]"\nvalues = [140.0, 150.0, 900.0]\nname = "y"'
    )
    data = planner.sweep(written(tmp_path, axis, "plan"), jobs=2)
    assert data.reached.values.tolist() == [True, True, False]
    assert "Not reached" in data.outcome.sel(y=900.0).item()
    assert data.identical(planner.sweep(written(tmp_path, axis, "plan")))
    alone = planner.sweep(written(tmp_path, axis.replace("140.0, ", ""), "plan"))
    assert alone.equals(data.isel(y=slice(1, None)))


@pytest.mark.slow
def test_a_long_list_of_values_is_saved_with_its_text(tmp_path: Path) -> None:
    values = np.linspace(0.1, 0.5, 8000).tolist()
    axis = f'[[sweep.axes]]\nkey = "tensions[0][2]"\nvalues = {values}'
    data = planner.sweep(written(tmp_path, axis), tmp_path / "out.nc")
    assert len(data.attrs["sweep_file"]) > 2**16
    assert xarray.load_dataset(tmp_path / "out.nc").identical(data)


FAILING = """
[[sweep.axes]]
key = "tensions[0][2]"
values = [0.1, 0.2, 500.0, 0.3]
"""


@pytest.mark.slow
def test_points_that_fail_among_others_of_their_chunk_are_as_settle_has_them(
    tmp_path: Path,
) -> None:
    low_to_crushing = 'distribution = "uniform"\nlow = 0.0\nhigh = 16.0\n'
    axes = f'[[sweep.axes]]\nkey = "tensions[0][2]"\n{low_to_crushing}'
    path = written(tmp_path, axes, more="draws = 64")
    assert load_sweep(path).chunk > 1
    data = planner.sweep(path)
    assert 5 < data.settled.sum() < 60
    for i in range(64):
        T, row = tensions(), data.isel(draw=i)
        T[0, 2] = row["tensions[0][2]"]
        try:
            shape = settle(ARM, T, SCENE)
        except OctoplanError as reason:
            assert row.outcome == f"Failed: {reason}"
            assert not row.settled
            assert np.isnan([row.error, *row.tip, *row.tensions]).all()
        else:
            assert row.outcome == "Settled."
            np.testing.assert_allclose(row.tip, shape.tip, atol=1e-12)


@pytest.mark.quick("settle-.zarr", "stiffness-.nc")
@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
@pytest.mark.parametrize("compute", ["settle", "stiffness"])
def test_a_dataset_comes_back_from_its_file_with_units(
    tmp_path: Path, suffix: str, compute: str
) -> None:
    out = tmp_path / f"out{suffix}"
    path = written(tmp_path, GRID + STIFFNESS, compute)
    data = planner.sweep(path, out)
    loaded = xarray.load_dataset(out)
    assert loaded.identical(data)
    assert loaded.tip.attrs["units"] == "m"
    assert loaded["arm.E_kPa"].attrs["units"] == "kPa"
    assert loaded["tensions[0][2]"].attrs["units"] == loaded.tensions.attrs["units"] == "N"
    assert loaded.attrs["sweep_file"] == path.read_text()
    assert {"octoplan_version", "casadi_version", "numpy_version"} <= set(loaded.attrs)
    assert {p.name for p in tmp_path.iterdir()} == {"scene.toml", "sweep.toml", out.name}


@pytest.mark.quick(".nc")
@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_a_dataset_takes_the_place_of_an_older_one(tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"out{suffix}"
    planner.sweep(written(tmp_path, STIFFNESS), out)
    data = planner.sweep(written(tmp_path, GRID), out)
    assert xarray.load_dataset(out).identical(data)


def test_texts_and_switches_vary_too(tmp_path: Path) -> None:
    axes = """
    [[sweep.axes]]
    key = "arm.preset"
    values = ["table-4", "table-2"]
    [[sweep.axes]]
    key = "effects.extension"
    values = [true, false]
    """
    data = planner.sweep(written(tmp_path, axes), tmp_path / "out.nc")
    loaded = xarray.load_dataset(tmp_path / "out.nc")
    assert loaded.identical(data)
    bare = loaded.sel({"arm.preset": "table-2", "effects.extension": False})
    tip = settle(Arm.from_paper("table-2"), tensions(), Scene()).tip
    assert bare.tip.values.tolist() == tip.tolist()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"out": "out.csv"}, ".nc"),
        ({"out": "nowhere/out.nc"}, "an existing folder"),
        ({"jobs": 0}, "whole number from 1"),
        ({"jobs": True}, "whole number from 1"),
        ({"scheduler": "nonsense://x"}, "tcp://HOST:PORT"),
    ],
)
def test_arguments_that_are_not_allowed_are_told(
    tmp_path: Path, arguments: dict, told: str
) -> None:
    arguments = {k: tmp_path / v if k == "out" else v for k, v in arguments.items()}
    with pytest.raises(InputError, match=told):
        planner.sweep(written(tmp_path, GRID), **arguments)


@pytest.mark.parametrize(
    ("package", "extra", "arguments"),
    [
        ("xarray", "sweep", {}),
        ("h5netcdf", "sweep", {"out": "out.nc"}),
        ("zarr", "zarr", {"out": "out.zarr"}),
        ("joblib", "sweep", {"jobs": 2}),
        ("dask", "sweep", {}),
        ("distributed", "cluster", {"scheduler": "tcp://127.0.0.1:1"}),
    ],
)
def test_a_missing_extra_is_told_with_the_command_that_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str, extra: str, arguments: dict
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    arguments = {k: tmp_path / v if k == "out" else v for k, v in arguments.items()}
    with pytest.raises(MissingExtraError, match=rf"{package} .*pip install 'octoplan\[{extra}\]'"):
        planner.sweep(written(tmp_path, GRID), **arguments)


def test_the_command_tells_what_became_of_the_points(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, FAILING)
    assert main(["sweep", str(path)]) == 0
    assert "3 of 4 points settled" in capsys.readouterr().out
    assert main(["sweep", str(path), "--json", "--out", str(tmp_path / "x.zarr")]) == 0
    record = json.loads(capsys.readouterr().out)
    assert (record["points"], record["met"]) == (4, 3)
    assert list(record["failures"].values()) == [1]
    assert (tmp_path / "sweep.nc").is_file()
    assert (tmp_path / "x.zarr").is_dir()


def test_the_command_tells_a_bad_key_and_returns_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, GRID.replace("tensions[0]", "tensions[9]"))
    assert main(["sweep", str(path)]) == 2
    assert "[0] to [2]" in capsys.readouterr().err
    assert not (tmp_path / "sweep.nc.chunks").exists()


def test_scene_and_sweep_files_taken_for_each_other_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, GRID)
    assert main(["sweep", str(tmp_path / "scene.toml")]) == 2
    told = capsys.readouterr().err
    assert "sweep: missing; `octoplan new --kind sweep FILE` writes" in told
    first = tmp_path / "first.toml"
    assert main(["new", "--kind", "sweep", str(first)]) == main(["sweep", str(first)]) == 0
    assert main(["plan", str(path)]) == 2
    assert f"`octoplan sweep {path}`" in capsys.readouterr().err
