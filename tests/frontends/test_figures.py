"""Figures show loads, all waypoints, equal tensions and compliances, and no label is cut off."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from octoplan.model import Anchorage, Arm, InputError, Linear, Material, Scene, settle
from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    LineLoad,
    PointLoad,
    PointMass,
    TipLoad,
    Weight,
)
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import HalfSpace
from octoplan.model.stiffness import stiffness
from octoplan.planner import trajectory
from octoplan.planner.extensions.trajectory.result import Trajectory
from octoplan.planner.frontends.plots.arm import best_view, draw_arm
from octoplan.planner.frontends.plots.ellipsoids import (
    magnification,
    plot_ellipsoids,
    visible_force,
)
from octoplan.planner.frontends.plots.motion import (
    animate_trajectory,
    equal_runs,
    plot_tensions_over_time,
    plot_trajectory,
)
from octoplan.planner.frontends.plots.obstacles import plane_patch
from octoplan.planner.frontends.plots.plan import plot_shape, plot_tensions
from octoplan.planner.limits import Limits
from octoplan.planner.targets import TipPosition

FOUR = tuple(np.radians([0, 90, 180, 270]))
SLIM = Arm(
    length=0.3,
    radius=Linear(0.006, 0.006),
    sections=(Anchorage(0.3, Linear(0.003, 0.003), FOUR),),
    material=Material(E=2e5, nu=0.5, density=1000.0),
)
HANGING = replace(SLIM, base_frame=((0, -1, 0), (0, 0, 1), (-1, 0, 0)))
PAPER = Scene(Extension())
PULL = [0.0, 0.3, 0.1, 0.0]
PAYLOAD = (Weight(), PointMass(0.15, 0.002), TipLoad((0.0, 0.0, -0.005)))
LOADED = Scene(
    Extension(),
    ExactTendons(),
    *PAYLOAD,
    Buoyancy(),
    Current((0.0, 0.05, 0.0)),
    PointLoad(0.2, (0.0, 0.0, 0.01)),
    LineLoad((0.02, 0.0, 0.0), begin=0.05, end=0.15),
)


def three_d() -> Any:
    return Figure().add_subplot(projection="3d")


def legend(ax: Any) -> set[str]:
    return set(ax.get_legend_handles_labels()[1])


@pytest.fixture(scope="module")
def motion() -> Trajectory:
    pulls = ([0.1, 0.5, 0.3, 0.1], [0.3, 0.1, 0.1, 0.4], [0.1, 0.1, 0.3, 0.3])
    targets = [TipPosition(tuple(settle(SLIM, T, PAPER).tip.tolist())) for T in pulls]
    return trajectory(SLIM, targets, PAPER, 5.0, limits=Limits(tension_min=0.1), rate_max=1.0)


def test_all_loads_of_a_scene_are_drawn_with_their_size() -> None:
    ax = three_d()
    draw_arm(settle(HANGING, PULL, LOADED), ax)
    assert legend(ax) == {
        "gravity 9.81 m/s², in a fluid of 1000 kg/m³",
        "mass of 2 g at s = 150 mm",
        "tip load 5 mN",
        "current 0.05 m/s",
        "point load 10 mN at s = 200 mm",
        "line load 20 mN/m",
    }


def test_loads_of_zero_are_not_drawn() -> None:
    ax = three_d()
    nothing = Scene(Extension(), Weight((0.0, 0.0, 0.0)), TipLoad())
    draw_arm(settle(SLIM, PULL, nothing), ax)
    assert legend(ax) == set()


def arrows(ax: Any, label: str) -> Any:
    handles, labels = ax.get_legend_handles_labels()
    return np.array(handles[labels.index(label)]._segments3d)


def test_the_arrow_of_a_follower_turns_with_the_tip() -> None:
    shape = settle(SLIM, PULL, Scene(ExactTendons(), TipLoad((0.0, 0.002, 0.0), follower=True)))
    ax = three_d()
    draw_arm(shape, ax)
    head, tail = arrows(ax, "follower load 2 mN")[0]
    np.testing.assert_allclose(tail, 1e3 * shape.tip, atol=1e-9)
    along = (head - tail) / np.linalg.norm(head - tail)
    np.testing.assert_allclose(along, shape.tip_frame[:, 1], atol=1e-12)


def test_arrows_of_forces_at_points_are_to_scale() -> None:
    loads = (PointLoad(0.1, (0.0, 0.004, 0.0)), PointLoad(0.2, (0.0, 0.0, 0.002)))
    ax = three_d()
    draw_arm(settle(SLIM, PULL, Scene(ExactTendons(), *loads)), ax)
    names = ("point load 4 mN at s = 100 mm", "point load 2 mN at s = 200 mm")
    large, small = (np.linalg.norm(np.ptp(arrows(ax, name)[0], axis=0)) for name in names)
    assert large == pytest.approx(2 * small)


def labels_inside(figure: Figure) -> bool:
    """Return whether ticks and labels of the 3-D axes lie in the figure, above the colour scale."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    ax, scale = figure.axes[0], figure.axes[-1]
    boxes = [axis.get_tightbbox(renderer) for axis in (ax.xaxis, ax.yaxis, ax.zaxis)]
    whole = figure.bbox
    floor = scale.get_tightbbox(renderer).y1
    return all(
        box.x0 >= whole.x0 and box.x1 <= whole.x1 and box.y1 <= whole.y1 and box.y0 >= floor - 1
        for box in boxes
    )


