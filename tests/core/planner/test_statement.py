"""Statement and solver of plans, and the limitations that outcomes report."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, Material, Scene
from octoplan.model.arm import conical
from octoplan.model.effects import Extension, Weight
from octoplan.model.extensions.obstacles import Box
from octoplan.model.support.machine.functions import BufferedFunction
from octoplan.planner import plan, trajectory
from octoplan.planner.blocks import CRUSHED
from octoplan.planner.certificate import COMPLEMENTARITY, Certificate, Check
from octoplan.planner.extensions.avoidance.rows import ClearanceConstraints
from octoplan.planner.limits import Limits
from octoplan.planner.outcome import verdict
from octoplan.planner.program import Program
from octoplan.planner.solve import ipopt
from octoplan.planner.targets import BendingPlane, TipPosition

ARM, PAPER = Arm.from_paper("table-4"), Scene(Extension())
TARGET = TipPosition((0.28, 0.12, -0.12))


# Only `shape.remarks` reported this: the equations ignore the thickness of the body.
def test_an_arm_that_bends_sharper_than_its_own_radius_is_told() -> None:
    thick = conical(0.05, (0.02, 0.02), [(0.05, 0.01, 0.01)], material=Material(1e5))
    bent, straighter = (plan(thick, BendingPlane(0.0, bend), Scene(), 1e3) for bend in (3.0, 2.0))
    assert bent.reached
    assert "Beware: the arm bends sharper than its own radius: by a radius of 16" in bent.outcome
    assert "sharper" not in straighter.outcome
    goals = [BendingPlane(0.0, bend) for bend in (1.0, 3.0)]
    motion = trajectory(thick, goals, Scene(), 1e3, rate_max=50.0)
    assert all(motion.reached)
    assert "Beware: at target 1 the arm bends sharper than its own radius" in motion.outcome
    assert "at target 0" not in motion.outcome


@pytest.mark.slow
def test_an_obstacle_that_alone_is_in_the_way_is_named_with_place_and_clearance() -> None:
    """The outcome was "out of reach", or an advice to raise limits."""
    free = plan(ARM, TARGET, PAPER, 20.0)
    plate = Box((0.2, 0.0, 0.0), (0.02, 3.0, 3.0))
    found = plan(ARM, TARGET, PAPER, 20.0, obstacles=[plate], starts=1)
    assert free.reached and not found.reached
    assert "the plan without obstacles reaches the target, but" in found.outcome
    assert "obstacles[0] by" in found.outcome and "mm (s = " in found.outcome
    assert "out of reach" not in found.outcome and "widen these limits" not in found.outcome


def test_the_bare_arm_is_named_where_no_scene_is_given() -> None:
    """Used to be planned for without a word, at half of the effort that silicone takes."""
    assert "Statics: bending alone" in plan(ARM, TARGET, tension_max=20.0).outcome
    assert "Statics" not in plan(ARM, TARGET, PAPER, 20.0).outcome


TIP_IN_AIR = TipPosition((0.20, 0.15, -0.20))


@pytest.mark.slow
def test_a_tip_in_air_that_unstable_arms_meet_for_less_is_met_by_a_stable_one() -> None:
    """The target was reported as out of reach: the optimum without the margin is not stable."""
    found = plan(ARM, TIP_IN_AIR, Scene.silicone(Weight()), 20.0)
    assert found.certificate.passed
    assert found.certificate.stability >= 0.1 - 1e-4
    assert found.certificate.load_factor == np.inf
    assert found.effort < 3.79
    assert "brink" not in found.outcome


@pytest.mark.slow
def test_where_the_margin_cannot_be_had_a_plan_says_that_it_stands_on_the_brink() -> None:
    found = plan(ARM, TIP_IN_AIR, Scene.silicone(Weight()), 20.0, limits=Limits(total_pull=8.4))
    assert found.certificate.passed
    assert 0.0 < found.certificate.stability < 0.1
    assert "stands on the brink: it yields at 1.00 times its loads" in found.outcome


@pytest.mark.quick("2")
@pytest.mark.parametrize("norm", ["2", "1", "inf"])
def test_a_target_far_beyond_the_arm_is_answered_with_the_nearest_shape(norm: Any) -> None:
    """Used to take up to 44 s."""
    found = plan(ARM, TipPosition((3.0, 0.5, 0.0)), PAPER, 2.0, norm=norm)
    assert not found.reached
    gap, away = np.linalg.norm(found.tip - np.array([3.0, 0.5, 0.0])), np.hypot(3.0, 0.5)
    assert away - ARM.length - 1e-6 <= gap <= away - 0.95 * ARM.length


@pytest.mark.slow
@pytest.mark.parametrize("place", [(0.6, 0.1, 0.2), (0.0, 1.0, -0.5)])
def test_guesses_agree_on_the_nearest_shape_under_loads(place: tuple[float, float, float]) -> None:
    """Least squares of the misses outweighed equilibrium: one of 14 guesses converged."""
    found = plan(ARM, TipPosition(place), Scene.silicone(Weight()), 20.0)
    assert found.outcome.startswith("Not reached: the nearest shape found misses the tip position")
    assert len(found.solution.starts) == found.solution.n_equal_optima == 3


MISSED = Certificate({"tip position": 0.01}, {}, {}, 0.0)
# Facts about a plan that is not reached, and the outcome.
SENTENCES: dict[str, tuple[dict[str, Any], str]] = {
    "no limit": ({}, "no limit is active; move the target (3 initial guesses"),
    "samples": ({"sampled": 512}, "3 initial guesses and 512 sampled shapes tried, 2 led to"),
    "in contact": (
        {"certificate": replace(MISSED, checks={COMPLEMENTARITY: Check(0.0, 1e-8)})},
        "no limit is active; move the target (3 initial guesses",
    ),
    "limits": (
        {"holding": lambda: ["T_11 at its maximum"]},
        "held by T_11 at its maximum; widen these limits (",
    ),
    "crushed": ({"holding": lambda: [CRUSHED]}, "at its least); move the target ("),
    "time": ({"stopped": True}, "the search was not finished; raise time_limit"),
    "time, exact": ({"stopped": True, "mode": "exact"}, "not finished; raise time_limit"),
    "obstacles": (
        {"in_the_way": "it passes through a ball"},
        "reaches the target, but it passes through a ball; move the obstacle",
    ),
    "unstable": (
        {"unstable": True},
        "every shape found that meets the target is unstable under the loads; lower the loads",
    ),
    "nearest": ({}, "the nearest shape found misses the tip position by"),
    "an inequality": (
        {"certificate": replace(MISSED, inequality={"least bend": -0.1})},
        "the least bend by 0.1",
    ),
    "degrees": (
        {
            "n_equal_optima": 1,
            "certificate": Certificate({"bend": 0.1}, {}, {}, 0.0, units={"bend": "rad"}),
        },
        "the nearest shape found misses the bend by 5.73 deg",
    ),
    "millimetres": (
        {"certificate": replace(MISSED, units={"tip position": "L"})},
        "the nearest shape found misses the tip position by 4.5 mm",
    ),
    "stopped": ({"stopped": True}, "the nearest shape found misses the tip position by"),
    "no stable one": ({"unstable": True}, "the nearest shape found misses the tip position by"),
    "around obstacles": (
        {"avoidance": ClearanceConstraints(())},
        "the nearest shape found misses the tip position by",
    ),
}


@pytest.mark.parametrize(("facts", "told"), SENTENCES.values(), ids=SENTENCES)
def test_what_is_not_reached_is_said_to_be_held_by_what_holds_it(
    facts: dict[str, Any], told: str
) -> None:
    solution = {"starts": (0, 0, 0), "n_equal_optima": 2, "sampled": 0, "stopped": False}
    solution |= {"in_the_way": "", "unstable": False, "avoidance": None}
    plan = {"certificate": MISSED, "mode": "nearest", "effort": 1.0, "holding": list}
    plan |= {"targets": ()}
    plan |= {name: fact for name, fact in facts.items() if name in plan}
    solution |= {name: fact for name, fact in facts.items() if name not in plan}
    problem = SimpleNamespace(arm=ARM)
    assert told in verdict(
        SimpleNamespace(problem=problem, solution=SimpleNamespace(**solution), **plan)
    )


class Rounding:
    """A solver that ends at an optimum by steps as small as rounding."""

    def __init__(self, run: BufferedFunction) -> None:
        self.run = run

    def __call__(self, *inputs: Any) -> Any:
        return self.run(*inputs)

    def stats(self) -> dict[str, object]:
        return self.run.stats() | {"return_status": "Search_Direction_Becomes_Too_Small"}


def test_an_optimum_that_is_polished_to_rounding_is_no_reason_to_search_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The step counted as lost, and plans were not certified if the search ended by such steps."""
    made, purposes = ipopt.solver, list[str]()

    def solver(of: Program, purpose: ipopt.Purpose, *others: Any) -> Any:
        purposes.append(purpose)
        run = made(of, purpose, *others)
        return Rounding(run) if purpose == "polish" else run

    monkeypatch.setattr(ipopt, "solver", solver)
    assert plan(ARM, TARGET, PAPER, 20.0, starts=1).reached
    assert purposes.count("search") == 1
    assert "polish" in purposes
