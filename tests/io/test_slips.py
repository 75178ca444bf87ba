"""Numbers that are likely slips are told with the number likely meant, in the key's unit."""

from __future__ import annotations

import warnings

import pytest

from model import UnitWarning
from model.errors import FileError
from planner.io.scene_file import read

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
