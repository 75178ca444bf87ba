"""Arms, scenes and shapes as people see them in a console and in a notebook."""

from __future__ import annotations

import numpy as np
import pytest

from model import Arm, Scene, conical, settle, settle_many
from model.effects import (
    Buoyancy,
    ExactTendons,
    Extension,
    NeoHookean,
    PrintedStatics,
    Shear,
    TipLoad,
    Weight,
)

ARM = Arm.from_paper("table-4")
MANY = conical(1.0, (0.02, 0.01), [(1.0 - 0.03 * i, 0.005, 0.005) for i in range(30)])


@pytest.mark.parametrize("arm", [ARM, MANY, Arm.from_paper("section-5.2")])
def test_an_arm_fits_a_screen(arm: Arm) -> None:
    lines = repr(arm).splitlines()
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 100


def test_an_arm_tells_its_sizes_with_units() -> None:
    shown = repr(ARM)
    assert "Arm of 450 mm, radius" in shown
    assert "12 tendons" in shown
    assert "E 110 kPa, nu 0.5, 1080 kg/m3" in shown
    assert [line.split()[0] for line in shown.splitlines()[1:]] == ["section", "1", "2", "3"]
    assert repr(MANY).endswith("... and 20 more")


@pytest.mark.parametrize(
    "scene",
    [
        Scene(),
        Scene(Extension()),
        Scene.silicone(Weight(), Buoyancy(), TipLoad((1.0, 2.0, 3.0), follower=True)),
    ],
)
def test_a_scene_shows_what_makes_it(scene: Scene) -> None:
    assert eval(repr(scene)) == scene
    assert max(map(len, repr(scene).splitlines())) <= 100


def test_a_scene_is_shown_in_notebooks() -> None:
    shown = Scene.silicone(Weight())._repr_html_()
    assert ">Weight</td>" in shown and ">g = (0.0, 0.0, -9.81)</td>" in shown


def test_silicone_takes_further_effects() -> None:
    wanted = Scene(Extension(), ExactTendons(), NeoHookean(), Weight(), Buoyancy())
    assert Scene.silicone(Weight(), Buoyancy()) == wanted
    assert Scene.silicone() + Weight() + Buoyancy() == wanted
    assert Scene.silicone() + Scene(Weight(), Buoyancy()) == wanted
    assert Scene() + Shear() == Scene(Shear())
    swollen = NeoHookean(anticlastic=True)
    assert Scene.silicone(swollen) == Scene(Extension(), ExactTendons(), swollen)


@pytest.mark.parametrize(
    "scene", [Scene(), Scene.silicone(Weight(), Buoyancy()), Scene(Extension(), PrintedStatics())]
)
def test_a_shape_tells_tensions_lengths_and_tip(scene: Scene) -> None:
    T = np.zeros((3, 4))
    T[0, 2], T[1, 0] = 0.5, 1.0
    shape = settle(ARM, T, scene)
    lines = repr(shape).splitlines()
    assert len(lines) <= 24
    assert str(shape) == repr(shape)
    lengths = lines[lines.index("tendon lengths [mm]") + 1 :][:3]
    shown = [float(cell) for line in lengths for cell in line.split("mm)")[1].split()[1::2]]
    assert shown == pytest.approx(1e3 * shape.tendon_lengths, abs=1e-4)
    tip = next(line for line in lines if line.startswith("tip [mm]"))
    assert [float(x) for x in tip.split()[2:]] == pytest.approx(1e3 * shape.tip, abs=1e-4)


def test_an_arm_with_many_tendons_at_a_place_has_lines_that_fit() -> None:
    from model import Anchorage, Linear

    angles = tuple(np.linspace(0, 6, 13))
    arm = Arm(0.3, Linear(0.01, 0.01), (Anchorage(0.3, Linear(0.005, 0.005), angles),))
    shown = repr(settle(arm, np.zeros(13)))
    assert max(map(len, shown.splitlines())) <= 130
    assert "T_1,13" in shown


def test_many_shapes_tell_their_tips_and_what_is_not_settled() -> None:
    T = np.zeros((20, 12))
    T[3, 0] = np.nan
    lines = repr(settle_many(Arm.from_paper("table-4"), T, errors="nan")).splitlines()
    assert lines[0] == "20 sets of tensions, 1 not settled"
    assert "x [mm]" in lines[1]
    assert lines[-2] == "  ... and 8 more"
    assert lines[-1].startswith("  3: tensions[3][0]")
    assert len(lines) <= 16
