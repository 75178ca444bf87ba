"""Lengths that are not allowed, or that no shape has, are refused by name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, InputError, Scene, settle, settle_many
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, Weight
from octoplan.model.effects.base import Effect
from octoplan.model.stiffness import stiffness
from octoplan.model.support.units import UnitWarning
from octoplan.model.tendons import rest_lengths
from octoplan.planner import plan
from octoplan.planner.limits import Limits
from octoplan.planner.targets import TipPosition
from tests.lengths.cases import EXACT, cylinder
from tests.refusals import Refused, check_refusal
from tests.warned import detailed

ARM, OTHER = Arm.from_paper("table-2"), Arm.from_paper("table-4")
REST = rest_lengths(ARM)
_NONE: list[Any] = [None]


INCOMPRESSIBLE, PLACE = Scene(ExactTendons()), TipPosition((0.28, 0.05, 0.0))
LENGTHS: list[tuple[str, str, dict[str, Any]]] = [
    ("lengths[8] (T_31)", "a number from 0", {"lengths": REST - 0.2}),
    ("lengths", "12 numbers", {"lengths": REST[:5]}),
    ("lengths", "12 numbers", {"lengths": "long"}),
    ("lengths", "12 numbers", {"lengths": 0.3}),
    ("lengths", "12 numbers", {"lengths": [["0.3"] * 4] * 3}),
    ("lengths[2] (T_13)", "a number from 0", {"lengths": [0.3, 0.3, np.inf, *REST[3:]]}),
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
    ("tendon_outside", "a number >= 0", {"lengths": REST, "tendon_outside": -1.0}),
    ("tendon_outside", "no lengths", {"tensions": np.zeros(12), "tendon_outside": 1.0}),
    ("near", "a Shape", {"lengths": REST, "near": 3}),
    ("near", "the same", {"lengths": REST, "near": settle(cylinder((0.2,)), np.zeros(4))}),
]
STROKES: list[tuple[str, str, dict[str, Any]]] = [
    ("stroke_max", "a number >= 0", {"limits": Limits(stroke_max=-0.01)}),
    ("stroke_max", "12 numbers", {"limits": Limits(stroke_max=[0.01] * 3)}),
    ("stroke_max", "a number, or one", {"limits": Limits(stroke_max="far")}),
    ("stroke_min", "a number <= 0", {"limits": Limits(stroke_min=0.01)}),
    ("stroke_min", "a number <= 0", {"limits": Limits(stroke_min=np.nan)}),
    ("stroke_min", "12 numbers", {"limits": Limits(stroke_min=[-0.01] * 3)}),
    ("scene", "settle", {"limits": Limits(stroke_max=0.01), "scene": Scene.as_printed()}),
    *(
        ("stroke_zero", "", {"stroke_zero": zero})
        for zero in ("curled", 3.0, [0.1] * 5, [-0.1] * 12, None, settle(OTHER, np.zeros(12)))
    ),
]
REFUSED: Refused = {
    **{
        f"{field} {i}": (partial(settle, ARM, **options), field, allowed)
        for i, (field, allowed, options) in enumerate(LENGTHS)
    },
    **{
        f"{field} of a plan {i}": (
            partial(plan, ARM, PLACE, **({"scene": EXACT, "tension_max": 20.0} | options)),
            field,
            allowed,
        )
        for i, (field, allowed, options) in enumerate(STROKES)
    },
    # Antagonists cannot both be shorter than an inextensible arm.
    "no shape": (
        lambda: settle(cylinder((0.2,)), scene=INCOMPRESSIBLE, lengths=[0.19, 0.3, 0.2, 0.3]),
        "lengths[0] (T_11)",
        "from 0.2 m on",
    ),
    "nearly all length taken in": (
        lambda: settle(cylinder((0.2,)), scene=EXACT, lengths=[1e-9] * 4),
        "T_11",
        "crush the arm",
    ),
    "a set of many": (
        lambda: settle_many(ARM, lengths=[REST, REST - 0.2], scene=EXACT),
        "lengths[1][8] (T_31)",
        "",
    ),
    "no sets": (lambda: settle_many(ARM, lengths=3.0), "lengths", "a set of lengths"),  # type: ignore[arg-type]
    "sets of two sizes": (
        lambda: settle_many(ARM, [[0.0] * 12], lengths=[REST, REST]),
        "tensions",
        "2, as of lengths",
    ),
    "stiffness": (lambda: stiffness(ARM, lengths=REST[:3]), "lengths", "12 numbers"),
}


@pytest.mark.quick("no shape", "a set of many")
@pytest.mark.parametrize(("attempt", "field", "allowed"), REFUSED.values(), ids=REFUSED)
def test_what_is_no_length_or_stroke_is_refused(
    attempt: Callable[[], object], field: str, allowed: str
) -> None:
    check_refusal(attempt, field, allowed)


@pytest.mark.quick("unloaded")
@pytest.mark.parametrize("loads", [(), (Weight(), Buoyancy(1000.0))], ids=["unloaded", "in water"])
def test_lengths_that_crush_the_arm_name_the_tendon(loads: tuple[Effect, ...]) -> None:
    scene, lengths = Scene(Extension(), *loads), REST.copy()
    lengths[0] *= 0.3
    with pytest.raises(InputError, match=r"lengths\[0\] \(T_11\).*more"):
        settle(ARM, scene=scene, lengths=lengths)
    lengths[0] = 0.9 * REST[0]
    assert settle(ARM, scene=scene, lengths=lengths).tensions[0] > 0


def test_lengths_in_millimetres_are_told() -> None:
    with detailed(UnitWarning, "lengths are all .* 1000 times too long"):
        settle(ARM, scene=EXACT, lengths=1e3 * REST)


@pytest.mark.slow
def test_a_length_that_no_section_settles_by_tells_the_tendon_and_not_tensions() -> None:
    lengths, scene = np.where(np.arange(12) == 5, 0.0, REST), Scene(*EXACT.effects, Weight())
    attempt = partial(settle, ARM, scene=scene, lengths=lengths)
    check_refusal(attempt, "lengths[5] (T_22)", "beside the other lengths")


def test_lengths_of_no_tendon_are_as_good_as_none() -> None:
    T, scene = np.full(12, 0.1), Scene(Extension(), ExactTendons())
    by_none = settle(ARM, T, scene, lengths=np.full(12, np.nan))
    np.testing.assert_allclose(by_none.tip, settle(ARM, T, scene).tip, atol=1e-9)
