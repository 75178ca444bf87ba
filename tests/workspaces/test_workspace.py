"""Workspaces of arms whose reachable tips have a closed form, interruptions, and bad input."""

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.optimize import minimize

from octoplan import (
    Anchorage,
    Arm,
    Contact,
    Extension,
    InputError,
    Limits,
    Linear,
    Material,
    Scene,
    Sphere,
    Weight,
    workspace,
)
from octoplan.model.support.errors import MissingExtraError, OctoplanError
from octoplan.planner.frontends.cli import main
from octoplan.planner.frontends.plots import plot_workspace
from octoplan.planner.frontends.workspaces.gaps import Classified
from octoplan.planner.frontends.workspaces.points import WorkspaceJob
from octoplan.planner.frontends.workspaces.sampling import sampled_tensions
from octoplan.planner.limits import TendonLimits

L, R, Y, E = 0.3, 0.01, 0.006, 2e5
EJ, EA = E * np.pi * R**4 / 4, E * np.pi * R**2
PULL = 1.5


def _cylinder(degrees: tuple[float, ...]) -> Arm:
    """Return an arm of one section with straight tendons; the base is along x."""
    return Arm(
        length=L,
        radius=Linear(R, R),
        sections=(Anchorage(L, Linear(Y, Y), tuple(np.radians(degrees))),),
        material=Material(E=E, nu=0.5, density=1000.0),
    )


PLANAR = _cylinder((0.0, 180.0))
FOUR = _cylinder((0.0, 90.0, 180.0, 270.0))
FEW = {"tension_max": PULL, "samples": 6, "probes": 6, "accuracy": 1e-6}


def _arc(bend: np.ndarray, length: float) -> np.ndarray:
    """Return the tip (x, lateral) of a circular arc that turns by a vector (lateral) [rad]."""
    angle = np.linalg.norm(bend) + 1e-12
    lateral = length * (1 - np.cos(angle)) / angle * bend / angle
    return np.array([length * np.sin(angle) / angle, *lateral])


def _nearest(tip: Callable[[np.ndarray], np.ndarray], bounds: Any, target: np.ndarray) -> float:
    """Return the distance of a target from the tips of bounded numbers, by a grid and scipy."""
    lines = [np.linspace(low, high, 21) for low, high in bounds]
    grid = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, len(bounds))
    gaps = [float(np.linalg.norm(tip(z) - target)) for z in grid]
    best = min(gaps)
    for start in np.argsort(gaps)[:4]:
        found = minimize(
            lambda z: np.sum((tip(z) - target) ** 2) / L**2,
            grid[start],
            bounds=bounds,
            tol=1e-16,
        )
        best = min(best, float(np.sqrt(found.fun)) * L)
    return best


@cache
def _solid() -> Any:
    """Return the workspace of four tendons on a body that can shorten."""
    return workspace(FOUR, Scene(Extension()), **FEW | {"samples": 12, "probes": 5})


def _boundary(data: Any) -> list[tuple[np.ndarray, float]]:
    """Return targets and distances of the nearest tips."""
    part = data.isel(point=data.kind.values == "boundary")
    misses = np.linalg.norm(part.tip.values - part.target.values, axis=1)
    return list(zip(part.target.values, misses, strict=True))


def test_boundary_of_a_bending_arm_is_its_circular_arcs() -> None:
    """Without extension one number, the curvature, is between those of a single pull."""
    data = workspace(PLANAR, Scene(), **FEW)
    most = Y * PULL / (EJ + Y**2 * PULL) * L
    found = _boundary(data)
    assert len(found) >= 4
    assert data.attrs["planar"] == 1
    for target, miss in found:
        flat = np.array([target[0], target[1:].sum()])
        exact = _nearest(lambda z: _arc(z, L), [(-most, most)], flat)
        assert abs(miss - exact) <= 2e-5 * L
    assert data.dexterity.max() <= 1e-6


@pytest.mark.slow
def test_boundary_of_an_extensible_arm_is_its_closed_form() -> None:
    """The curvature and the stretch of two antagonists fill a part of the plane."""
    data = workspace(PLANAR, Scene(Extension()), **FEW)

    def tip(T: np.ndarray) -> np.ndarray:
        k = Y * (T[0] - T[1]) / (EJ + Y**2 * T.sum())
        q = -(T[0] * (1 - Y * k) + T[1] * (1 + Y * k)) / EA
        return _arc(np.array([k * L * (1 + q)]), L * (1 + q))

    found = _boundary(data)
    assert len(found) >= 3
    for target, miss in found:
        flat = np.array([target[0], target[1:].sum()])
        assert abs(miss - _nearest(tip, [(0, PULL)] * 2, flat)) <= 2e-5 * L


def test_boundary_of_four_tendons_is_the_dome_of_circular_arcs() -> None:
    """Pairs of tendons bend about n and b independently."""
    data = workspace(FOUR, Scene(), **FEW | {"probes": 8})
    most = Y * PULL / (EJ + Y**2 * PULL) * L
    found = _boundary(data)
    assert len(found) >= 5
    assert data.attrs["planar"] == 0
    for target, miss in found:
        exact = _nearest(lambda z: _arc(z, L), [(-most, most)] * 2, target)
        assert abs(miss - exact) <= 2e-5 * L
    assert data.settled.all()


