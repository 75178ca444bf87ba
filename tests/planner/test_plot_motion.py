"""The animation of an arm from rest through plans."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image, ImageChops

from model import Arm, Scene
from model.effects import Extension
from planner import Plan, plan_many
from planner.plots.motion import plot_motion, save_motion
from planner.targets import BendingPlane


@pytest.fixture(scope="module")
def plans() -> list[Plan]:
    targets = [BendingPlane(np.radians(angle), np.radians(60.0)) for angle in (0.0, 60.0)]
    return plan_many(Arm.from_paper("table-2"), targets, Scene(Extension()), 20.0)


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


def test_axes_given_hold_what_a_frame_shows_and_every_frame_in_one_box(plans: list[Plan]) -> None:
    figure = Figure()
    ax = figure.add_subplot(projection="3d")
    motion = plot_motion(plans, ax, frames=2)
    figure.draw_without_rendering()
    motion._func(0)
    box = ax.get_xlim(), ax.get_ylim(), ax.get_zlim()
    assert ax.get_title() == "plan 1 of 2"
    motion._func(4)
    assert ax.get_title() == "plan 2 of 2"
    assert (ax.get_xlim(), ax.get_ylim(), ax.get_zlim()) == box
    tension = np.ravel(plans[1].tensions)
    assert np.allclose(ax.collections[-1].get_array(), tension[tension > 0])
    for p in plans:
        x = 1e3 * p.shape.tip
        assert all(low < value < high for value, (low, high) in zip(x, box, strict=True))
