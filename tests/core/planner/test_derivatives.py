"""Exact derivatives of programs agree with CasADi's, or with differences, of the equations."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, Scene
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
from octoplan.model.extensions.friction import Friction
from octoplan.model.extensions.obstacles import Sphere
from octoplan.planner import plan
from octoplan.planner.limits import Limits, TendonLimits
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from octoplan.planner.program_instance import ProgramInstance
from octoplan.planner.targets import Backbone, TipPosition
from tests.differences import Array, all_of, check_derivatives, dense, whole

ARM = Arm.from_paper("table-4")
ONE_SECTION = Arm.from_paper("section-5.2")
WATER: tuple[Effect, ...] = (Weight(), Buoyancy())
PAYLOAD = TipLoad((0.0, 0.0, -5e-4), (0.0, 2e-5, 0.0))
PAYLOAD_IN_WATER = Scene(Extension(), *WATER, PAYLOAD)
PROGRAMS: dict[str, tuple[Arm, tuple[Effect, ...]]] = {
    "weight": (ARM, (Extension(), *WATER)),
    "bending, dead load": (ARM, (TipLoad((1e-3, 0.0, -1e-3), (1e-5, 2e-5, 0.0)),)),
    "follower": (ARM, (Extension(), TipLoad((0.0, 1e-3, 0.0), follower=True))),
    "current": (ARM, (Extension(), Current((0.02, 0.01, -0.05)))),
    "point load": (ARM, (Extension(), PointLoad(0.225, (0.0, 0.0, -5e-3)))),
    "friction": (ONE_SECTION, (Extension(), Friction(0.1, (1, 1, -1, -1)))),
    "exact, shear": (ARM, (Extension(), ExactTendons(), Shear())),
    "friction, three sections": (ARM, (Extension(), *WATER, Friction(0.1))),
    "silicone, shear, in water": (
        ARM,
        (Extension(), ExactTendons(), NeoHookean(), Shear(), *WATER),
    ),
    "exact, shear, friction": (
        ONE_SECTION,
        (Extension(), ExactTendons(), Shear(), Friction(0.1), *WATER),
    ),
}


@pytest.mark.quick("current", "exact, shear")
@pytest.mark.parametrize(("arm", "effects"), PROGRAMS.values(), ids=PROGRAMS)
def test_derivatives_of_a_loaded_program_are_those_that_casadi_finds(
    arm: Arm, effects: tuple[Effect, ...]
) -> None:
    check_program(arm, Scene(*effects), "exact")


def test_derivatives_of_the_nearest_shape_are_those_that_casadi_finds() -> None:
    check_program(ARM, PAYLOAD_IN_WATER, "nearest")


@pytest.mark.slow
def test_derivatives_with_the_least_stable_mode_are_those_that_casadi_finds() -> None:
    check_program(ARM, PAYLOAD_IN_WATER, "exact", 1)


@pytest.mark.slow
def test_how_near_a_target_is_had_does_not_depend_on_the_norm_of_effort() -> None:
    """Among obstacles CasADi uses reverse mode, which lost derivatives by the largest tension."""
    angles = tuple(np.radians([276.2, 6.2, 96.2, 186.2]).tolist())
    arm = Arm(0.3, Linear(0.012, 0.007), (Anchorage(0.3, Linear(0.007, 0.004), angles),))
    ball, target = Sphere((0.1855, 0.0869, 0.0769), 0.02), TipPosition((0.149, 0.117, 0.1326))
    limits = Limits(tension_max=5.0, tension_min=0.05, total_pull=1.8)
    missed = []
    for norm in ("2", "inf"):
        found = plan(
            arm,
            target,
            Scene(Extension()),
            norm=norm,
            obstacles=[ball],
            limits=limits,
        )
        missed.append(found.certificate.residual)
        assert found.optimum is not None
        problem, x = found.program(), found.optimum.x
        x = x + 1e-2 * np.random.default_rng(5).normal(size=x.size)
        check_derivatives(whole(problem, problem.parameters()), x, 1e-4)
    assert missed[1] == pytest.approx(missed[0], rel=1e-3)


def check_program(arm: Arm, scene: Scene, mode: Any, modes: int = 0) -> None:
    """Compare first and second derivatives with CasADi's at a point off the constraints."""
    s = arm.length * np.array([0.4, 0.7])
    through = Backbone(((0.1, 0.05, 0.0), (0.15, 0.1, 0.02)), tuple(s))
    targets = (TipPosition((0.2, 0.05, 0.01)), through)
    limits = TendonLimits.of(arm, 20.0)
    options = NlpOptions(mode=mode, refinement=1, modes=modes)
    problem = ProgramInstance(PlanningProblem(arm, targets, scene, limits, options, 1e-6))
    of, sigma, rng = problem.program, 0.7, np.random.default_rng(5)
    x, p, sigma_of, lam_of = given = of.function.mx_in()
    f, _, g, _, H_of = of.function.call(given, True, False)
    theirs = ca.Function("first", [x, p], [f, ca.gradient(f, x), g, ca.jacobian(g, x)])
    lagrangian = sigma_of * f + ca.dot(lam_of, g)
    upper = ca.triu(ca.hessian(lagrangian, x)[0])
    second = ca.Function("second", given, [H_of, upper])
    here = problem.guess(rng.uniform(0, 0.3, arm.n_tendons))
    at = problem.parameters_at(here, problem.parameters())
    here = here + 1e-2 * rng.normal(size=here.size)
    for one, other in zip(all_of(of, here, at), theirs(here, at), strict=True):
        other = dense(other)
        check_close(np.reshape(one, other.shape), other)
    lam = rng.normal(size=g.numel())
    H, curvature = (dense(own) for own in second(here, at, sigma, lam))
    check_close(H, curvature)


def check_close(ours: Array, wanted: Array) -> None:
    """Compare to 1e-9 of the largest entries of the same row and column."""
    assert ours.shape == wanted.shape
    rows, columns = (np.abs(wanted).max(axis=k, keepdims=True) for k in (1, 0))
    assert np.all(np.abs(ours - wanted) <= 1e-9 * np.sqrt(rows * columns))