def test_effort_is_the_least_for_the_tip() -> None:
    """A single pull bends a planar arm to each tip; opposed pulls are wasted."""
    few = FEW | {"samples": 6, "probes": 0}
    data = workspace(PLANAR, Scene(), **few)
    drawn = workspace(PLANAR, Scene(), **few, least_effort=False)
    for row in range(6):
        x, *lateral = drawn.tip.values[row]
        bend = 2 * np.arctan2(np.linalg.norm(lateral), x)
        k = bend / L
        least = k * EJ / (Y * (1 - Y * k))
        assert data.effort.values[row] == pytest.approx(least, abs=2e-4)
        assert drawn.effort.values[row] >= least - 2e-4
        np.testing.assert_allclose(data.tip.values[row], drawn.tip.values[row], atol=1e-5 * L)


def test_stiffness_and_manipulability_of_a_straight_cylinder() -> None:
    """A cantilever has the tip stiffness 3 E J / L^3; a pull of T bends it by T y L / (E J)."""
    data = workspace(FOUR, Scene(), **FEW | {"samples": 1, "probes": 0})
    assert data.stiffness_min.values[0] == pytest.approx(3 * EJ / L**3, rel=1e-4)
    gain = np.sqrt(2) * Y * L**2 / (2 * EJ)
    np.testing.assert_allclose(data.tip_gain.values[0], [gain, gain, 0], rtol=1e-5, atol=1e-9)


def test_mirror_images_of_tips_are_outside_of_empty_balls() -> None:
    """A symmetric arm reaches the mirror images of its tips."""
    data = _solid()
    part = data.isel(point=data.kind.values == "boundary")
    tips = data.tip.values[data.settled.values]
    state = Classified(tips, part.target.values, part.empty_radius.values)
    for mirror in ([1, -1, 1], [1, 1, -1], [1, -1, -1]):
        assert state.emptiness(tips * mirror).max() <= 1e-5 * L
    swapped = tips[:, [0, 2, 1]]
    assert state.emptiness(swapped).max() <= 1e-5 * L


def test_interrupted_workspace_resumes_to_the_same_dataset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = FEW | {"samples": 17, "probes": 3, "least_effort": False}
    whole = workspace(PLANAR, Scene(), **few)
    rows = WorkspaceJob.rows
    computed: list[int] = []

    def interrupted(job: WorkspaceJob, points: Any) -> Any:
        if len(computed) == 3:
            raise KeyboardInterrupt
        computed.append(len(points))
        return rows(job, points)

    out = tmp_path / "out.nc"
    with monkeypatch.context() as patch:
        patch.setattr(WorkspaceJob, "rows", interrupted)
        with pytest.raises(KeyboardInterrupt):
            workspace(PLANAR, Scene(), **few, out=out)
    assert not out.exists()
    seen: list[int] = []
    with monkeypatch.context() as patch:
        patch.setattr(WorkspaceJob, "rows", lambda *a: seen.append(1) or rows(*a))
        again = workspace(PLANAR, Scene(), **few, out=out).load()
        n_chunks = len(seen)
        workspace(PLANAR, Scene(), **few, out=out).close()
    assert len(seen) == n_chunks
    again.close()
    assert again.identical(whole)
    assert [path.name for path in tmp_path.iterdir()] == ["out.nc"]
    with pytest.raises(InputError, match="choose another output"):
        (tmp_path / "new.nc.chunks" / "samples").mkdir(parents=True)
        (tmp_path / "new.nc.chunks" / "samples" / "other-000000.npz").touch()
        workspace(PLANAR, Scene(), **few, out=tmp_path / "new.nc")


def test_refused_samples_are_counted_with_their_reason() -> None:
    soft = replace(FOUR, material=replace(FOUR.material, E=2e4))
    few = {"samples": 16, "probes": 0, "least_effort": False}
    data = workspace(soft, Scene(Extension()), tension_max=4.0, **few)
    reasons = json.loads(data.attrs["failures"])
    assert data.attrs["refused"] == sum(reasons.values()) > 0
    assert data.attrs["sample"] + data.attrs["refused"] == 16
    assert all("crushed" in text for text in reasons)
    assert np.isnan(data.tip.values[~data.settled.values]).all()


