"""Likely slips of units, in scripts and files, are reported with the likely number."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, InputError, Linear, Material, Scene
from octoplan.model.arm import conical
from octoplan.model.effects import Buoyancy, Current, Weight
from octoplan.model.support.errors import FileError
from octoplan.model.support.units import UnitWarning
from octoplan.planner.extensions.fit.unknowns import Parameters, Unknown
from octoplan.planner.frontends.cli import main
from octoplan.planner.frontends.io.scene_file import read
from octoplan.planner.frontends.sweeps.definition import sweep_of
from octoplan.planner.limits import TendonLimits
from octoplan.planner.planning_problem import check_targets
from octoplan.planner.targets import Backbone, Bend, BendingPlane, Fetch, TipPosition
from octoplan.planner.targets.fetch import FetchReach
from tests.warned import detailed

ARM = Arm.from_paper("table-4")
LIKELY: dict[str, tuple[Callable[[], Any], str]] = {
    "degrees for a plane": (lambda: BendingPlane(135.0, 1.0), r"give 2\.35619 \(rad\)"),
    "degrees for a fetch": (
        lambda: Fetch(Bend(1.0, 90.0), Bend(1.0, 0.0), Bend(1.0, 0.0)),
        r"Fetch\.proximal plane is 90 rad, 14\.3 turns; .* give 1\.5708 ",
    ),
    "degrees for a reach": (lambda: FetchReach((0.1, 0, 0), 1.0, 45.0), r"give 0\.785398 "),
    "degrees for tendons": (
        lambda: Anchorage(0.3, Linear(0.01, 0.01), (0, 120, 240)),
        r"give 2\.0944 \(rad\)",
    ),
    "kilopascals": (lambda: Material(E=110.0), r"110 Pa, softer .* give 110000 \(Pa\)"),
    "pascals for kilopascals": (lambda: Material(E=2e12 * 1.1), "harder than diamond"),
    "pascals in a key in kilopascals": (
        lambda: replace(ARM, material=Material(E=150000e3)),
        r"Material\.E is 1\.5e\+08 Pa, .* 3\.91e\+03 N .* \(150 in a key in kPa\)",
    ),
    "pascals for kilopascals of the thinnest arm": (
        lambda: replace(Arm.from_paper("section-5.1"), material=Material(E=150000e3)),
        r"34\.9 N to bend the arm by 1 rad",
    ),
    "grams per cubic centimetre": (lambda: Material(density=1.07), r"give 1070 \(kg/m3\)"),
    "kilograms per litre times a million": (lambda: Material(density=1.07e6), "give 1070 "),
    "a fluid lighter than any gas": (lambda: Buoyancy(0.0012), r"give 1\.2 \(kg/m3\)"),
    "a stream heavier than any metal": (lambda: Current((0.1, 0, 0), 1e6), r"give 1000 \(kg/m3\)"),
    "millimetres per second for a stream": (
        lambda: Current((300.0, 0.0, 0.0)),
        r"give 0\.3 \(m/s\)",
    ),
    "millimetres per second squared for gravity": (
        lambda: Weight((0.0, 0.0, -9810.0)),
        r"9810 m/s2, 1e\+03 times that of Earth; .* give 9\.81 ",
    ),
    "degrees for the turn of tendons": (
        lambda: Anchorage(0.3, Linear(0.01, 0.01), turn=Linear(0.0, 540.0)),
        r"turn is 540 rad, 85\.9 turns; .* give 9\.42478 ",
    ),
    "metres for the radius in a key in mm": (
        lambda: replace(ARM, radius=Linear(15e-6, 2e-6), hull=ARM.radius),
        r"Arm\.radius is 3\.3e-05 arm lengths or less; .* 1000 times too small",
    ),
    "millimetres for the radius": (
        lambda: replace(ARM, radius=Linear(15.0, 2.0)),
        r"Arm\.radius is 33\.3 arm lengths; .* 1000 times too large",
    ),
    "kilonewtons for a limit": (
        lambda: TendonLimits.of(ARM, 1e-4),
        r"tension_max bends the arm by about 0\.002 rad",
    ),
    "millinewtons for a limit": (
        lambda: TendonLimits.of(ARM, 20e3),
        r"at least 7e\+03 times the tension .* if millinewtons were meant, divide by 1000",
    ),
    "millimetres for an arm": (
        lambda: conical(450.0, (15.0, 2.0), [(450.0, 7.5, 1.0)]),
        r"Arm\.length is 450 m; if millimetres were meant, give 0\.45",
    ),
    "metres in a key in mm": (
        lambda: conical(0.45e-3, (15e-6, 2e-6), [(0.45e-3, 7.5e-6, 1e-6)]),
        r"if 0\.45 m were meant, give 0\.45 \(m\), or 450 in a key in mm",
    ),
    "a target 1000 times too far": (
        lambda: check_targets(ARM, TipPosition((200.0, 150.0, -200.0))),
        "711 arm lengths from the base; if millimetres .* 1000 times too far",
    ),
    "a target 1000 times too near": (
        lambda: check_targets(ARM, TipPosition((2e-4, 1.5e-4, -2e-4))),
        r"0\.00071 arm lengths from the base; if metres .* 1000 times too near",
    ),
    "points 1000 times too near": (
        lambda: check_targets(ARM, Backbone(((1e-4, 0.0, 0.0), (3e-4, 0.0, 0.0)))),
        "Backbone.points .* 1000 times too near",
    ),
}


@pytest.mark.parametrize(("make", "told"), LIKELY.values(), ids=LIKELY)
def test_a_likely_unit_is_named(make: Callable[[], Any], told: str) -> None:
    with detailed(UnitWarning, told):
        make()


def test_usual_numbers_are_no_reason() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        BendingPlane(-2 * np.pi, np.pi)
        BendingPlane(2 * np.pi, 1.0)
        Material(E=5e3)
        Material(E=60e9)
        hull, rod = Linear(0.01, 0.01), Linear(0.5e-3, 0.5e-3)
        tendons = (Anchorage(0.3, Linear(8e-3, 8e-3)),)
        for E, radius in ((60e9, rod), (200e9, rod), (2e9, Linear(1e-3, 1e-3))):
            Arm(0.3, radius, tendons, Material(E=E, nu=0.3), hull=hull)
        Anchorage(0.3, Linear(0.01, 0.01), turn=Linear(0.0, -9.425))
        Weight((0.0, 0.0, 0.0))
        Weight((0.0, 0.0, 9.81))
        Buoyancy(1.2)
        TendonLimits.of(ARM, 0.0)
        TendonLimits.of(ARM, 1e3)
        TendonLimits.of(ARM, np.inf)
        conical(0.004, (2e-4, 1e-4), [(0.004, 1e-4, 5e-5)])
        conical(12.0, (0.2, 0.1), [(12.0, 0.1, 0.05)])
        check_targets(ARM, TipPosition((0.0, 0.0, 0.0)))
        check_targets(ARM, TipPosition((1.0, 0.0, 0.0)))


SCENE = """
accuracy = 1e-3
[arm]
preset = "section-5.2"
[target]
type = "bending-plane"
angle_deg = {angle}
bend_deg = 30
[limits]
tension_max = 5
"""


@pytest.mark.parametrize(
    ("angle", "meant"),
    [("1.5708", "90"), ("3.14159265", "180"), ("3.14", "180"), ("-0.785398", "-45")],
)
def test_radians_in_a_key_in_degrees_are_told_by_the_command(
    angle: str, meant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scene.toml").write_text(SCENE.format(angle=angle))
    assert main(["plan", str(tmp_path / "scene.toml")]) == 0
    told = capsys.readouterr().err
    assert told.startswith("octoplan: beware: a key in degrees holds")
    assert told.endswith(f"if radians were meant, give {meant} (degrees)\n")
    assert told.count("\n") == 1


@pytest.mark.parametrize("angle", ["0", "90", "1.5", "2.5", "135.0", "5.0"])
def test_degrees_are_no_radians(
    angle: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from octoplan.planner.frontends.io.scene_file import load

    (tmp_path / "scene.toml").write_text(SCENE.format(angle=angle))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(tmp_path / "scene.toml")


OWN = """
[arm]
length_mm = 300
radius_mm = [10, 5]
sections = [{ at_mm = 300, offset_mm = [5, 3], angles_deg = %s }]
%s
"""


def warned(text: str) -> list[str]:
    """Return the warnings about a scene file."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        read(text.encode())
    assert all(own.category is UnitWarning for own in told)
    return [own.message.details for own in told if isinstance(own.message, UnitWarning)]


