"""How plans are stated and by what they are solved, and what their outcomes own up to."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from model import Arm, InputError, Scene, settle
from model.effects import Buoyancy, Extension, Weight
from model.obstacles import Box
from model.paths import Array
from planner import plan
from planner.certificate import Certificate
from planner.outcome import Facts, sentence
from planner.program.limits import Limits
from planner.program.problem import Problem
from planner.program.statement import Statement
from planner.solve.fatrop import stages
from planner.targets import BendingPlane, TipPosition

ARM, PAPER = Arm.from_paper("table-4"), Scene(Extension())
TARGET = TipPosition((0.28, 0.12, -0.12))


@pytest.mark.parametrize("solver", ["auto", "ipopt"])
def test_a_plan_tells_what_solved_it_in_how_many_iterations(solver: Any) -> None:
    found = plan(ARM, TARGET, PAPER, 20.0, solver=solver)
    assert found.reached
    assert found.statement.solver == "ipopt"
    assert found.statement.iterations > 0


@pytest.mark.parametrize("scene", [PAPER, Scene.silicone(Weight(), Buoyancy())])
def test_fatrop_comes_to_the_optimum_of_ipopt(scene: Scene) -> None:
    first, second = (plan(ARM, TARGET, scene, 20.0, solver=own) for own in ("ipopt", "fatrop"))
    assert second.reached
    assert (first.statement.solver, second.statement.solver) == ("ipopt", "fatrop")
    assert second.effort == pytest.approx(first.effort, rel=1e-6)
    assert np.allclose(second.tensions, first.tensions, atol=1e-4)


def test_what_reaches_over_stages_is_left_to_ipopt() -> None:
    turned = BendingPlane(angle=np.radians(135), bend=np.radians(60), section=1)
    found = plan(ARM, turned, PAPER, 20.0, solver="fatrop")
    assert found.reached
    assert found.statement.solver == "ipopt"


def flat(values: Any) -> Array:
    return np.array(values).ravel()


def test_derivatives_of_the_program_in_stages_are_those_of_differences() -> None:
    limits, statement = Limits.of(ARM, 20.0), Statement(refinement=1)
    problem = Problem(ARM, PAPER, (TARGET,), limits, statement)
    p, x = problem.parameters(), problem.guess(np.linspace(0.1, 0.5, 12))
    of, rng = stages(problem.program), np.random.default_rng(0)
    solver = of.solver.function
    first, second = (solver.get_function(f"nlp_{own}") for own in ("jac_g", "hess_l"))
    # Copies of an unknown change together, and what they add up to counts.
    z, way = x[of.unknown], rng.normal(size=x.size)[of.unknown]
    lam, h = rng.normal(size=of.order.size), 1e-6
    ends = [z + h * way, z - h * way]
    g = [flat(first(own, p)[0]) for own in ends]

    def together(values: Any) -> Array:
        return np.bincount(of.unknown, flat(values))

    slopes = [together(second(own, p, 0.7, lam)[0]) for own in ends]
    bends = together(np.array(second(z, p, 0.7, lam)[1]) @ way)
    changes = (np.array(first(z, p)[1]) @ way, bends)
    for change, (after, before) in zip(changes, (g, slopes), strict=True):
        assert np.allclose(change, (after - before) / 2 / h, atol=1e-6 * np.abs(change).max())
    known = problem.constraints(x, p)
    assert np.allclose(flat(first(z, p)[0])[np.argsort(of.order)][: known.size], known)


def test_the_form_is_deprecated_and_changes_nothing() -> None:
    with pytest.warns(DeprecationWarning, match="form has no effect") as told:
        found = plan(ARM, TARGET, PAPER, 20.0, form="condensed")
    assert told[0].filename == __file__, "at the caller's line"
    assert np.array_equal(found.tensions, plan(ARM, TARGET, PAPER, 20.0).tensions)
    with pytest.raises(InputError, match="form"):
        plan(ARM, TARGET, PAPER, 20.0, form="direct")


def test_an_obstacle_that_alone_is_in_the_way_is_named_with_place_and_clearance() -> None:
    """Used to be told as out of reach, or as limits to raise."""
    free = plan(ARM, TARGET, PAPER, 20.0)
    plate = Box((0.2, 0.0, 0.0), (0.02, 3.0, 3.0))
    found = plan(ARM, TARGET, PAPER, 20.0, obstacles=[plate], starts=1)
    assert free.reached and not found.reached
    assert "obstacles are in the way: without them it is met" in found.outcome
    assert "obstacles[0] by" in found.outcome and "mm (s = " in found.outcome
    assert "out of reach" not in found.outcome and "raise these limits" not in found.outcome


def test_the_bare_arm_is_named_where_no_scene_is_given() -> None:
    """Used to be planned for without a word, at half of the effort that silicone takes."""
    assert "Statics: bending alone" in plan(ARM, TARGET, tension_max=20.0).outcome
    assert "Statics" not in plan(ARM, TARGET, PAPER, 20.0).outcome


TIP_IN_AIR = TipPosition((0.20, 0.15, -0.20))


def test_under_loads_a_margin_of_stability_is_had_by_default_or_its_lack_is_told() -> None:
    scene = Scene.silicone(Weight())
    T = np.array([0.0, 0.02, 0.01, 0.0, 0.3, 0.1, 0.0, 0.0, 0.5, 0.0, 0.0, 0.2])
    found = plan(ARM, TipPosition(tuple(settle(ARM, T, scene).tip)), scene, 20.0)
    assert found.reached
    assert found.certificate.stability >= 0.1 - 1e-4 or "stands on the brink" in found.outcome


def test_a_tip_in_air_that_unstable_arms_meet_for_less_is_met_by_a_stable_one() -> None:
    """Used to be said to be out of reach, as the optimum without the margin is not stable."""
    found = plan(ARM, TIP_IN_AIR, Scene.silicone(Weight()), 20.0)
    assert found.certificate.passed
    assert found.certificate.stability >= 0.1 - 1e-4
    assert found.certificate.load_factor == np.inf
    assert found.effort < 3.79
    assert "brink" not in found.outcome


@pytest.mark.slow
def test_where_the_margin_cannot_be_had_a_plan_says_that_it_stands_on_the_brink() -> None:
    found = plan(ARM, TIP_IN_AIR, Scene.silicone(Weight()), 20.0, total_pull=8.4)
    assert found.certificate.passed
    assert 0.0 < found.certificate.stability < 0.1
    assert "stands on the brink: it yields at 1.00 times its loads" in found.outcome


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
        ({}, "no initial guess leads nearer: the target is likely out of reach of these tendons"),
        ({"in contact": True}, "no limit is active, more starts may find a nearer one"),
        ({"holders": ("T_11 at its maximum",)}, "held by T_11 at its maximum; raise these limits"),
        ({"stopped": True}, "a longer time limit may bring it nearer"),
        ({"in_the_way": "it passes through a ball"}, "without them it is met, and it passes"),
        ({"unstable": True}, "what meets it is unstable under the loads; stiffen the arm"),
    ],
    ids=["out of reach", "in contact", "limits", "time", "obstacles", "unstable"],
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


def test_what_an_inequality_lacks_and_whether_the_shape_is_the_nearest_are_told() -> None:
    missed = Certificate({"tip position": 0.01}, {}, {"least bend": -0.1}, 0.0)
    told = sentence(Facts(missed, "nearest", 1.0, 3, 2, (), 0.45))
    assert "the nearest attainable shape is off in" in told
    assert "least bend (short by 0.1)" in told


def test_the_best_of_one_guess_is_not_called_the_nearest_attainable_and_angles_are_in_degrees() -> (
    None
):
    missed = Certificate({"bend": 0.1}, {}, {}, 0.0, units={"bend": "rad"})
    told = sentence(Facts(missed, "nearest", 1.0, 3, 1, (), 0.45))
    assert "the nearest shape found is off in bend by 5.73 deg" in told
    assert "more starts may find a nearer one" in told


@pytest.mark.parametrize("why", ["stopped", "unstable"])
def test_what_a_search_did_not_end_with_is_not_called_the_nearest_attainable(why: str) -> None:
    missed = Certificate({"tip position": 0.01}, {}, {}, 0.0)
    facts = Facts(missed, "nearest", 1.0, 3, 2, (), 0.45)
    assert "the nearest attainable shape is off in" in sentence(facts)
    assert "the nearest shape found is off in" in sentence(replace(facts, **{why: True}))
