"""What is not called for is not there: states, unknowns and instructions of scenes, counted."""

from __future__ import annotations

from typing import Any

import casadi as ca
import pytest

from model import Arm, Scene
from model.arm import conical
from model.effects import (
    Buoyancy,
    Current,
    Effect,
    Extension,
    Friction,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from model.forward import explicit_map, loaded_map
from model.sizes import sizes
from tests.effects.cases import EXACT, SILICONE, SWOLLEN

ARM = Arm.from_paper("table-4")
PAPER = Scene(Extension())
POSE = 7

# Instructions change only with the statics themselves: no effect that is added may touch them.
BARE: dict[str, tuple[Scene, int]] = {
    "bending alone": (Scene(), 3071),
    "paper": (PAPER, 3981),
    "exact": (EXACT, 76359),
    "silicone": (SILICONE, 159269),
    "silicone, anticlastic": (SWOLLEN, 240734),
}
# Small, so that they call for no segments but those of anchorages and points.
LOADS: dict[str, tuple[Effect, ...]] = {
    "weight": (Weight((0.0, 0.0, -0.5)),),
    "weight in water": (Weight(), Buoyancy()),
    "tip load": (TipLoad((0.0, 0.0, -1e-4)),),
    "follower": (TipLoad((0.0, 1e-4, 0.0), follower=True),),
    "point load": (PointLoad(0.225, (0.0, 0.0, -1e-4)),),
    "current": (Current((0.0, 0.0, -0.01)),),
    "friction": (Friction(0.1),),
    "shear": (Shear(),),
    "all": (
        Shear(),
        Weight((0.0, 0.0, -0.5)),
        Buoyancy(),
        TipLoad((0.0, 0.0, -1e-4), follower=True),
        PointLoad(0.225, (0.0, 0.0, -1e-4)),
        Current((0.0, 0.0, -0.01)),
        Friction(0.1),
    ),
}
# What the docstrings of the effects say that they add, besides curvatures and stretch.
FORCE = {"follower": 3, "current": 3, "all": 3}
TENSIONS = {"friction": ARM.n_tendons, "all": ARM.n_tendons}
SHEARS = {"shear": 2, "all": 2}
SEGMENTS = {"point load": 4, "all": 4}
STRAINS = {"paper": 3, "silicone": 4}
GROUNDS = {"paper": PAPER, "silicone": SILICONE}
SLOW = [("silicone", "all"), ("silicone", "friction")]


def over(ground: Scene, *loads: Effect) -> Scene:
    return Scene(*ground.effects, *loads)


def loaded_cases() -> list[Any]:
    pairs = [(ground, load) for ground in GROUNDS for load in LOADS]
    return [pytest.param(g, name, id=f"{name}, {g}") for g, name in pairs if (g, name) not in SLOW]


@pytest.mark.parametrize(("scene", "instructions"), BARE.values(), ids=BARE)
def test_a_bare_scene_is_a_function_of_so_many_instructions_and_nothing_else(
    scene: Scene, instructions: int
) -> None:
    found = sizes(ARM, scene)
    assert (found.states, found.unknowns, found.constraints) == (POSE, 0, 0)
    assert found.instructions == instructions


def test_as_printed_carries_three_strains_and_is_a_function_too() -> None:
    found = sizes(ARM, Scene.as_printed())
    assert (found.states, found.unknowns, found.constraints) == (POSE + 3, 0, 0)
    assert found.instructions == 11407


def check_counts(ground: str, name: str) -> None:
    """Hold a loaded scene to what the docstrings of its effects say."""
    found = sizes(ARM, over(GROUNDS[ground], *LOADS[name]))
    shears = SHEARS.get(name, 0) if ground == "silicone" else 0
    states = POSE + STRAINS[ground] + shears + FORCE.get(name, 0) + TENSIONS.get(name, 0)
    assert found.states == states
    assert found.unknowns == SEGMENTS.get(name, 3) * states
    assert found.constraints == found.unknowns


@pytest.mark.parametrize(("ground", "name"), loaded_cases())
def test_a_load_adds_the_states_that_it_says_and_as_many_constraints_as_unknowns(
    ground: str, name: str
) -> None:
    check_counts(ground, name)


@pytest.mark.slow
@pytest.mark.parametrize(("ground", "name"), SLOW, ids=[f"{name}, {g}" for g, name in SLOW])
def test_loads_that_take_long_to_build_add_what_they_say(ground: str, name: str) -> None:
    check_counts(ground, name)


@pytest.mark.parametrize(
    ("loads", "richer"),
    [
        ("weight", (Buoyancy(),)),
        ("tip load", (Weight((0.0, 0.0, -0.5)),)),
        ("current", (TipLoad((0.0, 1e-4, 0.0), follower=True),)),
        ("follower", (Shear(),)),
    ],
    ids=["buoyancy on weight", "weight on a tip load", "follower on a current", "shear, reference"],
)
def test_what_others_have_added_is_not_added_again(loads: str, richer: tuple[Effect, ...]) -> None:
    alone = sizes(ARM, over(PAPER, *LOADS[loads]))
    together = sizes(ARM, over(PAPER, *LOADS[loads], *richer))
    assert together.states == alone.states
    assert (together.unknowns, together.constraints) == (alone.unknowns, alone.constraints)


def test_buoyancy_is_a_number_and_no_instruction() -> None:
    heavy = sizes(ARM, over(PAPER, Weight((0.0, 0.0, -0.5))))
    assert sizes(ARM, over(PAPER, Weight((0.0, 0.0, -0.5)), Buoyancy())) == heavy


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_each_anchorage_is_a_segment(n: int) -> None:
    ends = [(0.3 * (1 - i / 4), 2e-3, 1e-3) for i in range(n)]
    arm = conical(0.3, (12e-3, 8e-3), ends)
    found = sizes(arm, over(PAPER, TipLoad((0.0, 0.0, -1e-4))))
    assert found.unknowns == found.constraints == n * found.states


def test_an_anchorage_short_of_the_tip_leaves_a_segment_without_tendons() -> None:
    arm = conical(0.3, (12e-3, 8e-3), [(0.25, 2e-3, 1e-3)])
    found = sizes(arm, over(PAPER, TipLoad((0.0, 0.0, -1e-4))))
    assert found.unknowns == found.constraints == 2 * found.states


@pytest.mark.parametrize(
    ("places", "segments"),
    [((0.2,), 4), ((0.2, 0.3), 5), ((0.0,), 3), ((0.45,), 3), ((0.315,), 3), ((0.135, 0.2), 4)],
    ids=[
        "one",
        "two",
        "at the base",
        "at the tip",
        "at an anchorage",
        "one of two at an anchorage",
    ],
)
def test_each_point_load_between_anchorages_is_a_segment(
    places: tuple[float, ...], segments: int
) -> None:
    found = sizes(ARM, over(PAPER, *(PointLoad(s, (0.0, 1e-4, 0.0)) for s in places)))
    assert found.unknowns == found.constraints == segments * found.states


def test_heavier_loads_call_for_more_segments_and_no_more_states() -> None:
    counts = [sizes(ARM, over(PAPER, TipLoad((0.0, 0.0, -F)))) for F in (1e-4, 1e-2, 0.1, 1.0)]
    assert {found.states for found in counts} == {POSE + 3}
    assert all(found.unknowns == found.constraints for found in counts)
    unknowns = [found.unknowns for found in counts]
    assert unknowns == sorted(unknowns)
    assert unknowns[-1] > unknowns[0]


def parts(*functions: ca.Function) -> dict[int, str]:
    """The functions and all that they call, by identity."""
    inside = [part for f in functions for part in (f, *f.find_functions())]
    return {part.__hash__(): part.name() for part in inside}


@pytest.mark.parametrize("ground", GROUNDS)
def test_no_loaded_scene_shares_functions_with_a_bare_one(ground: str) -> None:
    bare = GROUNDS[ground]
    before, counted = explicit_map(ARM, bare, "magnus6", 1), sizes(ARM, bare)
    own = parts(before.function)
    for name, loads in LOADS.items():
        if (ground, name) in SLOW:
            continue
        system = loaded_map(ARM, over(bare, *loads), "rk6", 1).system
        maps = [f for segment in system.segments for f in (segment.entry, segment.map)]
        calls = parts(*maps)
        assert {"tip", "jump", "step"} <= set(calls.values())
        assert not own.keys() & calls.keys(), name
    after = explicit_map(ARM, bare, "magnus6", 1)
    assert after is before
    assert parts(after.function) == own
    assert sizes(ARM, bare) == counted


def test_a_bare_function_built_after_loaded_ones_is_the_same_to_the_instruction() -> None:
    arm = Arm.from_paper("table-2")
    alone = sizes(arm, PAPER)
    for loads in (LOADS["tip load"], LOADS["current"]):
        sizes(arm, over(PAPER, *loads))
    explicit_map.cache_clear()
    assert sizes(arm, PAPER) == alone
