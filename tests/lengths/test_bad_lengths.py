"""Lengths that are not allowed, or that no shape has: told by name, with what is allowed."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from model import Arm, InputError, Scene, UnitWarning, settle, settle_many
from model.effects import Buoyancy, Effect, ExactTendons, Extension, Weight
from model.stiffness import stiffness
from model.winches import rest_lengths
from tests.lengths.cases import EXACT, cylinder
from tests.model.cases import check_refusal

ARM = Arm.from_paper("table-2")
REST = rest_lengths(ARM)
_NONE: list[Any] = [None]


@pytest.mark.parametrize(
    ("field", "allowed", "options"),
    [
        ("lengths[8] (T_31)", "0 or above", {"lengths": REST - 0.2}),
        ("lengths", "12 numbers", {"lengths": REST[:5]}),
        ("lengths", "12 numbers", {"lengths": "long"}),
        ("lengths", "12 numbers", {"lengths": 0.3}),
        ("lengths", "12 numbers", {"lengths": [["0.3"] * 4] * 3}),
        ("lengths[2] (T_13)", "0 or above", {"lengths": [0.3, 0.3, np.inf, *REST[3:]]}),
        ("lengths[0] (T_11)", "a length or a tension", {"lengths": [*_NONE, *REST[1:]]}),
        (
            "lengths[0] (T_11)",
            "None or nan in place of the other",
            {"lengths": REST, "tensions": np.zeros(12)},
        ),
        ("tensions", "12 numbers", {"lengths": [*_NONE, *REST[1:]], "tensions": [1.0]}),
        ("tensions", "12 numbers", {}),
        ("lengths", "as printed", {"lengths": REST, "scene": Scene.as_printed()}),
        ("tendon_EA", "above 0", {"lengths": REST, "tendon_EA": -1.0}),
        ("tendon_EA", "no lengths", {"tensions": np.zeros(12), "tendon_EA": 1.0}),
        ("tendon_outside", "0 or a number above", {"lengths": REST, "tendon_outside": -1.0}),
        ("tendon_outside", "no lengths", {"tensions": np.zeros(12), "tendon_outside": 1.0}),
        ("near", "a Shape", {"lengths": REST, "near": 3}),
        ("near", "the same", {"lengths": REST, "near": settle(cylinder((0.2,)), np.zeros(4))}),
    ],
)
def test_what_is_no_length_is_refused(field: str, allowed: str, options: dict[str, Any]) -> None:
    check_refusal(lambda: settle(ARM, **options), field, allowed)


def test_lengths_that_no_shape_has_name_the_tendon_and_what_there_is() -> None:
    """Two tendons against each other cannot both be shorter than the arm that keeps its length."""
    arm = cylinder((0.2,))
    with pytest.raises(InputError, match=r"lengths\[0\] \(T_11\).*from 0\.2 m on") as caught:
        settle(arm, scene=Scene(ExactTendons()), lengths=[0.19, 0.3, 0.2, 0.3])
    assert caught.value.given == 0.19


def test_nearly_all_length_taken_in_crushes_a_linear_body() -> None:
    arm = cylinder((0.2,))
    with pytest.raises(InputError, match=r"T_11\).*go together, such as .* crush the arm"):
        settle(arm, scene=EXACT, lengths=[1e-9] * 4)


@pytest.mark.parametrize("loads", [(), (Weight(), Buoyancy(1000.0))], ids=["unloaded", "in water"])
def test_lengths_that_crush_the_arm_name_the_tendon_and_the_least(
    loads: tuple[Effect, ...],
) -> None:
    """It was a crushed arm, without the tendon; what is told as the least settles."""
    scene, lengths = Scene(Extension(), *loads), REST.copy()
    lengths[0] *= 0.3
    with pytest.raises(InputError, match=r"lengths\[0\] \(T_11\).*shorter ones crush") as caught:
        settle(ARM, scene=scene, lengths=lengths)
    told = re.search(r"from about (\S+) m on, beside the other lengths", caught.value.allowed)
    assert told is not None
    lengths[0] = float(told[1]) + 1e-5
    assert settle(ARM, scene=scene, lengths=lengths).tensions[0] > 0
    lengths[0] = float(told[1]) - 0.01 * REST[0]
    with pytest.raises(InputError, match="T_11"):
        settle(ARM, scene=scene, lengths=lengths)


def test_a_length_that_no_section_settles_by_tells_the_tendon_and_not_tensions() -> None:
    lengths = REST.copy()
    lengths[5] = 0.0
    with pytest.raises(InputError, match=r"T_22\).*from about .* m on, beside the other lengths"):
        settle(ARM, scene=Scene(Extension(), ExactTendons(), Weight()), lengths=lengths)


def test_lengths_in_millimetres_are_told() -> None:
    with pytest.warns(UnitWarning, match="lengths are all .* 1000 times too long"):
        settle(ARM, scene=EXACT, lengths=1e3 * REST)


def test_settle_many_names_the_set() -> None:
    with pytest.raises(InputError, match=r"lengths\[1\]\[8\] \(T_31\)"):
        settle_many(ARM, lengths=[REST, REST - 0.2], scene=EXACT)
    check_refusal(lambda: settle_many(ARM, lengths=3.0), "lengths", "a set of lengths")
    check_refusal(
        lambda: settle_many(ARM, [[0.0] * 12], lengths=[REST, REST]), "tensions", "2, as of lengths"
    )


def test_stiffness_by_lengths_refuses_what_settle_does() -> None:
    check_refusal(lambda: stiffness(ARM, lengths=REST[:3]), "lengths", "12 numbers")