def test_radians_among_angles_are_told_all_at_once() -> None:
    (told,) = warned(OWN % ("[0, 1.5708, 3.1416, 4.7124]", ""))
    assert "arm.sections[0].angles_deg" in told
    assert told.endswith("if radians were meant, give 0, 90, 180, 270 (degrees)")


@pytest.mark.parametrize(
    "angles", ["[0, 90, 180, 270]", "[0, 1, 2, 3]", "[0, 120, 240]", "[1.5708, 90]"]
)
def test_degrees_are_not_told(angles: str) -> None:
    assert not warned(OWN % (angles, ""))


def test_a_density_in_grams_per_cubic_centimetre_is_told() -> None:
    (told,) = warned(OWN % ("[0]", "density = 1.07"))
    assert told.endswith("if g/cm3 were meant, give 1070 (kg/m3)")
    (told,) = warned(OWN % ("[0]", "[effects]\nweight = {}\nbuoyancy = { density = 1.0 }"))
    assert told.endswith("if g/cm3 were meant, give 1000 (kg/m3)")
    assert not warned(OWN % ("[0]", "[effects]\nweight = {}\nbuoyancy = { density = 1.2 }"))


@pytest.mark.parametrize(("E", "meant"), [("0.06", "60"), ("0.11", "110"), ("1.1e-4", "110")])
def test_a_modulus_in_megapascals_is_refused(E: str, meant: str) -> None:
    with pytest.raises(FileError) as caught:
        read((OWN % ("[0]", f"E_kPa = {E}")).encode())
    assert caught.value.where == "arm.E_kPa"
    assert f"give {meant} if" in caught.value.problem


