"""Effects that are none, contradict each other, or are more than an arm bears."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations
from typing import Any

import numpy as np
import pytest

from model import (
    Arm,
    InputError,
    Scene,
    settle,
    settle_many,
)
from model.effects import (
    Buoyancy,
    Current,
    Effect,
    ExactTendons,
    Extension,
    Friction,
    NeoHookean,
    PointLoad,
    PrintedStatics,
    Shear,
    TipLoad,
    Weight,
)
from planner import plan, switch_effects
from planner.targets import TipPosition
from tests.model.cases import check_refusal

ARM = Arm.from_paper("table-4")
ONE_SECTION = Arm.from_paper("section-5.2")
PAPER = Scene(Extension())
BENT = np.ravel([[0, 0.05, 0, 0], [0, 0, 0.8, 0.3], [1.5, 0, 0, 0]])
INF, NAN = np.inf, np.nan
FORCE = (0.0, 0.0, -1e-3)
TIP = TipPosition((0.2, 0.05, 0.0))

NUMBERS: dict[str, tuple[Callable[[Any], Effect], str]] = {
    "Buoyancy.density": (Buoyancy, "0 or a number above"),
    "Current.density": (lambda x: Current(FORCE, density=x), "0 or a number above"),
    "Current.coefficient": (lambda x: Current(FORCE, coefficient=x), "0 or a number above"),
    "Friction.mu": (Friction, "0 or a number above"),
    "PointLoad.s": (lambda x: PointLoad(x, FORCE), "0 or a number above"),
    "Shear.k_s": (Shear, "above 0"),
}
VECTORS: dict[str, Callable[[Any], Effect]] = {
    "Weight.g": Weight,
    "Current.velocity": Current,
    "PointLoad.force": lambda x: PointLoad(0.2, x),
    "TipLoad.force": lambda x: TipLoad(force=x),
    "TipLoad.moment": lambda x: TipLoad(moment=x),
}
NO_NUMBERS = {"NaN": NAN, "infinite": INF, "a string": "0.1", "nothing": None, "a truth": True}
NO_VECTORS: dict[str, tuple[Any, str]] = {
    "a number": (1.0, "shape 3"),
    "two numbers": ((1.0, 2.0), "shape 3"),
    "four numbers": ((1.0, 2.0, 3.0, 4.0), "shape 3"),
    "a column": (((1.0,), (2.0,), (3.0,)), "shape 3"),
    "ragged": ((1.0, (2.0,), 3.0), "shape 3"),
    "a string": ("down", "shape 3"),
    "strings": (("0", "0", "1"), "shape 3"),
    "nothing": (None, "shape 3"),
    "truths": ((True, False, True), "shape 3"),
    "complex": ((0, 0, 1j), "shape 3"),
    "NaN": ((0.0, NAN, 0.0), "finite"),
    "infinite": ((0.0, 0.0, -INF), "finite"),
    "out of this world": ((0.0, 0.0, 1e31), "up to 1e+30"),
}


@pytest.mark.parametrize("field", NUMBERS)
def test_a_number_below_zero_is_refused(field: str) -> None:
    make, allowed = NUMBERS[field]
    check_refusal(lambda: make(-1e-9), field, allowed)


@pytest.mark.parametrize("what", NO_NUMBERS)
@pytest.mark.parametrize("field", NUMBERS)
def test_what_is_no_finite_number_is_refused(field: str, what: str) -> None:
    allowed = "finite" if what in ("NaN", "infinite") else "numbers"
    check_refusal(lambda: NUMBERS[field][0](NO_NUMBERS[what]), field, allowed)


@pytest.mark.parametrize("field", NUMBERS)
def test_several_numbers_in_place_of_one_are_refused(field: str) -> None:
    check_refusal(lambda: NUMBERS[field][0]((0.1, 0.2)), field, "shape scalar")


@pytest.mark.parametrize("what", NO_VECTORS)
@pytest.mark.parametrize("field", VECTORS)
def test_what_is_no_finite_vector_is_refused(field: str, what: str) -> None:
    value, allowed = NO_VECTORS[what]
    check_refusal(lambda: VECTORS[field](value), field, allowed)


def test_no_shear_stiffness_is_refused_but_none_of_the_others_needs_to_be_above_zero() -> None:
    check_refusal(lambda: Shear(0.0), "Shear.k_s", "above 0")
    for field, (make, _) in NUMBERS.items():
        assert field == "Shear.k_s" or make(0) == make(0.0)


@pytest.mark.parametrize("follower", ["yes", 1, 0.0, None, (True,)], ids=str)
def test_a_load_follows_or_does_not(follower: Any) -> None:
    check_refusal(lambda: TipLoad(FORCE, follower=follower), "TipLoad.follower", "True or False")


@pytest.mark.parametrize("anticlastic", ["no", 2, None, [True]], ids=str)
def test_tendons_shift_or_do_not(anticlastic: Any) -> None:
    check_refusal(lambda: NeoHookean(anticlastic), "NeoHookean.anticlastic", "True or False")


@pytest.mark.parametrize(
    ("direction", "allowed"),
    [
        (0, "1 (pulling in) or -1 (paying out)"),
        (2, "1 (pulling in) or -1 (paying out)"),
        ((1, 0), "1 (pulling in) or -1 (paying out)"),
        ((), "1 (pulling in) or -1 (paying out)"),
        ((1, NAN), "finite"),
        (1.0, "shape n"),
        ("in", "numbers of shape n"),
        (True, "numbers of shape n"),
        (((1,), (-1,)), "shape n"),
    ],
    ids=str,
)
def test_a_direction_is_in_or_out(direction: Any, allowed: str) -> None:
    check_refusal(lambda: Friction(0.1, direction), "Friction.direction", allowed)


ASKED: dict[str, Callable[[Arm, Scene], object]] = {
    "settle": lambda arm, scene: settle(arm, np.zeros(arm.n_tendons), scene),
    "settle_many": lambda arm, scene: settle_many(arm, np.zeros((2, arm.n_tendons)), scene),
    "switch_effects": lambda arm, scene: switch_effects(arm, np.zeros(arm.n_tendons), scene),
    "plan": lambda arm, scene: plan(arm, TIP, scene, 20.0),
}


@pytest.mark.parametrize("ask", ASKED.values(), ids=ASKED)
def test_a_point_load_off_the_arm_is_refused_wherever_it_is_given(ask: Any) -> None:
    scene = Scene(PointLoad(0.45 + 1e-6, FORCE))
    check_refusal(lambda: ask(ARM, scene), "PointLoad.s", "0.45 m")


@pytest.mark.parametrize("ask", ASKED.values(), ids=ASKED)
def test_directions_for_another_number_of_tendons_are_refused_wherever_given(ask: Any) -> None:
    scene = Scene(Friction(0.1, (1, -1, 1)))
    check_refusal(lambda: ask(ARM, scene), "Friction.direction", "one for each of 12 tendons")


BARS: dict[str, tuple[tuple[Any, ...], str, str]] = {
    "an effect by name": (("Weight",), "Scene effect 1", "an effect such as Extension()"),
    "a class": ((Extension(), Weight), "Scene effect 2", "an effect such as Extension()"),
    "a list of effects": (([Extension()],), "Scene effect 1", "an effect such as Extension()"),
    "a scene": ((Scene(),), "Scene effect 1", "an effect such as Extension()"),
    "nothing": ((None,), "Scene effect 1", "an effect such as Extension()"),
    "one given twice": ((Weight(), Weight()), "Scene", "each effect once"),
    "two of a kind": ((TipLoad(FORCE), TipLoad()), "Scene", "each effect once"),
    "two currents": ((Current(FORCE), Current(FORCE, 1.2)), "Scene", "each effect once"),
    "two points at a place": (
        (PointLoad(0.2, FORCE), PointLoad(0.1, FORCE), PointLoad(0.2, (1.0, 0.0, 0.0))),
        "Scene",
        "loads and masses: once at a place",
    ),
    "buoyancy of what weighs nothing": (
        (Extension(), Buoyancy()),
        "Scene",
        "Buoyancy with Weight: it is a weight",
    ),
    "rubber on a bending arm": ((NeoHookean(),), "Scene", "NeoHookean with Extension"),
    "rubber on the paper's tendons": (
        (NeoHookean(), Extension(), Weight()),
        "Scene",
        "NeoHookean with ExactTendons",
    ),
}


@pytest.mark.parametrize(("effects", "field", "allowed"), BARS.values(), ids=BARS)
def test_effects_that_make_no_scene_are_refused(
    effects: tuple[Any, ...], field: str, allowed: str
) -> None:
    check_refusal(lambda: Scene(*effects), field, allowed)


WITHOUT_LOADS = "eqs. (10) and (11) are written without loads or shear"
NOT_PRINTED: dict[str, tuple[tuple[Effect, ...], str]] = {
    "tip load": ((TipLoad(FORCE),), WITHOUT_LOADS),
    "point load": ((PointLoad(0.1, FORCE),), WITHOUT_LOADS),
    "weight": ((Weight(),), WITHOUT_LOADS),
    "weight in water": ((Weight(), Buoyancy()), WITHOUT_LOADS),
    "current": ((Current(FORCE),), WITHOUT_LOADS),
    "shear": ((Shear(),), WITHOUT_LOADS),
    "friction": ((Friction(0.1),), "tensions that do not vary along a tendon"),
    "exact tendons": ((ExactTendons(),), "the reference tangent"),
    "rubber": ((ExactTendons(), NeoHookean()), "eqs. (10) and (11) are written for"),
}


@pytest.mark.parametrize(("effects", "reason"), NOT_PRINTED.values(), ids=NOT_PRINTED)
def test_the_printed_equations_take_nothing_else_and_the_reason_is_told(
    effects: tuple[Effect, ...], reason: str
) -> None:
    for order in permutations((Extension(), PrintedStatics(), *effects)):
        check_refusal(lambda order=order: Scene(*order), "Scene", reason)


def test_two_point_loads_at_different_places_are_fine() -> None:
    loads = (PointLoad(0.1, FORCE), PointLoad(0.2, FORCE))
    assert Scene(*loads).effects == loads
    assert settle(ARM, BENT, Scene(*loads), 1e-4).error <= 1e-4


@pytest.mark.parametrize("apart", [5e-17, 1e-12, 1e-10, 1e-8], ids=str)
@pytest.mark.parametrize("at", [0.3, 0.315, 0.45 - 2e-8], ids=["between", "anchorage", "tip"])
def test_point_loads_that_all_but_coincide_are_felt_together(at: float, apart: float) -> None:
    near = float(max(np.nextafter(at, 1), at + apart))
    two = settle(ARM, BENT, Scene(PointLoad(at, FORCE), PointLoad(near, FORCE)), 1e-8)
    one = settle(ARM, BENT, Scene(PointLoad(at, tuple(2 * np.array(FORCE)))), 1e-8)
    assert np.linalg.norm(two.tip - one.tip) < (1e-8 + apart) * ARM.length


LOADED: dict[str, Scene] = {
    "weight": Scene(Extension(), Weight(), Buoyancy()),
    "tip load": Scene(TipLoad(FORCE)),
    "point load": Scene(PointLoad(0.1, FORCE)),
    "current": Scene(Current((0.0, 0.1, 0.0))),
    "friction": Scene(Friction(0.1)),
    "shear": Scene(*Scene.silicone().effects, Shear()),
}


@pytest.mark.parametrize("scene", LOADED.values(), ids=LOADED)
def test_maps_of_loaded_scenes_are_by_collocation(scene: Scene) -> None:
    for scheme in ("magnus6", "rk6"):
        with pytest.raises(InputError, match="gauss6, gauss4, gauss2, gauss8 in this scene"):
            settle(ARM, BENT, scene, scheme=scheme)
