"""Descents along stable shapes: derivatives along equilibria, steps, and plans of hanging arms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, minimize

from octoplan import (
    Arm,
    Extension,
    Scene,
    TipPosition,
    Weight,
    plan,
    settle,
)
from octoplan.model.equilibrium.stability import is_stable
from octoplan.planner.limits import TendonLimits
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from octoplan.planner.program_instance import ProgramInstance
from octoplan.planner.solve.reduced_program import ReducedProgram, elastic_step
from octoplan.planner.solve.stable_descent import descend

DOWN = ((0, -1, 0), (0, 0, 1), (-1, 0, 0))
HANGING = replace(Arm.from_paper("table-4"), base_frame=DOWN)
SILICONE = Scene.silicone(Weight())
# Two tendons pull the second half of the arm to opposite sides, close to a fold of the arm.
NEAR_A_FOLD = [0, 0, 0, 1.80655, 0, 1.76756, 0, 0, 0, 0, 0, 0]


def problem_at(tensions: list[float], modes: int = 0) -> ProgramInstance:
    """Return the instance of the tip under tensions [N], on the coarse mesh."""
    tip = tuple(settle(HANGING, tensions, SILICONE).tip.tolist())
    limits = TendonLimits.of(HANGING, 8.0)
    options = NlpOptions(refinement=1, modes=modes, margin=0.1)
    return ProgramInstance(
        PlanningProblem(HANGING, (TipPosition(tip),), SILICONE, limits, options, 1e-6)
    )


@pytest.mark.parametrize("modes", [0, 1])
def test_reduced_derivatives_are_differences_along_equilibria(modes: int) -> None:
    instance = problem_at(NEAR_A_FOLD, modes)
    tensions = np.full(12, 0.05) + 0.1 * np.arange(12)
    start = instance.forward.solve(tensions)
    rng = np.random.default_rng(0)
    way = rng.normal(size=12)
    lam = rng.normal(size=ReducedProgram(instance, start, instance.parameters()).rows.size)

    def at(share: float) -> ReducedProgram:
        end = instance.forward.solve_from(start, tensions + share * way * instance.unit)
        assert end is not None
        return ReducedProgram(instance, end, instance.parameters())

    h = 1e-3
    points = [at(k * h) for k in (-2, -1, 0, 1, 2)]
    weights = np.array([1, -8, 0, 8, -1]) / (12 * h)
    here = points[2]
    f = np.array([each.f for each in points])
    rows = np.array([each.rows for each in points])
    slopes = np.array([each.gradient + lam @ each.jacobian for each in points])
    assert here.gradient @ way == pytest.approx(weights @ f, rel=1e-6)
    assert here.jacobian @ way == pytest.approx(weights @ rows, rel=1e-5, abs=1e-7)
    # The Hessian along the equilibria, before it is made definite.
    curvature = here.curvature(lam)
    assert curvature @ way == pytest.approx(weights @ slopes, rel=1e-4, abs=1e-4)
    assert curvature == pytest.approx(curvature.T, abs=1e-9)


def test_elastic_step_is_the_minimiser_that_another_solver_finds() -> None:
    instance = problem_at(NEAR_A_FOLD)
    start = instance.forward.solve(np.full(12, 0.1))
    point = ReducedProgram(instance, start, instance.parameters())
    H = point.hessian(np.zeros(point.rows.size))
    step = elastic_step(point, H, point.rows, 10.0, 0.2)
    assert step is not None
    m, n = point.jacobian.shape
    lower, upper = point.row_bounds
    low, high = point.box(0.2)
    slack = np.eye(m)

    def model(z: np.ndarray) -> float:
        d = z[:n]
        return float(point.gradient @ d + d @ H @ d / 2 + 10.0 * z[n:].sum())

    def slope(z: np.ndarray) -> np.ndarray:
        return np.append(point.gradient + H @ z[:n], np.full(m, 10.0))

    above, below = np.isfinite(upper), np.isfinite(lower)
    upper_rows = np.hstack([point.jacobian, -slack])[above]
    lower_rows = np.hstack([point.jacobian, slack])[below]
    rows = [
        LinearConstraint(upper_rows, -np.inf, (upper - point.rows)[above]),
        LinearConstraint(lower_rows, (lower - point.rows)[below], np.inf),
    ]
    bounds = [*zip(low, high, strict=True), *[(0, None)] * m]
    violation = point.violation(point.rows + point.jacobian @ step.change)
    other = minimize(
        model,
        np.append(np.zeros(n), point.violation(point.rows)),
        jac=slope,
        bounds=bounds,
        constraints=rows,
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 300},
    )
    assert model(np.append(step.change, violation)) == pytest.approx(other.fun, rel=1e-5)


def test_descent_ends_at_a_stable_shape_at_the_target() -> None:
    instance = problem_at(NEAR_A_FOLD)
    start = instance.forward.solve_towards(np.zeros(12))
    optimum = descend(instance, start)
    end = instance.linearised(optimum.x)
    tip = instance.problem.targets[0].position  # type: ignore[attr-defined]
    assert optimum.converged
    assert end.poses[-1, 4:] == pytest.approx(tip, abs=1e-5 * HANGING.length)
    assert is_stable(end, 0.1)
    assert optimum.residual < 1e-2


def test_path_to_tensions_ends_if_the_arm_curls_without_end() -> None:
    instance = problem_at(NEAR_A_FOLD)
    tensions = np.array([0, 1.353, 2.817, 0, 1.497, 0, 0, 2.453, 3.439, 0.315, 0, 0])
    end = instance.forward.solve_towards(tensions)
    share = end.tensions[1] / tensions[1]
    assert end.tensions == pytest.approx(share * tensions)
    assert 0.3 < share < 1


def test_plan_of_an_arm_near_a_fold_is_reached() -> None:
    shape = settle(HANGING, NEAR_A_FOLD, SILICONE)
    p = plan(HANGING, TipPosition(tuple(shape.tip.tolist())), SILICONE, tension_max=8.0)
    assert p.reached, p.outcome
    assert p.effort < np.linalg.norm(NEAR_A_FOLD)
    assert p.shape.history == "loads first"
    again = settle(HANGING, p.tensions, SILICONE)
    assert again.tip == pytest.approx(shape.tip, abs=2e-6 * HANGING.length)


def test_descent_with_a_defect_may_begin_below_the_margin() -> None:
    """The row of the stability had no place in the defect, and plans ended in a ValueError."""
    plain = problem_at(NEAR_A_FOLD)
    start = plain.forward.solve(np.array(NEAR_A_FOLD))
    margin = 1.01 * settle(HANGING, NEAR_A_FOLD, SILICONE).stability
    instance = plain.replace(margin=margin)
    assert not is_stable(start, margin)
    size = instance.measured(instance.complete(start.tensions, start.states)).size
    found = descend(instance, start, np.zeros(size))
    without = descend(instance, start)
    assert found.f == pytest.approx(without.f, rel=1e-6)


def test_plan_of_a_slender_tip_that_rolls_up_takes_few_steps() -> None:
    """Five descents took 127 steps, and two thirds of the time was spent on the tensions' paths."""
    scene = Scene(Extension(), Weight())
    tensions = [0.409, 1.03, 0, 0, 0, 0, 1.26, 2.424, 0, 0, 0, 0]
    shape = settle(HANGING, tensions, scene)
    p = plan(HANGING, TipPosition(tuple(shape.tip.tolist())), scene, tension_max=3.53)
    assert p.reached, p.outcome
    assert p.effort < np.linalg.norm(tensions)
    assert sum(trial.iterations for trial in p.solution.starts) <= 90
