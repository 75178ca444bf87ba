"""Effects switched off and on: names, influence and cost, arms that do not settle."""

from __future__ import annotations

import numpy as np
import pytest

from octoplan.model import Arm, OctoplanError, Scene, settle
from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    NeoHookean,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.effects.base import Effect
from octoplan.planner.frontends.effect_ablation import Switch, switch_effect, switch_effects
from tests.core.effects.cases import EXACT, SILICONE

ARM = Arm.from_paper("table-4")
BENT = [[0, 0.05, 0, 0], [0, 0, 0.8, 0.3], [1.5, 0, 0, 0]]
NO_PULL = np.zeros(12)
PAPER = Scene(Extension())
IN_AIR = Scene(Extension(), Weight())
IN_WATER = Scene(Extension(), Weight(), Buoyancy())
UPRIGHT = Weight((-9.81, 0.0, 0.0))  # t of the base is x: the arm stands on its base


def switched(scene: Scene, accuracy: float = 1e-6) -> dict[str, Switch]:
    """The change of the bent arm by switching the effects of a scene, by name."""
    return {s.effect: s for s in switch_effects(ARM, BENT, scene, accuracy, repeats=1)}


@pytest.fixture(scope="module")
def in_water() -> dict[str, Switch]:
    return switched(IN_WATER)


def tip_change(scene: Scene, other: Scene, accuracy: float = 1e-6) -> float:
    """The distance between the tips of two settles, over L."""
    tips = [settle(ARM, BENT, s, accuracy).tip for s in (scene, other)]
    return float(np.linalg.norm(tips[0] - tips[1])) / ARM.length


@pytest.mark.quick("as printed")
@pytest.mark.parametrize(
    ("scene", "own", "others"),
    [
        (
            Scene(),
            [],
            [
                "Extension",
                "ExactTendons",
                "NeoHookean and ExactTendons and Extension",
                "Shear",
                "Weight",
            ],
        ),
        (EXACT, ["ExactTendons", "Extension"], ["NeoHookean", "Shear", "Weight"]),
        (
            SILICONE,
            ["ExactTendons and NeoHookean", "Extension and NeoHookean", "NeoHookean"],
            ["Shear", "Weight"],
        ),
        (IN_AIR, ["Extension", "Weight"], ["ExactTendons", "NeoHookean and ExactTendons", "Shear"]),
        (Scene.as_printed(), ["Extension", "PrintedStatics"], []),
    ],
    ids=["bending alone", "exact", "silicone", "weight in air", "as printed"],
)
def test_what_needs_an_effect_or_is_needed_by_it_is_switched_along(
    scene: Scene, own: list[str], others: list[str]
) -> None:
    found = switched(scene, 1e-3)
    assert [name for name, switch in found.items() if switch.enabled] == own
    assert [name for name, switch in found.items() if not switch.enabled] == others


@pytest.mark.slow
def test_each_of_several_point_loads_is_switched_by_itself() -> None:
    loads = (PointLoad(0.1, (0.0, 0.01, 0.0)), PointLoad(0.2, (0.0, 0.01, 0.0)))
    found = switch_effects(ARM, BENT, Scene(*loads), 1e-4, repeats=1)
    changes = [switch.tip_change for switch in found if switch.effect == "PointLoad"]
    wanted = [tip_change(Scene(*loads), Scene(other), 1e-4) for other in reversed(loads)]
    assert changes == pytest.approx(wanted, rel=1e-12)


WITHOUT = {
    "Extension": Scene(Weight(), Buoyancy()),
    "Weight and Buoyancy": PAPER,
}
WITH = {
    "ExactTendons": (ExactTendons(),),
    "NeoHookean and ExactTendons": (NeoHookean(), ExactTendons()),
    "Shear": (Shear(),),
}


def test_the_tip_changes_by_what_two_settles_say(in_water: dict[str, Switch]) -> None:
    others = WITHOUT | {name: Scene(*IN_WATER.effects, *more) for name, more in WITH.items()}
    assert others.keys() == in_water.keys()
    for name, other in others.items():
        assert in_water[name].tip_change == pytest.approx(tip_change(IN_WATER, other), rel=1e-12)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_an_effect_matters_if_it_moves_the_tip_by_more_than_the_tolerance(factor: float) -> None:
    small = TipLoad((0.0, 0.0, -1e-6))
    moved = tip_change(PAPER, Scene(Extension(), small), 1e-9)
    assert 1e-6 < moved < 1e-3
    tolerance = factor * moved
    switch = switch_effect(ARM, BENT, PAPER, PAPER + small, small, 1e-9, 1, tolerance)
    assert switch.matters is (factor < 1)
    assert switch.tip_change == pytest.approx(moved, rel=1e-3)


def test_an_effect_matters_if_an_effect_that_requires_it_matters() -> None:
    tolerance = 0.04
    found = switch_effects(ARM, BENT, Scene.silicone(), 1e-4, 1, tolerance)
    switches = {switch.effect: switch for switch in found}
    assert switches["ExactTendons and NeoHookean"].tip_change < tolerance
    assert switches["NeoHookean"].tip_change > tolerance
    assert switches["ExactTendons and NeoHookean"].matters
    assert not switches["Shear"].matters


@pytest.mark.parametrize(
    ("nothing", "states"),
    [
        (TipLoad(), 7),
        (TipLoad(follower=True), 10),
        (PointLoad(0.2, (0.0, 0.0, 0.0)), 7),
        (Current((0.0, 0.0, 0.0)), 10),
        (Current((0.3, 0.0, 0.0), density=0.0), 10),
        (Current((0.3, 0.0, 0.0), coefficient=0.0), 10),
    ],
    ids=["tip load", "follower", "point load", "still water", "stream of nothing", "no drag"],
)
def test_an_effect_of_nothing_moves_nothing(nothing: Effect, states: int) -> None:
    switch = switch_effect(ARM, BENT, PAPER, PAPER + nothing, nothing, 1e-5, repeats=1)
    assert not switch.matters
    assert switch.tip_change < 1e-5
    assert switch.states_added == states


@pytest.mark.slow
@pytest.mark.parametrize(
    ("load", "told"),
    [
        (TipLoad((-0.1, 0.0, 0.0)), "buckles"),
        pytest.param(
            *(TipLoad((-10.0, 0.0, 0.0)), "does not bear its loads|crushed"),
            marks=pytest.mark.slow,
        ),
    ],
    ids=["buckles", "crushed"],
)
def test_a_load_that_is_too_much_is_a_row_with_its_reason(load: TipLoad, told: str) -> None:
    arm, rest = Arm.from_paper("section-5.2"), np.zeros(4)
    with pytest.raises(OctoplanError, match=told) as reason:
        settle(arm, rest, Scene(Extension(), load))
    row = switch_effect(arm, rest, PAPER, PAPER + load, load, repeats=1)
    assert (row.effect, row.enabled, row.matters) == ("TipLoad", False, True)
    assert row.problem == str(reason.value)
    assert np.isnan(row.tip_change)
    assert row.states_added == 7


def test_several_effects_switched_on_together_are_named_by_the_first() -> None:
    row = switch_effect(ARM, BENT, PAPER, IN_WATER, Weight(), 1e-4, repeats=1)
    assert row.effect == "Weight and Buoyancy"
    assert row.tip_change == pytest.approx(tip_change(PAPER, IN_WATER, 1e-4), rel=1e-12)
