"""Results in consoles and notebooks: they fit a screen, and bring their figure."""

from __future__ import annotations

import base64

import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import Extension
from planner import plan, stiffness
from planner.targets import BendingPlane, TipPosition

ARM = Arm.from_paper("table-4")
SCENE = Scene(Extension())
T = np.array([[0, 0, 0.5, 0], [1.0, 0, 0, 0], [0, 2.0, 0, 0]])


def figure_in(html: str) -> bytes:
    """Return the figure of a result's HTML."""
    return base64.b64decode(html.split("base64,")[1].split('"')[0])


def test_a_plan_fits_a_screen_and_prints_its_certificate() -> None:
    found = plan(ARM, BendingPlane(2.0, 1.0), SCENE, 20.0)
    lines = repr(found).splitlines()
    assert lines[0] == found.outcome
    assert len(lines) <= 28
    assert {"tensions [N]", "tendon lengths [mm]", "strokes [mm]"} <= {*lines}
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
    assert "slack, could only pull: T_11, T_12" in shown
    assert figure_in(k._repr_html_()).startswith(b"\x89PNG")


def test_shapes_and_arms_bring_their_figure() -> None:
    shape = settle(ARM, T, SCENE)
    assert figure_in(shape._repr_html_()).startswith(b"\x89PNG")
    assert "&lt;" not in shape._repr_html_()
    assert figure_in(ARM._repr_html_()) != figure_in(shape._repr_html_())


def test_every_line_of_a_certificate_has_a_unit() -> None:
    found = plan(ARM, TipPosition((0.3, 0.1, -0.1)), SCENE, 20.0)
    rows = str(found.certificate).splitlines()[1:]
    assert rows
    assert all("[" in row and "]" in row for row in rows)
    assert rows[0].split()[:3] == ["tip", "position", "[L]"]


def test_a_plan_that_does_not_settle_is_still_shown() -> None:
    from dataclasses import replace

    found = plan(ARM, BendingPlane(2.0, 1.0), SCENE, 20.0)
    crushed = replace(found, tensions=np.full((3, 4), 1e4))
    assert "Not certified" in repr(crushed)
