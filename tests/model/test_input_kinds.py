"""Inputs of the wrong kind are refused; values that say the same are the same."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from model import (
    Anchorage,
    Arm,
    CollapsedError,
    InputError,
    Linear,
    Material,
    Sampled,
    Scene,
    settle,
    settle_many,
)
from model.effects import Extension

ARM = Arm.from_paper("table-2")
REST = np.zeros(12)
THIN, BODY = Linear(1e-3, 1e-3), Linear(0.01, 0.01)
ONE = (Anchorage(0.3, THIN),)

TEXT: dict[str, Callable[[], object]] = {
    "Material.E": lambda: Material(E="110e3"),
    "Material.nu": lambda: Material(nu="0.5"),
    "Linear": lambda: Linear("0.01", 0.02),
    "Sampled": lambda: Sampled(("0", "1", "2", "3"), (1, 1, 1, 1)),
    "Arm.length": lambda: Arm("0.3", BODY, ONE),
    "Anchorage.at": lambda: Anchorage("0.3", THIN),
    "Anchorage.angles": lambda: Anchorage(0.3, THIN, ("0", "1")),
    "tensions": lambda: settle(ARM, ["1"] * 12),
    "tensions in one string": lambda: settle(ARM, "123456789012"),
    "accuracy": lambda: settle(ARM, REST, accuracy="1e-3"),
    "position": lambda: settle(ARM, REST).position("0.1"),
}

KIND: dict[str, Callable[[], object]] = {
    "radius a number": lambda: Arm(0.3, 0.01, ONE),
    "sections a number": lambda: Arm(0.3, BODY, 3),
    "section a tuple": lambda: Arm(0.3, BODY, ((0.3, 1e-3, 1e-3),)),
    "one section, no tuple": lambda: Arm(0.3, BODY, ONE[0]),
    "material by name": lambda: Arm(0.3, BODY, ONE, "silicone"),
    "offset a class": lambda: Anchorage(0.3, Linear),
    "scene by name": lambda: settle(ARM, REST, "bare"),
    "effect for a scene": lambda: settle(ARM, REST, Extension()),
    "arm by name": lambda: settle("table-2", REST),
    "many, nothing": lambda: settle_many(ARM, None),
    "many, one number": lambda: settle_many(ARM, 1.0),
    "by section, too few": lambda: ARM.by_section(np.zeros(11)),
    "preset by a list": lambda: Arm.from_paper(["table-2"]),
}


@pytest.mark.parametrize("attempt", TEXT.values(), ids=TEXT)
def test_a_string_is_not_a_number(attempt: Callable[[], object]) -> None:
    with pytest.raises(InputError):
        attempt()


@pytest.mark.parametrize("attempt", KIND.values(), ids=KIND)
def test_a_value_of_another_kind_is_refused(attempt: Callable[[], object]) -> None:
    with pytest.raises(InputError):
        attempt()


def test_no_places_have_no_positions() -> None:
    assert settle(ARM, REST).position([]).shape == (0, 3)


def test_a_crushed_set_among_many_is_a_collapse_as_it_is_alone() -> None:
    with pytest.raises(CollapsedError):
        settle_many(ARM, [np.zeros(12), np.full(12, 100.0)], Scene(Extension()))


def test_a_number_in_an_array_leaves_the_material_hashable() -> None:
    assert hash(Material(E=np.array(1e5))) == hash(Material(E=1e5))


def test_the_order_of_effects_makes_no_other_scene() -> None:
    effects = Scene.as_printed().effects
    assert Scene(*effects[::-1]) == Scene(*effects)