def test_samples_lie_on_faces_and_within_the_total() -> None:
    limits = TendonLimits.of(FOUR, [2.0, 1.0, 1.0, 1.0], 0.1, 2.5)
    T = sampled_tensions(FOUR, limits, 200, 0)
    assert T.min() >= 0.1 - 1e-12
    assert (T - limits.upper).max() <= 1e-12
    assert T.sum(axis=1).max() <= 2.5 + 1e-12
    assert np.isclose(T[:5, :], [[0.1] * 4, *(0.1 + np.diag([1.9, 0.9, 0.9, 0.9]))]).all()
    assert 0.1 < np.isclose(T, 0.1).mean() < 0.9
    np.testing.assert_array_equal(T, sampled_tensions(FOUR, limits, 200, 0))
    assert not np.array_equal(T, sampled_tensions(FOUR, limits, 200, 1))


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "no limit": ({}, r"tension_max = .*inf.*: must be finite"),
    "an infinite limit": ({"tension_max": [1.0, np.inf]}, r"tension_max = .*: must be finite"),
    "strokes": ({"tension_max": 1.0, "limits": Limits(stroke_max=0.01)}, "stroke_max.* omitted"),
    "one tendon too few": ({"tension_max": [1.0] * 3}, "tension_max"),
    "negative limit": ({"tension_max": -1.0}, "tension_max = -1.0: must be"),
    "minimum above maximum": (
        {"tension_max": 1.0, "limits": Limits(tension_min=2.0)},
        r"tension_min\[0\]",
    ),
    "no samples": ({"tension_max": 1.0, "samples": 0}, "samples = 0: must be a whole number"),
    "part of a sample": ({"tension_max": 1.0, "samples": 2.5}, "samples = 2.5: must be"),
    "negative probes": ({"tension_max": 1.0, "probes": -1}, "probes = -1: must be"),
    "negative seed": ({"tension_max": 1.0, "seed": -1}, "seed = -1: must be"),
    "effort": ({"tension_max": 1.0, "least_effort": "yes"}, "least_effort = 'yes': must be True"),
    "accuracy": ({"tension_max": 1.0, "accuracy": 0.0}, "accuracy = 0.0: must be"),
    "jobs": ({"tension_max": 1.0, "jobs": 0}, "jobs = 0: must be a whole number"),
    "time limit": ({"tension_max": 1.0, "time_limit": 0}, "time_limit = 0: must be"),
    "output": ({"tension_max": 1.0, "out": "points.csv"}, "out = 'points.csv': must be"),
    "contact": (
        {"tension_max": 1.0, "scene": Scene(Contact(Sphere((0.2, 0.0, 0.1), 0.05)))},
        "must be a scene without contact",
    ),
    "as printed": ({"tension_max": 1.0, "scene": Scene.as_printed()}, "as_printed|as printed"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused(case: str) -> None:
    arguments, message = BAD[case]
    with pytest.raises(InputError, match=message):
        workspace(PLANAR, **{"scene": Scene(Extension())} | arguments)


def test_arm_that_never_settles_is_refused_with_the_reason() -> None:
    with pytest.raises(OctoplanError, match=r"none of 3 sets of tensions .* crushed"):
        workspace(PLANAR, Scene(Extension()), 40.0, limits=Limits(tension_min=35.0), samples=3)


def test_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(MissingExtraError, match=r"octoplan\[sweep\]"):
        workspace(PLANAR, Scene(), 1.0)


SCENE = """
[arm]
length_mm = 300.0
radius_mm = [10.0, 10.0]
sections = [{ at_mm = 300.0, offset_mm = [6.0, 6.0], angles_deg = [0.0, 180.0] }]
E_kPa = 200.0
nu = 0.5
density = 1000.0
[limits]
tension_max = 1.5
"""


def test_command_writes_dataset_record_and_figure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    argv = ["workspace", str(tmp_path / "scene.toml"), "--samples", "3", "--probes", "5"]
    out = tmp_path / "out"
    assert main([*argv, "--out", str(out)]) == 0
    assert "on the boundary" in capsys.readouterr().out
    assert {path.name for path in out.iterdir()} == {
        f"workspace.{x}" for x in ("nc", "json", "png")
    }
    result = json.loads((out / "workspace.json").read_text())
    assert result["sample"] == 3
    assert result["probe"] + result["boundary"] == 5
    assert main([*argv, "--out", str(out)]) == 0
    assert "nothing was computed" in capsys.readouterr().out
    (tmp_path / "scene.toml").write_text(SCENE.partition("[limits]")[0])
    assert main(argv) == 2
    assert "limits: missing" in capsys.readouterr().err


def test_figures_refuse_other_data_values_and_axes() -> None:
    data = workspace(PLANAR, Scene(), **FEW | {"samples": 2, "probes": 0})
    ax = Figure().add_subplot()
    assert plot_workspace(data, "stiffness_min", ax) is ax
    bad = {"value": (data, "colour"), "data": (3,), "ax": (data, "effort", 3)}
    for name, arguments in bad.items():
        with pytest.raises(InputError, match=f"{name} = "):
            plot_workspace(*arguments)


@pytest.mark.slow
def test_figures_draw_slices_and_space() -> None:
    data = _solid()
    figure = plot_workspace(data, "dexterity")
    assert len(figure.axes) == 5
    ax = Figure().add_subplot(projection="3d")
    assert plot_workspace(data, ax=ax) is ax


@pytest.mark.slow
def test_two_jobs_find_the_workspace_of_one_under_weight() -> None:
    few = {"tension_max": 1.0, "samples": 24, "probes": 30}
    scene = Scene.silicone(Weight())
    one = workspace(FOUR, scene, **few)
    assert one.identical(workspace(FOUR, scene, **few, jobs=2))
    assert one.attrs["boundary"] >= 5
