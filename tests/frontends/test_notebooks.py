"""Results in consoles and notebooks fit a screen, and contain their figure."""

from __future__ import annotations

import base64

import numpy as np
import pytest
from matplotlib.figure import Figure

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import Extension
from octoplan.planner import Measured, Unknown, calibrate, plan, stiffness, trajectory
from octoplan.planner.targets import TipPosition
from tests.core.planner.cases import changed

ARM = Arm.from_paper("table-4")
SCENE = Scene(Extension())
PLAN = plan(ARM, TipPosition((0.3, 0.1, -0.1)), SCENE, 20.0)
T = np.array([[0, 0, 0.5, 0], [1.0, 0, 0, 0], [0, 2.0, 0, 0]])


def figure_in(html: str) -> bytes:
    """Return the figure of a result's HTML."""
    return base64.b64decode(html.split("base64,")[1].split('"')[0])


@pytest.mark.slow
def test_a_plan_fits_a_screen_and_prints_its_certificate() -> None:
    found = PLAN
    lines = repr(found).splitlines()
    assert lines[0] == found.outcome
    assert len(lines) <= 28
    assert {"tensions [N]", "tendon lengths [mm]"} <= {*lines}
    assert "strokes [mm] from the straight arm at rest" in lines
    assert str(found) == f"{found!r}\n\n{found.certificate}"
    html = found._repr_html_()
    assert figure_in(html).startswith(b"\x89PNG")
    assert "Reached: every target met" in html
    assert "[-]" in html and "[L]" in html


def test_a_stiffness_is_readable() -> None:
    k = stiffness(ARM, T, SCENE, hold="length")
    shown = str(k)
    assert "compliance of the tip, lengths locked" in shown
    row = next(line for line in shown.splitlines() if line.startswith("  y moves by"))
    numbers = [float(cell) for cell in row.split()[3:]]
    assert numbers == pytest.approx(1e3 * k.compliance[1, :3], rel=1e-3)
    assert "left slack (release=False locks them): T_11, T_12" in shown
    assert figure_in(k._repr_html_()).startswith(b"\x89PNG")


@pytest.mark.slow
def test_shapes_and_arms_bring_their_figure() -> None:
    shape = settle(ARM, T, SCENE)
    assert figure_in(shape._repr_html_()).startswith(b"\x89PNG")
    assert "&lt;" not in shape._repr_html_()
    assert figure_in(ARM._repr_html_()) != figure_in(shape._repr_html_())


def test_every_line_of_a_certificate_has_a_unit() -> None:
    rows = str(PLAN.certificate).splitlines()[2:]
    assert rows
    assert all("[" in row and "]" in row for row in rows)
    assert rows[0].split()[:3] == ["tip", "position", "[L]"]


def test_a_plan_that_does_not_settle_is_still_shown() -> None:
    crushed = changed(PLAN, tensions=np.full((3, 4), 1e4))
    assert "Not certified" in repr(crushed)


def test_scenes_certificates_and_fits_are_tables() -> None:
    shown = PLAN.certificate._repr_html_()
    assert "certificate: PASSED" in shown and ">tip position [L]</td>" in shown
    assert ">Extension</td>" in SCENE._repr_html_()
    measured = [Measured(tensions=T, tip=settle(ARM, T, SCENE).tip)]
    fit = calibrate(ARM, SCENE, measured, [Unknown("arm.E_kPa", 50, 500)])
    assert ">arm.E_kPa</td>" in fit._repr_html_()


def test_a_motion_is_a_figure_and_a_table() -> None:
    start = TipPosition((0.3, 0.1, -0.1))
    motion = trajectory(ARM, [start], SCENE, 20.0, rate_max=5.0, waypoints=2)
    shown = motion._repr_html_()
    assert figure_in(shown).startswith(b"\x89PNG")
    assert shown.count("<tr>") >= len(motion.times)
    assert "rate of tension over limit" in shown
    assert repr(motion) == motion.outcome
    assert str(motion).startswith(f"{motion.outcome}\n\ntensions [N]\n")
    assert str(motion).endswith(str(motion.certificate))


def test_shapes_draw_themselves_in_axes_too() -> None:
    shape = settle(ARM, T, SCENE)
    ax = Figure().add_subplot(projection="3d")
    assert shape.plot(ax) is ax
    ticks = [len(own.get_major_locator()()) for own in (ax.xaxis, ax.yaxis, ax.zaxis)]
    assert min(ticks) >= 3
