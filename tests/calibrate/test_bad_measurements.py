"""What cannot be calibrated is refused, with what is wrong and where."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from model import InputError, OctoplanError, Scene
from model.effects import Extension
from planner import Measured, Unknown, calibrate
from tests.calibrate.cases import HANGING, small_arm

POINT = (0.1, (0.0, 0.0, 0.02), (0.0, 0.0, -0.1))
GOOD = Measured([1.0, 0.0, 0.0], [POINT])
E = Unknown("arm.E_kPa", 50, 300)


@pytest.mark.parametrize(
    ("shape", "told"),
    [
        ({"points": [(0.3, (0, 0, 0), (0, 0, -0.1))]}, r"points\[0\].s: got 0.3.* 0 to 0.2 m"),
        ({"points": [(100.0, (0, 0, 0), (0, 0, -0.1))]}, "is it in mm"),
        ({"points": [(0.1, (0, 0, 20.0), (0, 0, -0.1))]}, "offset.*is it in mm"),
        ({"points": [(0.1, (0, 0, 0), (0, 0, -100.0))]}, "is it in mm"),
        ({"points": [(0.2, (0, 0, 0), (0, 0, -0.0001))]}, "1000 times too small"),
        ({"points": [(0.1, (0, 0, 0), (0, float("nan"), 0))]}, "finite"),
        ({"points": [(0.1, (0, 0, 0))]}, "all in m"),
        ({"points": []}, "points, frames, a tip"),
        ({"lengths": [0.2, 0.2]}, "one of each of 3"),
        ({"lengths": [0.2, 196.0, 0.2]}, "lengths, T_12: got 196.0.*is it in mm"),
        ({"strokes": [0.0, 0.3, 0.0]}, "strokes, T_12: got 0.3.*at rest, 0.2 m; is it in mm"),
        ({"tip": (0, 0, -200.0)}, "tip.*is it in mm"),
        ({"frames": [(0.1, [[1, 0, 0], [0, 1, 0], [0, 0, 2]])]}, "orthonormal"),
        ({"tensions": [1.0, 2.0]}, "3 numbers"),
        ({"std": 0.0}, "above 0"),
    ],
)
def test_measurements_that_cannot_be(shape: dict[str, Any], told: str) -> None:
    given = {"tensions": [1.0, 0.0, 0.0], "points": [POINT]} | shape
    with pytest.raises(InputError, match=told):
        calibrate(small_arm(), HANGING, [Measured(**given)], [E])


@pytest.mark.parametrize(
    ("unknowns", "told"),
    [
        ([], "at least one"),
        ([Unknown("arm.E_kpa", 50, 300)], 'did you mean "E_kPa"'),
        ([Unknown("arm.radius_mm", 5, 15)], r"arm.radius_mm\[0\]"),
        ([Unknown("effects.extension", 0, 1)], "a number of arm, effects"),
        ([Unknown("effects.friction.mu", 0, 1)], "give it effects.friction first"),
        ([Unknown("points[1].s_mm", 0, 1)], "i below 1"),
        ([Unknown("arm.E_kPa", 200, 300)], "120 kPa"),
        ([Unknown("arm.E_kPa", 50, 300, session="A")], "no shape has a session"),
        ([E, E], "each key once"),
        (
            [E, *(Unknown(f"arm.base_position_mm[{i}]", -9, 9) for i in range(3))],
            "at most as many",
        ),
    ],
)
def test_unknowns_that_do_not_fit(unknowns: list[Unknown], told: str) -> None:
    with pytest.raises(InputError, match=told):
        calibrate(small_arm(), HANGING, [GOOD], unknowns)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (("arm.E_kPa", 3, 3), "above lower"),
        (("arm.E_kPa", 3, float("inf")), "finite"),
        (("arm.E_kPa", 3, 9, (1, 2)), "a mean within the bounds"),
        (("arm.E_kPa", 3, 9, (4, 0)), "standard deviation above 0"),
        (((), 3, 9), "a key path"),
        ((("arm.nu", "arm.nu"), 0, 0.5), "each key once"),
    ],
)
def test_an_unknown_that_cannot_be(given: Any, told: str) -> None:
    with pytest.raises(InputError, match=told):
        Unknown(*given)


def test_a_scene_as_printed_has_no_equations() -> None:
    with pytest.raises(InputError, match="hold under loads"):
        calibrate(small_arm(), Scene.as_printed(), [GOOD], [E])


def test_shapes_that_do_not_settle_are_named() -> None:
    crushed = Measured([1e5, 1e5, 1e5], [POINT], name="the strong pull")
    with pytest.raises(OctoplanError, match="the strong pull does not settle"):
        calibrate(small_arm(), Scene(Extension()), [GOOD, crushed], [E])


def test_a_place_that_nothing_reaches_is_named_and_bounds_are_told() -> None:
    shapes = [replace(GOOD, tensions=[T, 0, 0], name=f"{T} N") for T in (0.1, 0.2, 0.3, 0.4)]
    shapes.append(replace(GOOD, points=[(*POINT[:2], (0.1, 0.1, 0.0))], name="far"))
    found = calibrate(small_arm(), HANGING, shapes, [E])
    assert found.unlike == ("far",)
    assert "far: markers or lengths are off" in found.outcome
    assert "Farthest off is points[0] of far, by" in found.outcome
    assert found.at_bounds == ("arm.E_kPa",)
    assert "At a bound" in found.outcome


def test_shapes_out_of_reach_are_named_without_others_to_compare_them_with() -> None:
    far = replace(GOOD, points=[(*POINT[:2], (0.1, 0.1, 0.0))], name="far")
    found = calibrate(small_arm(), HANGING, [far], [E])
    assert found.unreached == ("far",)
    assert "No values within the bounds reach far: markers or lengths are off by" in found.outcome
    assert "mN" not in found.outcome


def test_strokes_that_no_shape_has_are_told_by_shape_and_column() -> None:
    off = replace(GOOD, strokes=[0.0, 0.15, 0.0], name="odd")
    found = calibrate(small_arm(), HANGING, [off], [E])
    assert found.unreached == ("odd",)
    assert "Farthest off is strokes[1] of odd, by" in found.outcome


def test_tensions_in_the_wrong_unit_are_told() -> None:
    strong = replace(GOOD, tensions=[2000.0, 0, 0], points=[(*POINT[:2], (0.1, 0.1, 0.0))])
    found = calibrate(small_arm(), HANGING, [strong], [Unknown("arm.E_kPa", 100, 400)])
    assert "are they in mN?" in found.outcome


@pytest.mark.parametrize(("low", "high", "how"), [(5e4, 4e5, "large"), (0.05, 0.4, "small")])
def test_bounds_in_another_unit_are_told(low: float, high: float, how: str) -> None:
    with pytest.raises(InputError, match=f"1000 times too {how}"):
        calibrate(small_arm(), HANGING, [GOOD], [Unknown("arm.E_kPa", low, high)])
