"""Numbers that are likely slips are told with the number likely meant, in the key's unit."""

from __future__ import annotations

import warnings

import pytest

from model import Arm, InputError, Scene, UnitWarning
from model.effects import Buoyancy, Weight
from model.errors import FileError
from planner.fit.unknowns import Parameters, Unknown
from planner.io.scene_file import read
from planner.sweeps.definition import sweep_of, sweep_table

OWN = """
[arm]
length_mm = 300
radius_mm = [10, 5]
sections = [{ at_mm = 300, offset_mm = [5, 3], angles_deg = %s }]
%s
"""


def warned(text: str) -> list[str]:
    """Return what is told of a scene file."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        read(text.encode())
    assert all(own.category is UnitWarning for own in told)
    return [str(own.message) for own in told]


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
    """Return what is told of an axis of a sweep."""
    arm, scene = Arm.from_paper("table-4"), Scene.silicone(Weight(), Buoyancy())
    raw = sweep_table(arm, {key: values}, scene, tensions=[0.0] * 12)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        sweep_of(raw)
    return list(dict.fromkeys(str(own.message) for own in told))


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
