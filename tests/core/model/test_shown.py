"""Arms, scenes and shapes as text and figures, and remarks about impossible shapes."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import octoplan
from octoplan.model import Arm, Material, Scene, settle, settle_many
from octoplan.model.arm import conical
from octoplan.model.effects import (
    Buoyancy,
    ExactTendons,
    Extension,
    NeoHookean,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.support.errors import ShapeWarning
from octoplan.planner import plan
from octoplan.planner.targets import TipPosition
from tests.warned import detailed

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
    # The planner defines the tables, and is loaded with octoplan.
    shown = octoplan.Scene.silicone(Weight())._repr_html_()
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
    from octoplan.model import Anchorage, Linear

    angles = tuple(np.linspace(0, 6, 13))
    arm = Arm(0.3, Linear(0.01, 0.01), (Anchorage(0.3, Linear(0.005, 0.005), angles),))
    shown = repr(settle(arm, np.zeros(13)))
    assert max(map(len, shown.splitlines())) <= 130
    assert "T_1_13" in shown


def test_many_shapes_tell_their_tips_and_what_is_not_settled() -> None:
    T = np.zeros((20, 12))
    T[3, 0] = np.nan
    lines = repr(settle_many(Arm.from_paper("table-4"), T, errors="nan")).splitlines()
    assert lines[0] == "20 sets of tensions, 1 not settled"
    assert "x [mm]" in lines[1]
    assert lines[-2] == "  ... and 8 more"
    assert lines[-1].startswith("  3: tensions[3][0]")
    assert len(lines) <= 16


TABLE_2 = Arm.from_paper("table-2")
FETCH = np.zeros((3, 4))
FETCH[0, 2], FETCH[1, 0], FETCH[2, 1] = 0.5, 4.0, 13.0


def pulled(tension: float) -> np.ndarray:
    """Return tensions with one tendon that ends at the tip pulled [N]."""
    T = np.zeros(TABLE_2.n_tendons)
    T[0] = tension
    return T


@pytest.mark.filterwarnings("default::octoplan.model.support.errors.ShapeWarning")
def test_a_hundred_newtons_on_one_tendon_are_told_with_numbers() -> None:
    with pytest.warns(ShapeWarning, match="bends sharper than its own radius") as seen:
        shape = settle(TABLE_2, pulled(100.0), Scene())
    assert seen[0].filename == __file__
    sharp, crosses = shape.remarks
    assert isinstance(seen[0].message, ShapeWarning)
    assert seen[0].message.details == sharp
    # k = T y / (E J + T y^2) is largest against the radius at the tip.
    E, R, y = (
        TABLE_2.material.E,
        6.5e-3,
        TABLE_2.offset_paths[0][1].evaluate(np.array([0.31]), 0.31)[0][0],
    )
    radius = (E * np.pi * R**4 / 4 + 100.0 * y**2) / (100.0 * y)
    assert f"by a radius of {1e3 * radius:.3g} mm at s = 0.31 m" in sharp
    assert f"{1e3 * R:.3g} mm" in sharp
    longest = 1e3 * shape.tendon_lengths.max()
    assert f"T_13 would have to be {longest:.4g} mm long, 310.1 mm at rest" in sharp
    assert "passes through itself" in crosses
    assert "beware: " + sharp in repr(shape)


@pytest.mark.filterwarnings("error::octoplan.model.support.errors.ShapeWarning")
@pytest.mark.parametrize("scene", [Scene(), Scene(Extension()), Scene.silicone()])
def test_what_arms_do_is_told_without_a_remark(scene: Scene) -> None:
    shapes = [settle(TABLE_2, pulled(2.0), scene), settle(Arm.from_paper("table-4"), FETCH, scene)]
    if not scene.effects:
        shapes.pop()  # without extension the fetch bends sharper than the tip's radius
    assert all(shape.remarks == () for shape in shapes)


@pytest.mark.filterwarnings("default::octoplan.model.support.errors.ShapeWarning")
def test_loads_that_bend_the_arm_too_sharply_are_told() -> None:
    thick = conical(0.1, (0.02, 0.02), [(0.1, 0.01, 0.01)], material=Material(1e5))
    moment = thick.material.E * np.pi * 0.02**4 / 4 * 60.0
    with detailed(ShapeWarning, "radius of 16.7 mm"):
        settle(thick, np.zeros(thick.n_tendons), Scene(TipLoad(moment=(0, 0, moment))))


@pytest.mark.filterwarnings("default::octoplan.model.support.errors.ShapeWarning")
def test_a_call_inside_of_another_does_not_warn() -> None:
    from octoplan.model.stiffness import stiffness

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stiffness(TABLE_2, pulled(100.0), Scene(), accuracy=1e-3)


@pytest.mark.filterwarnings("default::octoplan.model.support.errors.ShapeWarning")
def test_a_loop_over_sharp_shapes_warns_once() -> None:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("default")
        shapes = [settle(TABLE_2, pulled(T), Scene()) for T in (90.0, 95.0, 100.0)]
    assert len({shape.remarks[0] for shape in shapes}) == 3
    assert [own.category for own in told] == [ShapeWarning]


@pytest.mark.filterwarnings("default::octoplan.model.support.errors.ShapeWarning")
def test_a_load_that_doubles_the_length_is_told() -> None:
    bar = conical(0.1, (0.01, 0.01), [(0.1, 0.005, 0.005)], material=Material(1e5))
    EA = 1e5 * np.pi * 0.01**2
    rest = np.zeros(bar.n_tendons)
    for share in (0.9, 1.1):
        scene = Scene(Extension(), TipLoad(force=(share * EA, 0.0, 0.0)))
        if share < 1:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                assert settle(bar, rest, scene).remarks == ()
            continue
        with detailed(ShapeWarning, "stretched to 2.1 times its length .* holds up to 2 times"):
            shape = settle(bar, rest, scene)
        assert shape.tip[0] == pytest.approx(0.1 * (1 + share), rel=1e-6)
        assert "stretched to 2.1 times" in shape.remarks[0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        settle(bar, rest, Scene.silicone(TipLoad(force=(0.7 * EA, 0.0, 0.0))))


@pytest.mark.slow
def test_certificates_tell_of_arms_stretched_too_far() -> None:
    bar = conical(0.1, (0.01, 0.01), [(0.1, 0.005, 0.005)], material=Material(1e5))
    scene = Scene(Extension(), TipLoad(force=(1.2e5 * np.pi * 0.01**2, 0.0, 0.0)))
    T = [0.3, 0.0, 0.0, 0.0]
    found = plan(bar, TipPosition(tuple(settle(bar, T, scene).tip)), scene, 1.0)
    assert any("times its length" in told for told in found.certificate.warnings)