@pytest.mark.parametrize("arm", [SLIM, HANGING], ids=["flat", "hanging"])
def test_no_label_of_an_ellipsoid_figure_is_cut_off(arm: Arm) -> None:
    k = stiffness(arm, PULL, Scene(Extension(), ExactTendons(), *PAYLOAD))
    figure = k.plot()
    assert labels_inside(figure)
    assert figure.axes[-1].get_xlabel() == "tension [N]"


@pytest.mark.parametrize("length", [0.002, 0.02, 0.08, 0.24])
def test_tick_labels_of_two_axes_are_apart(length: float) -> None:
    """The first and last numbers of two axes meet at a corner of the box."""
    scale = length / 0.24
    thirds = np.radians([0, 120, 240])
    arm = Arm(
        length,
        Linear(0.014 * scale, 0.006 * scale),
        (
            Anchorage(length, Linear(0.009 * scale, 0.004 * scale), tuple(thirds)),
            Anchorage(length / 2, Linear(0.007 * scale, 0.007 * scale), tuple(thirds + 1)),
        ),
        Material(E=150e3, nu=0.5, density=1070.0),
        base_frame=HANGING.base_frame,
    )
    T = scale**2 * np.array([[1.0, 0.0, 0.0], [0.0, 1.5, 0.0]])
    figure = plot_shape(settle(arm, T, PAPER))
    assert isinstance(figure, Figure)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    boxes = []
    ax: Any = figure.axes[0]
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        low, high = axis.get_view_interval()
        ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
        assert ticks
        boxes.append([tick.label1.get_window_extent(renderer).padded(8.0) for tick in ticks])
    for one, other in combinations(boxes, 2):
        assert not any(box.count_overlaps(other) for box in one)


def test_the_legend_has_the_half_axes_of_ellipsoids() -> None:
    k = stiffness(SLIM, PULL, PAPER)
    ax = three_d()
    assert plot_ellipsoids([k], 1e-3, ax) is ax
    half = ", ".join(f"{each:.3g}" for each in k.ellipsoid()[0])
    assert any(
        name.startswith(f"tip, constant tensions: half axes {half} mm") for name in legend(ax)
    )


def test_the_default_force_makes_ellipsoids_visible() -> None:
    k = stiffness(SLIM, PULL, PAPER)
    reach = visible_force([k]) * k.ellipsoid()[0][0]
    assert 0.2 * SLIM.length / 2.5 <= reach <= 0.2 * SLIM.length


@pytest.mark.parametrize(
    ("share", "factor"), [(0.2, 1), (0.02, 1), (0.0199, 10), (0.00021, 100), (0.0, 1e11)]
)
def test_small_ellipsoids_are_magnified(share: float, factor: float) -> None:
    assert magnification(share) == pytest.approx(factor)


@pytest.mark.parametrize("force", [0.0, -1.0, np.nan, "1"])
def test_ellipsoids_refuse_forces_that_are_not_positive(force: Any) -> None:
    with pytest.raises(InputError, match="force"):
        plot_ellipsoids([stiffness(SLIM, PULL, PAPER)], force)


def test_two_shapes_of_ellipsoids_are_both_drawn() -> None:
    ax = three_d()
    both = [stiffness(SLIM, T, PAPER) for T in (PULL, [0.2, 0.0, 0.0, 0.4])]
    plot_ellipsoids(both, ax=ax)
    assert sum(each.get_array() is not None for each in ax.collections) == 2


def test_all_waypoints_of_a_motion_are_marked(motion: Trajectory) -> None:
    figure = plot_trajectory(motion)
    ax = figure.axes[0]
    crosses = [line for line in ax.get_lines() if line.get_marker() == "x"]
    assert len(crosses) == 3
    assert [text.get_text() for text in ax.texts] == ["1", "2", "3"]
    panel = next(each for each in figure.axes if each.get_ylabel() == "tension [N]")
    assert [text.get_text() for text in panel.texts] == ["1", "2", "3"]


def test_a_film_marks_all_waypoints_in_every_frame(motion: Trajectory) -> None:
    film = animate_trajectory(motion, fps=1.0, seconds=2.0)
    film._func(0)  # type: ignore[attr-defined]
    (ax,) = (each for each in film._fig.axes if each.name == "3d")  # type: ignore[attr-defined]
    marks = next(line for line in ax.get_lines() if line.get_marker() == "+")
    tips = [1e3 * motion.shapes[stop].tip for stop in motion.stops]
    np.testing.assert_allclose(np.transpose(marks.get_data_3d()), tips, atol=1e-3)
    film._draw_was_started = True  # type: ignore[attr-defined]