def axis_warned(key: str, values: list[float]) -> list[str]:
    """Return the warnings about an axis of a sweep."""
    arm, scene = Arm.from_paper("table-4"), Scene.silicone(Weight(), Buoyancy())
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        sweep_of(arm, {key: values}, scene, tensions=[0.0] * 12)
    details = [own.message.details for own in told if isinstance(own.message, UnitWarning)]
    return list(dict.fromkeys(details))


def test_slips_along_the_axes_of_sweeps_are_told() -> None:
    (told,) = axis_warned("arm.sections[0].angles_deg[1]", [1.4, 1.5708])
    assert told.endswith("if radians were meant, give 80.2141, 90 (degrees)")
    (told,) = axis_warned("effects.buoyancy.density", [0.95, 1.0])
    assert told.endswith("if g/cm3 were meant, give 950, 1000 (kg/m3)")
    told_of_arm = axis_warned("arm.density", [1.07])
    assert all(own.endswith("if g/cm3 were meant, give 1070 (kg/m3)") for own in told_of_arm)
    assert told_of_arm
    assert not axis_warned("arm.sections[0].angles_deg[1]", [80.0, 90.0])
    with pytest.raises(FileError, match=r"give 60 if megapascals"):
        axis_warned("arm.E_kPa", [0.06, 0.07])


@pytest.mark.parametrize(
    ("unknown", "told"),
    [
        (Unknown("arm.E_kPa", 0.05, 0.5), "Then give 50 to 500"),
        (Unknown("arm.E_kPa", 5e4, 5e5), "Then give 50 to 500"),
        (Unknown("arm.density", 0.9, 1.1), "Then give 900 to 1100"),
        (Unknown("arm.sections[0].angles_deg[1]", 1.5, 1.6), "in radians? Then give 85.9437 to"),
    ],
)
def test_slips_in_the_bounds_of_unknowns_are_told(unknown: Unknown, told: str) -> None:
    with pytest.raises(InputError) as caught:
        Parameters.of(Arm.from_paper("table-4"), Scene(), [unknown])
    assert told in str(caught.value)


def test_a_file_with_pascals_in_kilopascals_is_told() -> None:
    (told,) = warned(OWN % ("[0]", "E_kPa = 150000"))
    assert "(150 in a key in kPa)" in told


def test_a_loop_shows_one_warning_for_each_line() -> None:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("default")
        for i in range(5):
            Material(E=100.0 + i)
            Material(density=1.0 + 0.01 * i)
    assert len(told) == 2
    assert all(isinstance(own.message, UnitWarning) for own in told)
