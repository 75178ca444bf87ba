"""Axes of sweeps: grids, draws and key paths, and refusals before the run."""

import re
from pathlib import Path

import numpy as np
import pytest

from octoplan.model.support.errors import FileError
from octoplan.planner.frontends.sweeps.definition import load_sweep
from tests.sweeps.cases import DRAWN, GRID, STIFFNESS, written


def _axis(**keys: object) -> str:
    lines = [f"{key} = {value!r}" for key, value in keys.items()]
    return "\n".join(["[[sweep.axes]]", *lines]).replace("'", '"') + "\n"


def _points(folder: Path, axes: str, more: str = "") -> list[tuple]:
    asked = load_sweep(written(folder, axes, more=more))
    return [point for chunk in range(asked.chunks) for point in asked.points(chunk)]


def test_grids_are_multiplied_and_draws_go_with_each_point(tmp_path: Path) -> None:
    points = _points(tmp_path, GRID + STIFFNESS + DRAWN, "draws = 2")
    assert len(points) == 3 * 2 * 2
    drawn = points[0][2], points[1][2]
    expected = [(t, E, x) for t in (0.0, 0.25, 0.5) for E in (100.0, 120.0) for x in drawn]
    assert points == expected


def test_drawn_axes_are_drawn_jointly(tmp_path: Path) -> None:
    other = DRAWN.replace("[1][0]", "[2][1]")
    points = _points(tmp_path, DRAWN + other, "draws = 5")
    assert len(points) == 5
    assert all(a != b for a, b in points)


def test_a_seed_decides_the_draws_and_another_axis_does_not_change_them(tmp_path: Path) -> None:
    alone = [p[0] for p in _points(tmp_path, DRAWN, "draws = 4\nseed = 7")]
    other = DRAWN.replace("[1][0]", "[2][1]")
    assert [p[1] for p in _points(tmp_path, other + DRAWN, "draws = 4\nseed = 7")] == alone
    assert [p[0] for p in _points(tmp_path, DRAWN, "draws = 4\nseed = 8")] != alone


@pytest.mark.parametrize(
    ("keys", "quantiles"),
    [
        ({"distribution": "uniform", "low": 1.0, "high": 3.0}, [1.5, 2.0, 2.5]),
        ({"distribution": "log-uniform", "low": 1.0, "high": 16.0}, [2.0, 4.0, 8.0]),
        ({"distribution": "normal", "mean": 5.0, "sd": 0.5}, [4.6628, 5.0, 5.3372]),
        # Cut off at its mean, half a normal distribution remains: quantiles 5/8, 6/8, 7/8 of all.
        (
            {"distribution": "normal", "mean": 5.0, "sd": 1.0, "low": 5.0, "high": 99.0},
            [5.3186, 5.6745, 6.1503],
        ),
    ],
)
def test_draws_have_the_quartiles_of_their_distribution(
    tmp_path: Path, keys: dict, quantiles: list[float]
) -> None:
    points = _points(tmp_path, _axis(key="tensions[1][0]", **keys), "draws = 20000")
    assert np.quantile(points, [0.25, 0.5, 0.75]) == pytest.approx(quantiles, rel=0.02)


@pytest.mark.parametrize(
    ("key", "value", "unit"),
    [
        ("tensions[0][2]", 0.25, "N"),
        ("arm.E_kPa", 100.0, "kPa"),
        ("arm.nu", 0.4, ""),
        ("target.position_mm[1]", 100.0, "mm"),
        ("limits.tension_max", 15.0, "N"),
        ("limits.total_pull", 40.0, "N"),
        ("accuracy", 1e-5, ""),
    ],
)
def test_key_paths_find_values_and_their_units(
    tmp_path: Path, key: str, value: float, unit: str
) -> None:
    axis = load_sweep(written(tmp_path, _axis(key=key, values=[value]))).axes[0]
    assert (axis.key, axis.extremes, axis.unit) == (key, [value], unit)