def test_each_section_has_a_panel_of_tensions(motion: Trajectory) -> None:
    figure = plot_trajectory(motion)
    panels = [each for each in figure.axes if each.get_ylabel() == "tension [N]"]
    assert len(panels) == 1
    names = [text.get_text() for text in panels[0].get_legend().get_texts()]
    assert names == ["T_11", "T_12", "T_13", "T_14"]


def test_equal_tensions_are_one_run() -> None:
    values = np.array([[0.0, 0, 1], [1, 1, 1], [2, 2, 0], [3, 2, 0]])
    assert sorted(equal_runs(values, 1e-3)) == [
        (0, 2, (0, 1)),
        (0, 3, (2,)),
        (2, 3, (0,)),
        (2, 3, (1,)),
    ]


def test_equal_tensions_have_dashes_of_alternating_colours() -> None:
    times = np.array([0.0, 1.0, 2.0])
    pulls = np.array([[0.1, 0.1, 0.1, 0.0], [0.1, 0.1, 0.5, 0.0], [0.3, 0.1, 0.2, 0.0]])
    limits = SimpleNamespace(upper=[5.0] * 4)
    drawn = SimpleNamespace(
        times=times, flat=pulls, arm=SLIM, stops=(2,), question=SimpleNamespace(limits=limits)
    )
    ax = Figure().add_subplot()
    plot_tensions_over_time(drawn, (0, 1, 2), ax)
    flat = [line for line in ax.get_lines() if np.array_equal(line.get_ydata(), [0.1, 0.1])]
    shared = [line for line in flat if line.get_xdata()[0] == 0]
    assert len({line.get_color() for line in shared}) == 2
    assert {line.get_linestyle() for line in shared} == {"--"}
    alone = [line for line in flat if line.get_xdata()[0] == 1]
    assert [line.get_linestyle() for line in alone] == ["-"]


@pytest.mark.parametrize(
    ("point", "normal"),
    [((0, 0, -0.03), (0, 0, 1)), ((0.1, 0, 0), (1, 1, 1)), ((0, 0.2, 0), (0, -1, 0.2))],
)
def test_the_patch_of_a_plane_lies_in_the_plane_around_the_arm(point: Any, normal: Any) -> None:
    plane = HalfSpace(point, normal)
    around = settle(SLIM, PULL, PAPER).position(np.linspace(0, 0.3, 20))
    patch = plane_patch(plane, around)
    assert len(patch) >= 3
    np.testing.assert_allclose(plane.distance(patch), 0.0, atol=1e-12)
    assert np.ptp(patch, axis=0).max() < 3 * np.ptp(around, axis=0).max()


def test_planes_far_away_are_not_drawn() -> None:
    around = settle(SLIM, PULL, PAPER).position(np.linspace(0, 0.3, 20))
    assert plane_patch(HalfSpace((0, 0, -5.0), (0, 0, 1)), around).size == 0


@pytest.mark.parametrize("normal", [(0, 1, 0), (0, -1, 0), (1, 0, 0), (0, 0, -1), (0, 0, 1)])
def test_planes_are_seen_from_their_free_side(normal: Any) -> None:
    point = -0.03 * np.array(normal)
    shape = settle(SLIM, PULL, PAPER)
    plane = HalfSpace(tuple(point), normal)
    el, az = np.radians(best_view(shape.position(np.linspace(0, 0.3, 40)), shape, [plane]))
    camera = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
    assert camera @ plane.normal > 0


def test_contact_planes_are_drawn_faintly() -> None:
    scene = Scene(ExactTendons(), Contact(HalfSpace((0, 0, -0.03), (0, 0, 1.0))))
    figure = plot_shape(settle(SLIM, [0, 0, 0, 0.0], scene))
    ax = figure.axes[0]
    colours = [each.get_facecolor() for each in ax.collections if hasattr(each, "_facecolors2d")]
    brown = [
        c[0] for c in colours if len(c) and np.allclose(c[0][:3], (181 / 255, 101 / 255, 29 / 255))
    ]
    assert brown and all(c[3] <= 0.1 for c in brown)


def test_bars_have_the_names_of_outcomes_and_tables() -> None:
    ax = Figure().add_subplot()
    plot_tensions(SLIM, np.array(PULL), np.full(4, np.inf), ax)
    assert [text.get_text() for text in ax.get_xticklabels()] == SLIM.tendon_names
    many = replace(SLIM, sections=(replace(SLIM.sections[0], angles=tuple(np.linspace(0, 6, 11))),))
    assert many.tendon_names[8:] == ["T_19", "T_1_10", "T_1_11"]
