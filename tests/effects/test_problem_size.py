"""What is not enabled is not there: states and unknowns of scenes, counted."""

from __future__ import annotations

import numpy as np
import pytest

from model import Arm, Scene
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
from model.mesh import graded
from planner.effect_ablation import ProblemSize, problem_size
from tests.effects.cases import EXACT, SILICONE, SWOLLEN

ARM = Arm.from_paper("table-4")
PAPER = Scene(Extension())
POSE, MOMENT = 7, 3

# From the barest to the richest, each with what the one before has: how many times as many
# instructions its function may have at most. Steps of an iteration make the third one long.
BARE: dict[str, tuple[Scene, float]] = {
    "bending alone": (Scene(), np.inf),
    "paper": (PAPER, 1.5),
    "exact": (EXACT, 25.0),
    "silicone": (SILICONE, 2.5),
    "silicone, anticlastic": (SWOLLEN, 2.0),
}
# Small, so that they call for no elements but those of the arm's taper, anchorages and points.
G, F = (0.0, 0.0, -0.05), (0.0, 0.0, -1e-6)
LOADS: dict[str, tuple[Effect, ...]] = {
    "weight": (Weight(G),),
    "weight in water": (Weight(G), Buoyancy()),
    "tip load": (TipLoad(F),),
    "follower": (TipLoad(F, follower=True),),
    "point load": (PointLoad(0.225, F),),
    "current": (Current((0.0, 0.0, -0.01)),),
    "friction": (Friction(0.1),),
    "shear": (Shear(),),
    "all": (
        Shear(),
        Weight(G),
        Buoyancy(),
        TipLoad(F, follower=True),
        PointLoad(0.225, F),
        Current((0.0, 0.0, -0.001)),
        Friction(0.1),
    ),
}
# What an effect adds to the nodes besides pose and moment, and to the strains of a cross-section.
FORCE = {"follower": 3, "current": 3, "all": 3}
ANGLES = {"friction": ARM.n_tendons, "all": ARM.n_tendons}
SHEARS = {"shear": 2, "all": 2}
POINTS = {"point load": (0.225,), "all": (0.225,)}
STRAINS = {"bending alone": 3, "paper": 4, "exact": 4, "silicone": 4}
GROUNDS = {"bending alone": Scene(), "paper": PAPER, "exact": EXACT, "silicone": SILICONE}
STAGES = 3


def over(ground: Scene, *loads: Effect) -> Scene:
    return Scene(*ground.effects, *loads)


def check_total(found: ProblemSize, node: int, stage: int, elements: int) -> None:
    """Hold unknowns and constraints to those of nodes, and of stages of the elements between."""
    assert found.unknowns == elements * (node + STAGES * stage) + node
    assert found.constraints == found.unknowns


def test_bare_scenes_are_functions_that_only_grow_by_what_they_enable() -> None:
    before = 0
    for scene, most in BARE.values():
        found = problem_size(ARM, scene)
        assert (found.states, found.unknowns, found.constraints) == (POSE, 0, 0)
        assert before < found.instructions
        assert found.instructions <= most * max(before, 1)
        before = found.instructions


@pytest.mark.parametrize("name", LOADS)
@pytest.mark.parametrize("ground", GROUNDS)
def test_a_load_adds_the_states_that_it_says_and_as_many_constraints_as_unknowns(
    ground: str, name: str
) -> None:
    found = problem_size(ARM, over(GROUNDS[ground], *LOADS[name]))
    node = POSE + MOMENT + FORCE.get(name, 0) + ANGLES.get(name, 0)
    strains = STRAINS[ground] + SHEARS.get(name, 0)
    assert found.states == node + strains
    # With friction the strains' rates are unknown too.
    stage = strains * (2 if name in ANGLES else 1)
    check_total(found, node, stage, graded(ARM, 1, POINTS.get(name, ())).steps)


def test_heavier_loads_call_for_more_elements_and_no_more_states() -> None:
    counts = [
        problem_size(ARM, over(PAPER, TipLoad((0.0, 0.0, -F)))) for F in (1e-6, 1e-2, 0.1, 1.0)
    ]
    assert {found.states for found in counts} == {POSE + MOMENT + 4}
    assert all(found.unknowns == found.constraints for found in counts)
    unknowns = [found.unknowns for found in counts]
    assert unknowns == sorted(unknowns)
    assert unknowns[-1] > unknowns[0]
