"""Exact derivatives of programs are those that CasADi, or differences, find in the equations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import pytest

from model import Arm, Scene
from model.effects import (
    Buoyancy,
    Current,
    Effect,
    ExactTendons,
    Extension,
    Friction,
    NeoHookean,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from planner import Limits, Problem, Statement
from planner.solve.side_by_side import Part, SideBySide
from planner.targets import Backbone, TipPosition
from tests.differences import Array, all_of, dense, fourth_order

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


@pytest.mark.quick("weight", "current", "friction", "exact, shear")
@pytest.mark.parametrize(("arm", "effects"), PROGRAMS.values(), ids=PROGRAMS)
def test_derivatives_of_a_loaded_program_are_those_that_casadi_finds(
    arm: Arm, effects: tuple[Effect, ...]
) -> None:
    check_derivatives(arm, Scene(*effects), "exact")


def test_derivatives_of_the_nearest_shape_are_those_that_casadi_finds() -> None:
    check_derivatives(ARM, PAYLOAD_IN_WATER, "nearest")


@pytest.mark.quick("2")
@pytest.mark.parametrize("modes", [1, 2])
def test_derivatives_with_the_least_stable_modes_are_those_that_casadi_finds(modes: int) -> None:
    check_derivatives(ARM, PAYLOAD_IN_WATER, "exact", modes)


def check_derivatives(arm: Arm, scene: Scene, mode: Any, modes: int = 0) -> None:
    """Compare first and second derivatives with CasADi's at a point off the constraints."""
    s = arm.length * np.array([0.4, 0.7])
    through = Backbone(((0.1, 0.05, 0.0), (0.15, 0.1, 0.02)), tuple(s))
    targets = (TipPosition((0.2, 0.05, 0.01)), through)
    limits = Limits.of(arm, 20.0)
    statement = Statement(mode=mode, refinement=1, modes=modes)
    problem = Problem(arm, scene, targets, limits, statement)
    of, sigma, rng = problem.program, 0.7, np.random.default_rng(5)
    f, g, x, p = of.f, of.g, of.x, of.p
    theirs = ca.Function("first", [x, p], [f, ca.gradient(f, x), g, ca.jacobian(g, x)])
    lagrangian = of.sigma * f + ca.dot(of.lam, g)
    given = [x, p, of.sigma, of.lam]
    second = ca.Function("second", given, [of.hessian, ca.hessian(lagrangian, x)[0]])
    at = problem.parameters()
    here = problem.guess(rng.uniform(0, 0.3, arm.n_tendons))
    here = here + 1e-2 * rng.normal(size=here.size)
    for one, other in zip(all_of(of, here, at), theirs(here, at), strict=True):
        other = dense(other)
        check_close(np.reshape(one, other.shape), other)
    lam = rng.normal(size=g.numel())
    H, curvature = (dense(own) for own in second(here, at, sigma, lam))
    check_close(H, curvature)
    assert np.abs(H - H.T).max() < 1e-12 * np.abs(H).max()


def check_close(ours: Array, wanted: Array) -> None:
    """Compare to 1e-9 of the largest entries of the same row and column."""
    assert ours.shape == wanted.shape
    rows, columns = (np.abs(wanted).max(axis=k, keepdims=True) for k in (1, 0))
    assert np.all(np.abs(ours - wanted) <= 1e-9 * np.sqrt(rows * columns))


WANTED = np.array([1.0, 4.0])


def _program() -> SideBySide:
    """Minimise sum (x_k - p_k)^2 + z^2 with x_k = z^2 and x_1 + x_2 bounded."""

    def state(at: SideBySide) -> tuple[Sequence[Part], Part]:
        *xs, z = at.unknowns
        *lams, _ = at.multipliers
        parts = []
        for x, p, lam in zip(xs, ca.vertsplit(at.p), lams, strict=True):
            gradient, J = ca.vertcat(2 * (x - p), 0), ca.horzcat(1, -2 * z)
            H = ca.diag(ca.vertcat(2 * at.sigma, -2 * lam))
            parts.append(Part((x - p) ** 2, gradient, x - z**2, J, H))
        both = ca.DM([[1, 1, 0]])
        return parts, Part(z**2, 2 * z, both @ at.x, ca.MX(both), 2 * at.sigma)

    return SideBySide([1, 1], [1, 1], 1, 1, 2, state)


def test_derivatives_are_those_of_differences() -> None:
    """Of the objective, of the constraints and of the Lagrangian, the upper half of its Hessian."""
    program, x = _program(), np.array([0.3, -0.7, 1.1])
    lam, of = np.array([0.4, -1.3, 0.8]), program.derivatives

    def values(y: np.ndarray) -> np.ndarray:
        return np.vstack([np.array(v) for v in program.values(y, WANTED)]).ravel()

    def slope(y: np.ndarray) -> np.ndarray:
        gradient, J = (np.array(of[name](y, WANTED)[1]) for name in ("grad_f", "jac_g"))
        return np.asarray(gradient.ravel() + J.T @ lam)

    gradient, J = (np.array(of[name](x, WANTED)[1]) for name in ("grad_f", "jac_g"))
    H = np.array(of["hess_lag"](x, WANTED, 1.0, lam))
    for k, along in enumerate(np.eye(3)):
        by_k = fourth_order(lambda h, v=along: values(x + h * v), 1e-3)
        assert np.append(gradient[k], J[:, k]) == pytest.approx(by_k, abs=1e-9)
        curved = fourth_order(lambda h, v=along: slope(x + h * v), 1e-3)
        assert H[: k + 1, k] == pytest.approx(curved[: k + 1], abs=1e-9)
