"""The animation of an arm from rest through plans."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image, ImageChops

from model import Arm, InputError, Scene
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
    motion._draw_was_started = True


def test_what_cannot_be_animated_is_told(plans: list[Plan], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least one Plan"):
        plot_motion([])
    with pytest.raises(InputError, match=r"plans\[1\]"):
        plot_motion([plans[0], replace(plans[1], scene=Scene())])
    with pytest.raises(InputError, match="3d"):
        plot_motion(plans, Figure().add_subplot())
    with pytest.raises(InputError, match="frames"):
        plot_motion(plans, frames=0)
    motion = plot_motion(plans[:1], frames=1)
    motion._draw_was_started = True
    for name in ("arm.mp4", "nowhere/arm.gif"):
        with pytest.raises(InputError, match="path"):
            save_motion(motion, tmp_path / name)
