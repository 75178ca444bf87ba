"""Structures are built once: other numbers build nothing, and loads leave bare scenes alone."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from model import Arm
from model.effects import Buoyancy, Current, Effect, Friction, PointLoad, Shear, TipLoad, Weight
from model.forward import explicit_map
from planner.problem_size import problem_size
from tests.effects.test_problem_size import ARM, GROUNDS, LOADS, PAPER, over, stated

# The same kinds of loads with other numbers, as small.
OTHERS: dict[str, tuple[Effect, ...]] = {
    "weight": (Weight((0.01, 0.02, 0.0)),),
    "weight in water": (Weight((0.01, 0.02, 0.0)), Buoyancy(900.0)),
    "tip load": (TipLoad((1e-6, 0.0, 0.0), (1e-8, 0.0, 2e-8)),),
    "follower": (TipLoad((0.0, 0.0, 0.0), (1e-8, 0.0, 0.0), follower=True),),
    "point load": (PointLoad(0.226, (1e-6, 1e-6, 0.0)),),
    "current": (Current((0.001, 0.002, 0.0), 900.0, 0.5),),
    "friction": (Friction(0.3, (1, -1) * 6),),
    "shear": (Shear(0.5),),
    "all": (
        Shear(0.5),
        Weight((0.01, 0.02, 0.0)),
        Buoyancy(900.0),
        TipLoad((0.0, 0.0, 1e-6), follower=True),
        PointLoad(0.226, (1e-6, 1e-6, 0.0)),
        Current((0.001, 0.0005, 0.0), 900.0, 0.5),
        Friction(0.3, -1),
    ),
}


@pytest.mark.parametrize("name", LOADS)
@pytest.mark.parametrize("ground", GROUNDS)
def test_other_numbers_add_nothing_and_build_nothing(ground: str, name: str) -> None:
    one, other = (over(GROUNDS[ground], *loads[name]) for loads in (LOADS, OTHERS))
    assert problem_size(ARM, one) == problem_size(ARM, other)
    assert stated(one).of is stated(other).of
    assert not np.array_equal(stated(one).p, stated(other).p)


def test_dead_loads_of_all_kinds_are_one_structure() -> None:
    kinds = [LOADS[name] for name in ("weight", "weight in water", "tip load")]
    assert len({id(stated(over(PAPER, *loads)).of) for loads in kinds}) == 1
    assert len({problem_size(ARM, over(PAPER, *loads)) for loads in kinds}) == 1


def parts(*functions: ca.Function) -> dict[int, str]:
    """The functions and all that they call, by identity."""
    inside = [part for f in functions for part in (f, *f.find_functions())]
    return {part.__hash__(): part.name() for part in inside}


@pytest.mark.parametrize("ground", ["paper", "silicone"])
def test_no_loaded_scene_shares_functions_with_a_bare_one(ground: str) -> None:
    bare = GROUNDS[ground]
    before, counted = explicit_map(ARM, bare, "magnus6", 1), problem_size(ARM, bare)
    own = parts(before.function)
    for name, loads in LOADS.items():
        calls = parts(stated(over(bare, *loads)).of.equations.value)
        assert {"element", "tip"} <= set(calls.values())
        assert not own.keys() & calls.keys(), name
    after = explicit_map(ARM, bare, "magnus6", 1)
    assert after is before
    assert parts(after.function) == own
    assert problem_size(ARM, bare) == counted


def test_a_bare_function_built_after_loaded_ones_is_the_same_to_the_instruction() -> None:
    arm = Arm.from_paper("table-2")
    alone = problem_size(arm, PAPER)
    for loads in (LOADS["tip load"], LOADS["current"]):
        problem_size(arm, over(PAPER, *loads))
    explicit_map.cache_clear()
    assert problem_size(arm, PAPER) == alone
