"""Figures of plans, shapes and motions contain their parts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure
from PIL import Image, ImageChops

from octoplan.model import Arm, Scene, Shape, settle
from octoplan.model.effects import ExactTendons, Extension
from octoplan.model.extensions.clearance import clearance
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Capsule
from octoplan.planner import Plan, plan, plan_many
from octoplan.planner.extensions.contact.checks import COMPLEMENTARY
from octoplan.planner.frontends.plots.arm import draw_arm
from octoplan.planner.frontends.plots.motion import plot_motion, save_motion
from octoplan.planner.frontends.plots.plan import plot_plan, plot_shape, plot_strains, save
from octoplan.planner.targets import (
    Backbone,
    BendingPlane,
    Fetch,
    Target,
    TipPointing,
    TipPose,
    TipPosition,
)
from tests.core.planner.cases import PAPER, barrel_arm, changed, figure_15

MARKED = {
    "position": "target of the tip",
    "pose": "target of the tip",
    "pointing": "target direction",
    "backbone": "target points",
    "plane": "bending plane",
    "bends": "target tangents",
    "reach": "mouth",
    "reach in a plane": "mouth",
}


def target(kind: str, arm: Arm) -> Target:
    """Return a target of a kind that a few tendons of a paper's arm can meet."""
    shape = settle(arm, [0, 0.1, 0, 0, 0.3, *[0] * 7], PAPER)
    tip = tuple(shape.tip.tolist())
    points = shape.position(np.linspace(0.1, 0.3, 3)).tolist()
    quarter = np.pi / 2
    return {
        "position": TipPosition(tip),
        "pose": TipPose(tip, tuple(map(tuple, shape.tip_frame.tolist()))),
        "pointing": TipPointing(tip, tuple(shape.tip_frame[:, 0].tolist())),
        "backbone": Backbone(tuple(map(tuple, points))),
        "plane": BendingPlane(np.radians(135), np.radians(40)),
        "bends": Fetch((0.6, quarter), (0.5, -quarter), (0.6, 0.0)),
        "reach": Fetch.reach((0.05, 0.05, 0.0), np.radians(50)),
        "reach in a plane": Fetch.reach((0.05, 0.05, 0.0), np.radians(50), quarter),
    }[kind]


@pytest.fixture(scope="module")
def fetch() -> Plan:
    arm = Arm.from_paper("table-4")
    return plan(arm, target("reach", arm), PAPER, 20.0)


@pytest.fixture(scope="module")
def shape() -> Shape:
    return settle(Arm.from_paper("table-4"), figure_15(), PAPER)


@pytest.fixture(autouse=True)
def no_figure_is_left_open() -> Any:
    yield
    assert pyplot.get_fignums() == []


def three_d() -> Any:
    return Figure().add_subplot(projection="3d")


def panels(figure: Figure) -> dict[str, Any]:
    """Return the axes of a figure by their distinct labels."""
    found = {}
    for ax in figure.axes:
        found[ax.get_ylabel() if ax.name == "3d" or ax.get_ylabel() else ax.get_xlabel()] = ax
    return found


def legend(ax: Any) -> set[str]:
    return set(ax.get_legend_handles_labels()[1])


@pytest.mark.quick("position-table-2", "reach in a plane-table-2")
@pytest.mark.parametrize("name", ["table-2", "table-4"])
@pytest.mark.parametrize("kind", MARKED)
def test_the_figure_of_a_plan_shows_its_target(name: str, kind: str) -> None:
    arm = Arm.from_paper(name)
    figure = plot_plan(plan(arm, target(kind, arm), PAPER, 20.0, starts=1))
    assert isinstance(figure, Figure)
    assert MARKED[kind] in legend(panels(figure)["y [mm]"])
    figure.draw_without_rendering()


def test_axes_name_quantities_and_units(fetch: Plan) -> None:
    figure = plot_plan(fetch)
    found = panels(figure)
    assert set(found) == {"y [mm]", "curvature [1/m]", "longitudinal strain q [-]", "tension [N]"}
    arm = found["y [mm]"]
    assert (arm.get_xlabel(), arm.get_zlabel()) == ("x [mm]", "z [mm]")
    assert found["curvature [1/m]"].get_xlabel() == "s [mm]"
    assert [ax.get_xlabel() for ax in figure.axes].count("tension [N]") == 1


def test_the_title_says_the_outcome_and_the_effort(fetch: Plan) -> None:
    figure = plot_plan(fetch)
    assert figure.get_suptitle().startswith("Reached")
    assert f"{fetch.effort:.3g} N" in figure.get_suptitle()
    off = changed(fetch, tensions=1.1 * fetch.tensions)
    assert plot_plan(off).get_suptitle().startswith("Not certified")


def bars(figure: Figure) -> Any:
    return next(ax for ax in figure.axes if ax.get_ylabel() == "tension [N]")


def test_bars_are_the_tensions_by_tendon_name(fetch: Plan) -> None:
    ax = bars(plot_plan(fetch))
    assert [bar.get_height() for bar in ax.patches] == list(np.ravel(fetch.tensions))
    names = [label.get_text() for label in ax.get_xticklabels()]
    assert names[0] == "T_11" and names[-1] == "T_34" and len(names) == 12


