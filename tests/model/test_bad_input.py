"""What cannot be settled or read is refused, by name."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import Extension
from tests.model.cases import check_refusal

ARM = Arm.from_paper("table-2")
REST = np.zeros(12)
NAN = np.nan

REFUSED: dict[str, tuple[Callable[[], object], str, str]] = {
    "unknown arm": (lambda: Arm.from_paper("table-3"), "arm", "table-2, table-4, section-5.1, "),
    "section 0": (lambda: ARM.tendons_of(0), "section", "from 1 to 3"),
    "section 4": (lambda: ARM.tendons_of(4), "section", "from 1 to 3"),
    "effect given twice": (lambda: Scene(Extension(), Extension()), "Scene", "once"),
    "effect by name": (lambda: Scene("Extension"), "Scene effect 1", "Extension()"),
    "class of an effect": (lambda: Scene(Extension), "Scene effect 1", "Extension()"),
    "accuracy of 0": (lambda: settle(ARM, REST, accuracy=0), "accuracy", "from 1e-12 to 0.1"),
    "accuracy too fine": (lambda: settle(ARM, REST, accuracy=9e-13), "accuracy", "from 1e-12"),
    "accuracy too coarse": (lambda: settle(ARM, REST, accuracy=0.11), "accuracy", "to 0.1"),
    "accuracy not a number": (lambda: settle(ARM, REST, accuracy=NAN), "accuracy", "finite"),
    "accuracy in words": (lambda: settle(ARM, REST, accuracy="fine"), "accuracy", "numbers"),
    "unknown scheme": (
        lambda: settle(ARM, REST, scheme="euler"),
        "scheme",
        "magnus6, gauss6, magnus4",
    ),
    "scheme of another scene": (
        lambda: settle(ARM, REST, Scene.as_printed(), scheme="magnus6"),
        "scheme",
        "rk6, rk8, rk4 in this scene",
    ),
    "place before the base": (lambda: settle(ARM, REST).position(-1e-3), "s", "from 0 to 0.31 m"),
    "place beyond the tip": (lambda: settle(ARM, REST).frame([0, 0.32]), "s", "from 0 to 0.31 m"),
    "place not a number": (lambda: settle(ARM, REST).strain(NAN), "s", "finite"),
    "places in a table": (lambda: settle(ARM, REST).position(np.zeros((2, 2))), "s", "shape n"),
}


@pytest.mark.parametrize(("attempt", "field", "allowed"), REFUSED.values(), ids=REFUSED)
def test_is_refused_naming_field_and_what_is_allowed(
    attempt: Callable[[], object], field: str, allowed: str
) -> None:
    check_refusal(attempt, field, allowed)


def test_the_bounds_themselves_are_allowed() -> None:
    assert settle(ARM, REST, accuracy=0.1).error <= 0.1
    assert settle(ARM, REST, accuracy=1e-12).error <= 1e-12
    assert settle(ARM, REST).position([0.0, 0.31]).shape == (2, 3)
