"""What is no arm is refused, by name, when it is made."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from model import Anchorage, Arm, Linear, Material, Sampled, conical
from tests.model.cases import check_refusal

THIN = Linear(1e-3, 1e-3)
ONE = (Anchorage(0.3, THIN),)
FLAT4 = (1e-3,) * 4
INF, NAN = np.inf, np.nan


def of(length: float = 0.3, radius: Any = (0.01, 0.01), rows: Any = ((0.3, 1e-3, 1e-3),)) -> Arm:
    return conical(length, radius, rows)


REFUSED: dict[str, tuple[Callable[[], object], str, str]] = {
    "no modulus": (lambda: Material(E=0), "Material.E", "above 0"),
    "negative modulus": (lambda: Material(E=-1e5), "Material.E", "above 0"),
    "infinite modulus": (lambda: Material(E=INF), "Material.E", "finite"),
    "modulus in words": (lambda: Material(E="soft"), "Material.E", "numbers"),
    "no density": (lambda: Material(density=0), "Material.density", "above 0"),
    "nu of -1": (lambda: Material(nu=-1.0), "Material.nu", "above -1"),
    "nu below -1": (lambda: Material(nu=-1.5), "Material.nu", "from -1"),
    "nu above a half": (lambda: Material(nu=0.51), "Material.nu", "to 0.5"),
    "nu not a number": (lambda: Material(nu=NAN), "Material.nu", "finite"),
    "modulus out of this world": (lambda: Material(E=1e31), "Material.E", "up to 1e+30"),
    "hardly any modulus": (lambda: Material(E=1e-31), "Material.E", "from 1e-30"),
    "no length": (lambda: of(length=0), "Arm.length", "above 0"),
    "negative length": (lambda: of(length=-0.3), "Arm.length", "above 0"),
    "no radius": (lambda: of(radius=(0.01, 0)), "Arm.radius", "s = 0.3 m"),
    "negative radius": (lambda: of(radius=(-0.01, 0.01)), "Arm.radius", "s = 0 m"),
    "radius not a number": (lambda: of(radius=(0.01, NAN)), "Linear", "finite"),
    "no sections": (lambda: of(rows=()), "Arm.sections", "at least one"),
    "sections from base to tip": (
        lambda: of(rows=((0.1, 1e-3, 1e-3), (0.3, 1e-3, 1e-3))),
        "Arm.sections[1].at",
        "below 0.1 m",
    ),
    "two sections at one place": (
        lambda: of(rows=((0.3, 1e-3, 1e-3), (0.2, 1e-3, 1e-3), (0.2, 1e-3, 1e-3))),
        "Arm.sections[2].at",
        "below 0.2 m",
    ),
    "section beyond the arm": (
        lambda: of(rows=((0.31, 1e-3, 1e-3),)),
        "Arm.sections[0].at",
        "up to the length 0.3 m",
    ),
    "section at the base": (lambda: of(rows=((0, 1e-3, 1e-3),)), "Anchorage.at", "above 0"),
    "tendon outside the base": (
        lambda: of(rows=((0.3, 0.0101, 1e-3),)),
        "Arm.sections[0].offset",
        "0.01 m at s = 0 m",
    ),
    "tendon outside the tip": (
        lambda: of(radius=(0.01, 2e-3), rows=((0.3, 3e-3, 3e-3),)),
        "Arm.sections[0].offset",
        "0.002 m at s = 0.3 m",
    ),
    "tendon outside on the other side": (
        lambda: of(rows=((0.3, -0.0101, 1e-3),)),
        "Arm.sections[0].offset",
        "0.01 m",
    ),
    "offset that is a number": (lambda: Anchorage(0.3, 1e-3), "Anchorage.offset", "Linear"),
    "no tendons": (lambda: Anchorage(0.3, THIN, ()), "Anchorage.angles", "at least one"),
    "angle not a number": (lambda: Anchorage(0.3, THIN, (NAN,)), "Anchorage.angles", "finite"),
    "left-handed base": (
        lambda: Arm(0.3, Linear(0.01, 0.01), ONE, base_frame=np.diag([1, 1, -1])),
        "Arm.base_frame",
        "right-handed",
    ),
    "stretched base": (
        lambda: Arm(0.3, Linear(0.01, 0.01), ONE, base_frame=1.1 * np.eye(3)),
        "Arm.base_frame",
        "orthonormal",
    ),
    "base in the plane": (
        lambda: Arm(0.3, Linear(0.01, 0.01), ONE, base_position=(0.0, 0.0)),
        "Arm.base_position",
        "shape 3",
    ),
    "three samples": (lambda: Sampled((0, 0.1, 0.3), (1e-3,) * 3), "Sampled.s", "at least 4"),
    "samples in disorder": (lambda: Sampled((0, 2, 1, 3), FLAT4), "Sampled.s", "increasing"),
    "sample given twice": (lambda: Sampled((0, 1, 1, 3), FLAT4), "Sampled.s", "increasing"),
    "a value missing": (lambda: Sampled((0, 1, 2, 3), (1e-3,) * 3), "Sampled.values", "shape 4"),
    "sample not a number": (lambda: Sampled((0, 1, 2, NAN), FLAT4), "Sampled.s", "finite"),
    "radius sampled short of the tip": (
        lambda: Arm(0.3, Sampled((0, 0.1, 0.2, 0.29), (0.01,) * 4), ONE),
        "Sampled.s",
        "samples from 0 to 0.3 m",
    ),
    "offset sampled from above the base": (
        lambda: Arm(
            0.3, Linear(0.01, 0.01), (Anchorage(0.2, Sampled((0.01, 0.1, 0.15, 0.2), FLAT4)),)
        ),
        "Sampled.s",
        "samples from 0 to 0.2 m",
    ),
}


@pytest.mark.parametrize(("attempt", "field", "allowed"), REFUSED.values(), ids=REFUSED)
def test_is_refused_naming_field_and_what_is_allowed(
    attempt: Callable[[], object], field: str, allowed: str
) -> None:
    check_refusal(attempt, field, allowed)


def test_the_bounds_themselves_are_allowed() -> None:
    assert Material(nu=0.5).G == 110e3 / 3
    assert of(rows=((0.3, 0.01, 0.01),)).n_tendons == 4
    assert Sampled((0, 1, 2, 3), FLAT4).values == FLAT4