def test_given_axes_are_drawn_in_and_returned_and_get_no_company(fetch: Plan) -> None:
    for draw in (lambda ax: plot_plan(fetch, ax), lambda ax: plot_shape(fetch.shape, ax)):
        ax = three_d()
        assert draw(ax) is ax
        assert ax.figure.axes == [ax]
    flat = Figure().add_subplot()
    assert plot_strains(fetch.shape, flat) is flat


@pytest.mark.slow
def test_arms_without_pull_and_arms_of_many_sections_are_drawn() -> None:
    for arm in (barrel_arm(), Arm.from_paper("section-5.1")):
        for tensions in (np.zeros(arm.n_tendons), np.full(arm.n_tendons, 1e-3)):
            drawn = settle(arm, tensions, PAPER)
            for figure in (plot_shape(drawn), plot_strains(drawn)):
                assert isinstance(figure, Figure)
                figure.draw_without_rendering()
    found = plan(barrel_arm(), TipPosition((0.42, 0.1, 0.05)), PAPER, starts=1)
    assert len(bars(plot_plan(found)).patches) == 15


@pytest.mark.parametrize(
    ("suffix", "magic"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("PNG", b"\x89PNG")]
)
def test_saving_writes_the_format_of_the_suffix_and_nothing_else(
    shape: Shape, tmp_path: Path, suffix: str, magic: bytes
) -> None:
    wanted = tmp_path / f"arm.{suffix}"
    assert save(plot_shape(shape), str(wanted)) == wanted
    assert wanted.read_bytes().startswith(magic)
    assert list(tmp_path.iterdir()) == [wanted]
    assert wanted.stat().st_size < 300_000


@pytest.mark.slow
def test_a_figure_of_a_plan_is_1100_pixels_wide_and_small(fetch: Plan, tmp_path: Path) -> None:
    written = save(plot_plan(fetch), tmp_path / "plan.png").read_bytes()
    assert int.from_bytes(written[16:20]) == 1100
    assert len(written) < 300_000


def test_two_plans_in_one_axes_have_one_scale_of_colours(shape: Shape) -> None:
    """The second scale ended at the largest tension of its own section."""
    ax = three_d()
    soft = settle(shape.arm, 0.1 * shape.tensions, PAPER)
    for one in (shape, soft):
        draw_arm(one, ax)
    pulled = [own for own in ax.collections if own.get_array() is not None]
    assert len(pulled) == 2
    most = float(shape.tensions.max())
    assert [own.norm.vmax for own in pulled] == [most, most]
    assert pulled[0].norm(4.0) == pulled[1].norm(4.0)


@pytest.mark.quick("scene0")
@pytest.mark.parametrize("scene", [Scene(Extension(), ExactTendons()), Scene.silicone()])
def test_an_arm_that_leans_is_not_drawn_as_passing_through(scene: Scene) -> None:
    """The lower bound of the clearance is below 0 by the uncertainty of the bound."""
    rod = Capsule((0.1, -0.05, -0.06), (0.1, 0.05, -0.06), 0.02)
    tensions = [[0] * 4, [0, 1.0, 0, 0], [0, 3.0, 0, 0]]
    leaning = settle(Arm.from_paper("table-4"), tensions, scene + Contact(rod))
    assert min(touch.gap for touch in leaning.contacts) >= -COMPLEMENTARY
    assert clearance(leaning, [rod]).gap < 0
    ax = three_d()
    draw_arm(leaning, ax, (), (rod,))
    assert legend(ax) == {"contact"}


def test_torsion_is_drawn_only_where_there_is_any(shape: Shape) -> None:
    ax = Figure().add_subplot()
    plot_strains(shape, ax)
    assert legend(ax) == {"ξ [1/m]", "k [1/m]"}
    printed = settle(shape.arm, figure_15(), shape.scene.as_printed())
    ax = Figure().add_subplot()
    plot_strains(printed, ax)
    assert "τ [1/m]" in legend(ax)


@pytest.fixture(scope="module")
def plans() -> list[Plan]:
    targets = [BendingPlane(np.radians(angle), np.radians(60.0)) for angle in (0.0, 60.0)]
    return plan_many(Arm.from_paper("table-2"), targets, Scene(Extension()), 20.0)


@pytest.mark.slow
def test_the_arm_moves_from_rest_to_the_last_plan(plans: list[Plan], tmp_path: Path) -> None:
    path = save_motion(plot_motion(plans, frames=2, fps=10), tmp_path / "arm.gif", 40)
    assert [p.name for p in tmp_path.iterdir()] == ["arm.gif"]
    with Image.open(path) as film:
        assert film.n_frames == 5
        assert film.info["duration"] == 100
        frames = []
        for i in range(film.n_frames):
            film.seek(i)
            frames.append(film.convert("RGB"))
    assert all(ImageChops.difference(a, frames[0]).getbbox() for a in frames[1:])
