"""How plans are stated and by what they are solved, and what their outcomes own up to."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from model import Arm, InputError, Scene, settle
from model.effects import Extension, Weight
from model.obstacles import Box
from planner import plan
from planner.certificate import Certificate
from planner.outcome import Facts, sentence
from planner.targets import TipPosition

ARM, PAPER = Arm.from_paper("table-4"), Scene(Extension())
TARGET = TipPosition((0.28, 0.12, -0.12))


@pytest.mark.parametrize("solver", ["auto", "ipopt"])
def test_a_plan_tells_what_solved_it_in_how_many_iterations(solver: Any) -> None:
    found = plan(ARM, TARGET, PAPER, 20.0, solver=solver)
    assert found.reached
    assert found.statement.solver == "ipopt"
    assert found.statement.iterations > 0


@pytest.mark.parametrize(("solver", "why"), [("snopt", ""), ("fatrop", ".*loses one in seven")])
def test_other_solvers_are_refused_with_the_ones_there_are(solver: Any, why: str) -> None:
    with pytest.raises(InputError, match=f"auto, ipopt{why}") as caught:
        plan(ARM, TARGET, PAPER, 20.0, solver=solver)
    assert caught.value.field == "solver"


def test_the_form_is_deprecated_and_changes_nothing() -> None:
    with pytest.warns(DeprecationWarning, match="form has no effect"):
        found = plan(ARM, TARGET, PAPER, 20.0, form="condensed")
    assert np.array_equal(found.tensions, plan(ARM, TARGET, PAPER, 20.0).tensions)
    with pytest.raises(InputError, match="form"):
        plan(ARM, TARGET, PAPER, 20.0, form="direct")


def test_an_obstacle_that_alone_is_in_the_way_is_named_with_place_and_clearance() -> None:
    """Used to be told as out of reach, or as limits to raise."""
    free = plan(ARM, TARGET, PAPER, 20.0)
    plate = Box((0.2, 0.0, 0.0), (0.02, 3.0, 3.0))
    found = plan(ARM, TARGET, PAPER, 20.0, obstacles=[plate], starts=2)
    assert free.reached and not found.reached
    assert "obstacles are in the way: without them it is met" in found.outcome
    assert "obstacles[0] by" in found.outcome and "mm (s = " in found.outcome
    assert "out of reach" not in found.outcome and "raise these limits" not in found.outcome


def test_the_bare_arm_is_named_where_no_scene_is_given() -> None:
    """Used to be planned for without a word, at half of the effort that silicone takes."""
    assert "Statics: bending alone" in plan(ARM, TARGET, tension_max=20.0).outcome
    assert "Statics" not in plan(ARM, TARGET, PAPER, 20.0).outcome


def test_under_loads_a_margin_of_stability_is_had_by_default_or_its_lack_is_told() -> None:
    scene = Scene.silicone(Weight())
    T = np.array([0.0, 0.02, 0.01, 0.0, 0.3, 0.1, 0.0, 0.0, 0.5, 0.0, 0.0, 0.2])
    found = plan(ARM, TipPosition(tuple(settle(ARM, T, scene).tip)), scene, 20.0)
    assert found.reached
    assert found.certificate.stability >= 0.1 - 1e-4 or "stands on the brink" in found.outcome


@pytest.mark.parametrize("norm", ["2", "1", "inf"])
def test_a_target_far_beyond_the_arm_is_answered_with_the_nearest_shape(norm: Any) -> None:
    """Used to take up to 44 s."""
    found = plan(ARM, TipPosition((3.0, 0.5, 0.0)), PAPER, 2.0, norm=norm)
    assert not found.reached
    gap, away = np.linalg.norm(found.tip - np.array([3.0, 0.5, 0.0])), np.hypot(3.0, 0.5)
    assert away - ARM.length - 1e-6 <= gap <= away - 0.95 * ARM.length


@pytest.mark.parametrize(
    ("facts", "advice"),
    [
        ({}, "no limit is active: the target is out of reach of these tendons, move it"),
        ({"in contact": True}, "no limit is active, more starts may find a nearer one"),
        ({"holders": ("T_11 at its maximum",)}, "held by T_11 at its maximum; raise these limits"),
        ({"stopped": True}, "a longer time limit may bring it nearer"),
        ({"in_the_way": "it passes through a ball"}, "without them it is met, and it passes"),
    ],
    ids=["out of reach", "in contact", "limits", "time", "obstacles"],
)
def test_what_is_not_reached_is_said_to_be_held_by_what_holds_it(
    facts: dict[str, Any], advice: str
) -> None:
    """Only an optimum of how near the target comes tells that it is out of reach."""
    told = {key: value for key, value in facts.items() if key != "in contact"}
    complementarity = 0.0 if facts.get("in contact") else None
    missed = Certificate({"tip position": 0.01}, {}, {}, 0.0, complementarity=complementarity)
    holders = told.pop("holders", ())
    assert advice in sentence(Facts(missed, "nearest", 1.0, 3, 2, holders, 0.45, **told))
