"""Invalid calibrations are refused, with the reason and the place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from octoplan.model import InputError, OctoplanError, Scene, settle
from octoplan.model.effects import Extension
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.critical_load import critical_load_factor
from octoplan.model.extensions.obstacles import Sphere
from octoplan.planner import Measured, Unknown, calibrate
from tests.calibrate.cases import HANGING, small_arm

POINT = (0.1, (0.0, 0.0, 0.02), (0.0, 0.0, -0.1))
GOOD = Measured([1.0, 0.0, 0.0], [POINT])
E = Unknown("arm.E_kPa", 50, 300)


def measuring(**shape: Any) -> Callable[[], object]:
    given = {"tensions": [1.0, 0.0, 0.0], "points": [POINT]} | shape
    return lambda: calibrate(small_arm(), HANGING, [Measured(**given)], [E])


def asking(*unknowns: Unknown) -> Callable[[], object]:
    return lambda: calibrate(small_arm(), HANGING, [GOOD], list(unknowns))


def of_modulus(*given: Any, **more: Any) -> Callable[[], object]:
    return lambda: asking(Unknown("arm.E_kPa", *given, **more))()


TOUCHING = HANGING + Contact(Sphere((0.1, 0.0, -0.1), 0.02))
REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "beyond the tip": (
        measuring(points=[(0.3, (0, 0, 0), (0, 0, -0.1))]),
        r"points\[0\].s = 0.3.* 0 to 0.2 m",
    ),
    "s in mm": (measuring(points=[(100.0, (0, 0, 0), (0, 0, -0.1))]), "is it in mm"),
    "offset in mm": (measuring(points=[(0.1, (0, 0, 20), (0, 0, -0.1))]), "offset.*is it in mm"),
    "place in mm": (measuring(points=[(0.1, (0, 0, 0), (0, 0, -100.0))]), "is it in mm"),
    "place in km": (measuring(points=[(0.2, (0, 0, 0), (0, 0, -1e-4))]), "1000 times too small"),
    "no number": (
        measuring(points=[(0.1, (0, 0, 0), (0, float("inf"), 0))]),
        r"place\[1\].*finite",
    ),
    "no coordinate": (
        measuring(points=[(0.1, (0, 0, 0), (None, float("nan"), None))]),
        r"points\[0\].place = \(None, None, None\): must be .* one coordinate; None in place of",
    ),
    "no coordinate of the tip": (
        measuring(tip=(None, None, None)),
        r"Measured.tip = \(None, None, None\): must be a place with at least one coordinate",
    ),
    "two coordinates": (measuring(tip=(0.1, 0.1)), r"Measured.tip = .*\(x, y, z\) in m, None or"),
    "a coordinate in mm": (measuring(tip=(None, None, -200.0)), "tip, z = .*is it in mm"),
    "only coordinates that nothing moves": (
        measuring(points=[(*POINT[:2], (0.0, None, None))]),
        r"measured\[0\]: points\[0\] = \(0.0, None, None\): must be .* depend on arm.E_kPa",
    ),
    "no place": (measuring(points=[(0.1, (0, 0, 0))]), "all in m"),
    "nothing measured": (measuring(points=[]), "points, frames or a tip"),
    "two lengths": (measuring(lengths=[0.2, 0.2]), "3 numbers, one for each"),
    "lengths in mm": (
        measuring(lengths=[0.2, 196.0, 0.2]),
        "lengths, T_12 = 196.0.*is it in mm",
    ),
    "lengths alone in mm": (
        measuring(tensions=None, points=(), tip=(0, 0, -0.1), lengths=[0.2, 200.0, 0.2]),
        r"measured\[0\]: lengths, T_12 = 200.0.*in mm",
    ),
    "strokes in mm": (
        measuring(strokes=[0.0, 0.3, 0.0]),
        "strokes, T_12 = 0.3.*at rest, 0.2 m; is it in mm",
    ),
    "tip in mm": (measuring(tip=(0, 0, -200.0)), "tip.*is it in mm"),
    "tip out of reach": (
        measuring(points=(), tip=(0, 0, -3.0)),
        r"measured\[0\]: tip, z = .*within reach",
    ),
    "a frame that is none": (
        measuring(frames=[(0.1, [[1, 0, 0], [0, 1, 0], [0, 0, 2]])]),
        "orthonormal",
    ),
    "two tensions": (measuring(tensions=[1.0, 2.0]), "3 numbers"),
    "no deviation": (measuring(std=0.0), "above 0"),
    "driven by nothing": (
        measuring(tensions=None, tip=(0, 0, -0.1)),
        "tensions, or else with lengths",
    ),
    "driven twice": (
        measuring(tensions=None, lengths=[0.2] * 3, strokes=[0.0] * 3),
        "tensions, or else with lengths",
    ),
    "nothing unknown": (asking(), "at least one"),
    "what would part": (asking(Unknown("arm.length_mm", 190, 230)), "tie their keys"),
    "a slip": (asking(Unknown("arm.E_kpa", 50, 300)), 'did you mean "E_kPa"'),
    "all radii": (asking(Unknown("arm.radius_mm", 5, 15)), r"arm.radius_mm\[0\]"),
    "a truth": (asking(Unknown("effects.extension", 0, 1)), "a number of arm, effects"),
    "no friction": (
        asking(Unknown("effects.friction.mu", 0, 1)),
        "add effects.friction to the scene",
    ),
    "no such point": (asking(Unknown("points[1].s_mm", 0, 1)), r"in points \[0\] to \[0\]"),
    "bounds beside": (of_modulus(200, 300), "120 kPa"),
    "no session": (of_modulus(50, 300, session="A"), "no shape has a session"),
    "twice": (asking(E, E), "each key once"),
    "too many": (
        asking(E, *(Unknown(f"arm.base_position_mm[{i}]", -9, 9) for i in range(3))),
        "at most as many",
    ),
    "bounds in Pa": (of_modulus(5e4, 4e5), "1000 times too large"),
    "bounds in MPa": (of_modulus(0.05, 0.4), "1000 times too small"),
    "no room": (of_modulus(3, 3), "above lower"),
    "no bound": (of_modulus(3, float("inf")), "finite"),
    "a mean beside": (of_modulus(3, 9, (1, 2)), "a mean within the bounds"),
    "a mean for sure": (of_modulus(3, 9, (4, 0)), "standard deviation above 0"),
    "no key": (lambda: Unknown((), 3, 9), "a key path"),
    "a key twice": (lambda: Unknown(("arm.nu", "arm.nu"), 0, 0.5), "each key once"),
    "as printed": (
        lambda: calibrate(small_arm(), Scene.as_printed(), [GOOD], [E]),
        "hold under loads",
    ),
    "one shape by itself": (
        lambda: calibrate(small_arm(), HANGING, GOOD, [E]),  # type: ignore[arg-type]
        "a sequence of Measured",
    ),
    "one unknown by itself": (
        lambda: calibrate(small_arm(), HANGING, [GOOD], E),  # type: ignore[arg-type]
        "a sequence of at least one, such as Unknown",
    ),
    **{
        f"{name} of {given}": (
            lambda name=name, given=given: calibrate(
                small_arm(), HANGING, [GOOD], [E], **{name: given}
            ),
            name,
        )
        for name, given in (
            ("time_limit", "a while"),
            ("loss", np.zeros(2)),
            ("absolute_std", np.zeros(2)),
        )
    },
    "contact": (lambda: calibrate(small_arm(), TOUCHING, [GOOD], [E]), "contact"),
}


@pytest.mark.parametrize(("attempt", "told"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_calibrated_is_refused(attempt: Callable[[], object], told: str) -> None:
    with pytest.raises(InputError, match=told):
        attempt()


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
    with pytest.raises(OctoplanError, match=r"does not settle.*are they in mN\?"):
        calibrate(small_arm(), HANGING, [strong], [Unknown("arm.E_kPa", 100, 400)])
    found = calibrate(small_arm(), Scene(Extension()), [strong], [Unknown("arm.E_kPa", 100, 400)])
    assert "are they in mN?" in found.outcome


def test_a_robust_loss_is_not_advised_where_there_is_one() -> None:
    pulls = [[pull, 0, 0] for pull in (0.2, 0.4, 0.6, 0.8)]
    shapes = [Measured(T, tip=settle(small_arm(), T, HANGING).tip) for T in pulls]
    shapes[0] = replace(shapes[0], tip=np.add(shapes[0].tip, 0.01))
    for loss, advised in (("linear", True), ("huber", False)):
        found = calibrate(small_arm(), HANGING, shapes, [E], loss=loss)  # type: ignore[arg-type]
        assert "as well as the others" in found.outcome
        assert ("robust loss" in found.outcome) == advised


def test_what_is_asked_of_a_calibration_is_checked() -> None:
    found = calibrate(small_arm(), HANGING, [GOOD, replace(GOOD, name="again")], [E])
    asked, T = found.predict([1.0, 0.0, 0.0]), [1.0, 0.0, 0.0]
    attempts: list[tuple[Callable[[], object], str]] = [
        (lambda: found.predict(T, 3), "points"),  # type: ignore[arg-type]
        (lambda: found.predict(T, [(0.1,)]), r"points\[0\]"),  # type: ignore[list-item]
        (lambda: found.predict(T, session="C"), "session"),
        (lambda: found.next(3), "candidates"),  # type: ignore[arg-type]
        (lambda: found.leave_out(3), "groups"),  # type: ignore[arg-type]
        (lambda: found.interval(2.0), "level"),
        (lambda: asked.band(-1.0), "level"),
        (lambda: asked.holds([asked.tip], 3.0), "level"),
        (lambda: asked.holds([[0.1, 0.2]]), "places"),
        (lambda: calibrate(small_arm(), HANGING, [GOOD], [E], starts=2, seed=-1), "seed"),
        (lambda: critical_load_factor(small_arm(), T, 3), "scene"),  # type: ignore[arg-type]
        (lambda: critical_load_factor(small_arm(), T, HANGING, accuracy=0.0), "accuracy"),
    ]
    for attempt, told in attempts:
        with pytest.raises(InputError, match=told):
            attempt()