@pytest.mark.parametrize(
    ("key", "told"),
    [
        ("arm.E_kpa", 'one of preset, .* in arm; did you mean "E_kPa"?'),
        ("arms.E_kPa", "one of .* arm, effects, .* in the scene"),
        ("tensions[3][0]", r"in tensions \[0\] to \[2\]"),
        ("tensions[0][4]", r"in tensions\[0\] \[0\] to \[3\]"),
        ("tensions[0]", r"a single value, not all of tensions\[0\]: tensions\[0\]\[0\], "),
        ("arm", "a single value, not all of arm: arm.preset, "),
        ("effects.tip_load.force[2]", "add effects.tip_load to the scene"),
        ("effects.tip_load", "add effects.tip_load to the scene"),
        ("effects.extension.on", "effects.extension, which is a single value"),
        ("arm.sections[0].at_mm", "add arm.sections to the scene"),
        ("tensions[-1]", "a path such as arm.E_kPa"),
        ("", "a path such as arm.E_kPa"),
    ],
)
def test_a_bad_key_path_is_refused_saying_what_is_allowed(
    tmp_path: Path, key: str, told: str
) -> None:
    with pytest.raises(FileError, match=told) as caught:
        load_sweep(written(tmp_path, _axis(key=key, values=[1.0])))
    assert caught.value.where.startswith("sweep.axes[0]")


E0 = 'key = "arm.E_kPa"'


@pytest.mark.parametrize(
    ("axes", "more", "told"),
    [
        (f"[[sweep.axes]]\n{E0}", "", "values; or start, stop and count; or distribution"),
        (f"[[sweep.axes]]\n{E0}\nvalues = []", "", "at least 1"),
        (f"[[sweep.axes]]\n{E0}\nvalues = [1.0]\nstart = 2.0", "", "values; or start"),
        (
            f"[[sweep.axes]]\n{E0}\nvalues = [100.0, -1.0]",
            "",
            "E_kPa = -1.0: arm.E_kPa = .*above 0",
        ),
        (f'[[sweep.axes]]\n{E0}\nvalues = [100.0, "soft"]', "", "all numbers, all texts"),
        (f'[[sweep.axes]]\n{E0}\ndistribution = "normal"\nlow = 1.0', "draws = 2", "mean, sd"),
        (f'[[sweep.axes]]\n{E0}\ndistribution = "uniform"\nlow = 1.0\nhigh = 2.0', "", "draws = N"),
        (
            f'[[sweep.axes]]\n{E0}\ndistribution = "uniform"\nlow = 3.0\nhigh = 2.0',
            "draws = 2",
            "above low",
        ),
        (
            f'[[sweep.axes]]\n{E0}\ndistribution = "log-uniform"\nlow = 0.0\nhigh = 2.0',
            "draws = 2",
            "above 0",
        ),
        (f'[[sweep.axes]]\n{E0}\ndistribution = "cauchy"', "draws = 2", "log-uniform"),
        (STIFFNESS + STIFFNESS, "", "must differ from the other axes"),
        (STIFFNESS, "draws = 3", "no axis has a distribution"),
        (STIFFNESS + 'name = "tip"', "", "a name without /"),
        (STIFFNESS + "step = 1", "", "no such key"),
        ("", "axes = []", "at least 1"),
        (f"[[sweep.axes]]\n{E0}\nstart = 1.0\nstop = 2.0\ncount = 20000000", "", "up to 10000000"),
        (
            GRID.replace("3", "5000") + DRAWN,
            "draws = 5000",
            "must define at most 10000000 points, not 25000000",
        ),
    ],
)
def test_bad_axes_are_refused_saying_what_is_allowed(
    tmp_path: Path, axes: str, more: str, told: str
) -> None:
    with pytest.raises(FileError, match=told):
        load_sweep(written(tmp_path, axes, more=more))


def test_the_sweep_files_that_are_shipped_are_allowed() -> None:
    for path in (Path(__file__).parents[2] / "studies" / "sweep_files").glob("*.toml"):
        assert load_sweep(path).size == 15


def test_a_scene_in_the_sweep_file_is_told_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "sweep.toml"
    path.write_text(f'[scene.arm]\npreset = "table-9"\n[sweep]\ncompute = "settle"\n{GRID}')
    with pytest.raises(FileError, match=re.escape("scene.arm.preset")):
        load_sweep(path)


@pytest.mark.parametrize(
    ("compute", "told"), [("settle", "scene.tensions: missing"), ("plan", "scene.target: missing")]
)
def test_a_scene_must_have_what_is_computed_of_it(tmp_path: Path, compute: str, told: str) -> None:
    path = tmp_path / "sweep.toml"
    path.write_text(f'scene.arm.preset = "table-4"\n[sweep]\ncompute = "{compute}"\n{STIFFNESS}')
    with pytest.raises(FileError, match=told):
        load_sweep(path)
