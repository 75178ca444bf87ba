"""Plans under loads have the stability that is requested, and report it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, TipLoad, Weight
from octoplan.planner import Plan, load_plan, plan
from octoplan.planner.limits import TendonLimits
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from octoplan.planner.program_instance import ProgramInstance
from octoplan.planner.targets import TipPosition
from tests.differences import check_derivatives, whole

ARM = Arm.from_paper("table-4")
AIR = Scene(Extension(), Weight())
T = np.array([0.0, 0.02, 0.01, 0.0, 0.3, 0.1, 0.0, 0.0, 0.5, 0.0, 0.0, 0.2])


def hanging(margin: float) -> Plan:
    """A plan for a tip in air, which an arm without a margin reaches leaning on little."""
    return plan(ARM, TARGET, AIR, 20.0, stability_margin=margin)


TARGET = TipPosition(tuple(settle(ARM, T, AIR).tip.tolist()))


def test_derivatives_of_a_stability_are_differences_of_it() -> None:
    options = NlpOptions(refinement=1, modes=1)
    problem = ProgramInstance(
        PlanningProblem(ARM, (TARGET,), AIR, TendonLimits.of(ARM, 20.0), options, 1e-6)
    )
    check_derivatives(whole(problem, problem.parameters()), problem.guess(T + 0.05), 1e-4)


@pytest.mark.slow
def test_a_margin_is_held_and_costs_effort() -> None:
    free = hanging(0.0)
    stability = free.certificate.stability
    held = hanging(stability + 0.1)
    assert free.reached
    assert held.reached
    assert held.certificate.stability == pytest.approx(stability + 0.1, abs=1e-4)
    assert held.effort > free.effort
    assert "stability, at its margin" in "; ".join(held.holding())
    assert held.shape.stability >= stability + 0.1 - 1e-3


@pytest.mark.slow
def test_a_margin_that_only_the_coarse_mesh_has_is_restored() -> None:
    """The optimum has the stability 0.1 on the coarse mesh, and 0.084 on the fine one."""
    arm = replace(ARM, base_frame=((0, -1, 0), (0, 0, 1), (-1, 0, 0)))
    rng = np.random.default_rng(5030)
    direction = rng.normal(size=3)
    force = direction * rng.uniform(0, 0.03) / np.linalg.norm(direction)
    scene = Scene(ExactTendons(), Extension(), Weight(), TipLoad(tuple(force.tolist())))
    tensions = rng.uniform(0, 3, 12) * (rng.random(12) < rng.uniform(0.2, 0.9))
    tip = settle(arm, tensions, scene).tip
    found = plan(arm, TipPosition(tuple(tip.tolist())), scene, 2.3936)
    assert found.reached
    assert found.certificate.stability == pytest.approx(0.1, abs=1e-4)


@pytest.mark.slow
def test_a_target_is_not_missed_for_a_margin_that_is_not_asked_for() -> None:
    """Used to be missed by 5 mm: the one shape at the tip is less stable than the default."""
    arm, upright = Arm.from_paper("section-5.2"), Scene(Extension(), Weight((-12.7, 0.0, 0.0)))
    shape = settle(arm, np.array([0.531, 0.0, 0.0, 0.958]), upright)
    assert 0.05 < shape.stability < 0.1
    found = plan(arm, TipPosition(tuple(shape.tip.tolist())), upright, 20.0)
    assert found.certificate.passed
    assert "stands on the brink" in found.outcome
    assert found.certificate.stability == pytest.approx(shape.stability, rel=1e-3)


@pytest.mark.slow
def test_a_margin_that_no_shape_has_is_said_to_lack() -> None:
    found = hanging(1.0)
    assert not found.reached
    assert "stability below its margin of 1" in "; ".join(found.certificate.failures)
    assert "less stable than the margin of 1;" in found.outcome


def test_a_plan_tells_how_well_it_stands_and_is_loaded_with_its_margin(tmp_path: Path) -> None:
    found = hanging(0.1)
    assert found.certificate.stability_margin == 0.1
    assert f"stability {found.certificate.stability:.3g}, bears" in found.outcome
    assert "at least 0.1" in str(found.certificate)
    loaded = load_plan(found.save(tmp_path / "plan.json"))
    assert loaded == found
    assert loaded.certificate == found.certificate


@pytest.mark.slow
def test_what_a_column_bears_is_its_buckling_load() -> None:
    arm, push = Arm.from_paper("section-5.2"), 1e-2
    end = TipPosition((arm.length, 0.0, 0.0))
    straight = plan(arm, end, Scene(TipLoad((-push, 0, 0))), 20.0)
    stability, bears = straight.certificate.stability, straight.certificate.load_factor
    assert straight.reached
    assert bears == np.inf or bears == pytest.approx(1 / (1 - stability), rel=0.03)
    heavy = TipLoad((-push / (1 - stability) / 2, 0, 0))
    found = plan(arm, end, Scene(heavy), 20.0)
    assert found.certificate.load_factor == pytest.approx(2.0, rel=0.03)
    assert "yields at 2" in found.outcome or "yields at 1.9" in found.outcome


@pytest.mark.slow
def test_where_loads_move_an_arm_far_starts_are_tried_until_two_agree() -> None:
    """Used to end with the first optima without loads, whose best cost 2.5 times as much."""
    target = TipPosition((0.0094, 0.0063, -0.2014))
    found = plan(ARM, target, Scene.silicone(Weight()), 20.0)
    assert found.certificate.passed
    assert found.effort < 2.11
    assert found.shape.stability > 0.1


# The constrained mode became another mode that is already stable, and the arm stayed unstable: such
# shapes were reported as less stable than the margin.
@pytest.mark.slow
def test_the_nearest_shape_of_an_arm_that_would_yield_is_a_stable_one() -> None:
    found = plan(ARM, TipPosition((0.205, 0.449, 0.075)), Scene.silicone(Weight()), 20.0)
    assert found.shape.stability == pytest.approx(0.1, abs=1e-3)
    off = float(np.linalg.norm(found.shape.tip - np.array([0.205, 0.449, 0.075])))
    assert off == pytest.approx(0.2262, abs=1e-3)


@pytest.mark.slow
def test_more_of_a_margin_costs_more_and_is_had() -> None:
    """Used to be out of reach at 0.7, though the plan held to 0.9 has that margin, too."""
    target, scene = TipPosition((0.0729102, -0.04766121, -0.33169873)), Scene.silicone(Weight())
    plans = [plan(ARM, target, scene, 20.0, stability_margin=m) for m in (0.0, 0.65, 0.7, 0.9)]
    assert all(p.certificate.passed for p in plans)
    efforts = [p.effort for p in plans]
    assert np.all(np.diff(efforts) > 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "tip",
    [(-0.0549671, 0.0380832, -0.2934617), (0.0146722, 0.0555980, -0.1063259)],
)
def test_optima_that_stand_where_the_arm_does_not_come_to_from_rest_are_left(
    tip: tuple[float, float, float],
) -> None:
    scene = Scene.silicone(Weight())
    found = plan(ARM, TipPosition(tip), scene, 20.0, compile="auto")
    assert found.reached
    shape = settle(ARM, found.tensions, scene)
    assert shape.tip == pytest.approx(tip, abs=1e-6)
    assert shape.stability > 0
