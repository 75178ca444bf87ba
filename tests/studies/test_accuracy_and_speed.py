"""The studies of accuracy and speed run small; what they measure with is held to closed forms."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from model import Arm, InputError, Scene, settle
from model.effects import Buoyancy, Extension, TipLoad, Weight
from planner.plots.work import Curve, plot_work
from studies import accuracy_cost, draws, knob, speed
from studies.baseline_loads import ScipyLoadedArm
from studies.baselines import ScipyArm
from studies.timing import Spread

ARM = Arm.from_paper("table-4")


def test_accuracy_cost_prints_its_tables_and_saves_its_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = ["--cases", "1", "--repeats", "1", "--targets", "1", "--finest", "1"]
    accuracy_cost.main([*small, "--settings", "1", "--out", str(tmp_path)])
    shown = capsys.readouterr().out
    assert "settle's choice" in shown
    assert "SciPy solve_bvp" in shown
    for name in ("accuracy_cost.png", "accuracy_cost_dearer.png", "accuracy_cost_plans.png"):
        assert (tmp_path / name).stat().st_size > 10_000


@pytest.mark.slow
def test_speed_prints_its_rows(capsys: pytest.CaptureFixture[str]) -> None:
    small = ["--repeats", "1", "--arms", "1", "--batch", "4", "--plans", "1", "--points", "2"]
    speed.main([*small, "--rows", "settle", "loads", "path", "floors", "--sections", "1", "2"])
    shown = capsys.readouterr().out
    for work in ("settle_many", "weight in water", "warm", "iteration of ipopt"):
        assert work in shown


@pytest.mark.slow
def test_speed_prints_the_rows_that_take_longer(capsys: pytest.CaptureFixture[str]) -> None:
    small = ["--repeats", "1", "--arms", "1", "--plans", "1", "--sections", "1", "2"]
    speed.main([*small, "--rows", "jacobian", "sections", "plan", "first"])
    shown = capsys.readouterr().out
    for work in ("tip Jacobian", "plan of a tip", "sections 1, 2", "first plan"):
        assert work in shown


def test_the_knob_keeps_its_word_in_every_scene(capsys: pytest.CaptureFixture[str]) -> None:
    cases = knob.run(len(knob.SCENES), np.random.default_rng(1), priced=False)
    assert {case.scene_name for case in cases} == set(knob.SCENES)
    assert all(case.true <= case.stated <= case.asked for case in cases)
    knob.report(cases)
    assert "100.0%" in capsys.readouterr().out


@pytest.mark.parametrize("way", ["shoot", "collocate"])
def test_the_loaded_baseline_settles_as_the_project_does(way: str) -> None:
    T = draws.tensions(ARM, np.random.default_rng(0))
    scene = Scene(Extension(), Weight(), Buoyancy(1000.0), TipLoad((0.001, 0.0, 0.001)))
    scipy = ScipyLoadedArm(ARM, np.array([0.001, 0, 0.001]), np.array([0, 0, -9.81]), 1000.0)
    off = getattr(scipy, way)(T, 1e-6) - settle(ARM, T, scene, 1e-9).tip
    assert np.linalg.norm(off) < 1e-6 * ARM.length


def test_the_unloaded_baseline_settles_as_the_project_does() -> None:
    T = draws.tensions(ARM, np.random.default_rng(0))
    off = ScipyArm(ARM).tip(T, rtol=1e-10) - settle(ARM, T, Scene(Extension()), 1e-10).tip
    assert np.linalg.norm(off) < 1e-9 * ARM.length


def test_random_tensions_strain_arms_of_any_number_of_sections_alike() -> None:
    for n in (1, 4):
        arm = draws.many_sections(n)
        area = np.pi * arm.radius.evaluate(np.array([0.45 / n]), 0.45)[0] ** 2
        crossing = draws.most(arm).sum()
        assert crossing == pytest.approx(0.8 * arm.material.E * area[0])


def test_a_work_precision_diagram_shows_quartiles_and_failures() -> None:
    rows = np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 6.0]])
    figure = plot_work([Curve("a", rows, rows[::-1], np.array([5.0]))], "time [ms]", "error")
    assert isinstance(figure, Figure)
    ax = figure.axes[0]
    assert ax.get_xscale() == ax.get_yscale() == "log"
    crosses = [line for line in ax.lines if line.get_marker() == "x"]
    assert crosses[0].get_xdata().tolist() == [5.0]
    with pytest.raises(InputError, match="at least one Curve"):
        plot_work([], "time [ms]", "error")


def test_a_spread_is_a_median_and_its_quartiles() -> None:
    assert Spread.of([1.0, 2.0, 3.0, 4.0, 5.0]) == Spread(2.0, 3.0, 4.0)
