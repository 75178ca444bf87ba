"""Tensions that are not tensions, and tensions that crush the arm."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from model import (
    Arm,
    CollapsedError,
    ConvergenceError,
    InputError,
    OctoplanError,
    Scene,
    settle,
    settle_many,
)
from model.effects import Extension
from tests.oracles import Array, paper_rod, strain
from tests.refusals import Refused, check_refusal

ARM = Arm.from_paper("table-2")
PAPER = Scene(Extension())
CRUSHING = np.array([0, 0, 0, 0, 0, 0, 0, 0, 20.0, 20, 20, 20])


def tensions(index: int, value: float) -> Array:
    T = np.ones(12)
    T[index] = value
    return T


NO_TENSION = "finite number, 0 or above"
SHAPED = "12 numbers, flat or a row per section, tip first (4+4+4)"
WRONG: dict[str, Any] = {
    "too few": np.zeros(11),
    "too many": np.zeros(13),
    "none": [],
    "columns for rows": np.zeros((4, 3)),
    "a set of sets": np.zeros((1, 12)),
    "a table of tables": np.zeros((3, 4, 1)),
    "ragged rows": [[0.0] * 4, [0.0] * 3, [0.0] * 5],
    "one number": 1.0,
    "nothing": None,
    "words": ["tight"] * 12,
    "complex numbers": [1j] * 12,
}
NOT_ALLOWED: Refused = {
    **{what: (partial(settle, ARM, given), "tensions", SHAPED) for what, given in WRONG.items()},
    **{
        f"{name} {value}": (
            partial(settle, ARM, tensions(index, value)),
            f"tensions[{index}] ({name})",
            NO_TENSION,
        )
        for index, name in ((0, "T_11"), (4, "T_21"), (11, "T_34"))
        for value in (-1e-9, -1.0, np.nan, np.inf, -np.inf)
    },
    "in rows": (
        lambda: settle(ARM, tensions(4, -1.0).reshape(3, 4)),
        "tensions[4] (T_21)",
        NO_TENSION,
    ),
    "a set of many": (
        lambda: settle_many(ARM, [np.zeros(12), np.zeros(12), tensions(5, -1.0)]),
        "tensions[2][5] (T_22)",
        NO_TENSION,
    ),
    "a short set of many": (
        lambda: settle_many(ARM, [np.zeros(12), np.zeros(11)]),
        "tensions[1]",
        "12 numbers",
    ),
    "errors by another word": (
        lambda: settle_many(ARM, [np.zeros(12)], errors="ignore"),  # type: ignore[arg-type]
        "errors",
        "",
    ),
    **{
        f"compiled by {how!r}": (
            partial(settle, ARM, np.zeros(12), compile=how),
            "compile",
            'True, False or "auto"',
        )
        for how in ("try", 1, None)
    },
    "a scheme as printed": (
        lambda: settle(ARM, np.zeros(12), Scene.as_printed(), scheme="gauss6"),
        "scheme",
        "rk6, rk8, rk4 in this scene",
    ),
}


@pytest.mark.parametrize(("attempt", "field", "allowed"), NOT_ALLOWED.values(), ids=NOT_ALLOWED)
def test_what_is_no_tension_is_refused_by_the_name_of_its_tendon(
    attempt: Callable[[], object], field: str, allowed: str
) -> None:
    check_refusal(attempt, field, allowed)


@pytest.mark.parametrize("scene", [PAPER, Scene.as_printed()], ids=["paper", "as_printed"])
def test_an_arm_is_not_crushed_unnoticed(scene: Scene) -> None:
    with pytest.raises(CollapsedError) as caught:
        settle(ARM, CRUSHING, scene)
    error = caught.value
    at = ARM.sections[2].at
    assert error.s == pytest.approx(at)
    assert error.stretch == pytest.approx(1 + strain(paper_rod("table-2"), CRUSHING, at, True)[3])
    assert error.stretch < 0
    assert f"s = {error.s:.6g} m" in str(error)
    assert settle(ARM, CRUSHING).error < 1e-6


def test_an_arm_just_short_of_crushing_settles() -> None:
    rod, at = paper_rod("table-2"), ARM.sections[2].at
    limit = CRUSHING / -strain(rod, CRUSHING, at, True)[3]
    assert settle(ARM, 0.999 * limit, PAPER).strain(at)[3] == pytest.approx(-0.999)
    with pytest.raises(CollapsedError):
        settle(ARM, 1.001 * limit, PAPER)


def test_a_crushed_set_among_many_is_named_as_a_collapse_as_it_is_alone() -> None:
    with pytest.raises(CollapsedError, match=r"tensions\[1\]"):
        settle_many(ARM, [np.zeros(12), CRUSHING], PAPER)


ERRORS = [
    InputError("arm", "table-3", "table-2"),
    InputError("tensions", np.float64(-1.0), "0 or above"),
    CollapsedError(0.093, -0.5),
    ConvergenceError(1e-6, 1e-3, "ask for less"),
]


@pytest.mark.parametrize("error", ERRORS, ids=lambda e: type(e).__name__)
def test_errors_travel_between_processes(error: OctoplanError) -> None:
    there = pickle.loads(pickle.dumps(error))
    assert type(there) is type(error)
    assert isinstance(there, OctoplanError)
    assert str(there) == str(error)
    assert vars(there) == vars(error)


@pytest.mark.parametrize("reached", [np.inf, np.nan])
def test_an_arm_of_which_no_error_is_known_is_not_settled(reached: float) -> None:
    """Used to be settled to nan of its length."""
    assert str(ConvergenceError(1e-8, reached, "x")) == "the arm was not settled; x"
