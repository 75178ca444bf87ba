"""How the tip gives way inside a program: values, and first and second derivatives."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from model import Arm, Scene
from model.effects import Current, Effect, Extension, Friction, Shear, TipLoad
from model.integrators.magnus import MAGNUS6
from model.response.compliance import closed_compliance
from model.response.give import closed_give
from planner import Limits, Statement, build, stiffness
from planner.program.gives import tip_give
from planner.targets import MinimumStiffness, Softest, Stiffest, Target, TipPosition
from planner.targets.base import Look
from tests.stiffness.cases import IN_WATER, STATICS, Array, gap, pulling, with_effects

ARM, T = Arm.from_paper("table-4"), pulling("table-4", 3)
ONE_SECTION = Arm.from_paper("section-5.2")
ALONG, EA = (1.0, 2.0, 0.5), 5.0
MATRIX = ((0.2, 0.05, 0.0), (0.05, 0.3, 0.0), (0.0, 0.0, 0.1))


@pytest.mark.parametrize("share", [0.3, 1.0])
@pytest.mark.parametrize("scene", STATICS)
def test_a_sweep_and_a_sum_of_steps_give_the_same_compliance(scene: str, share: float) -> None:
    at = share * ARM.length
    swept = closed_give(ARM, STATICS[scene], MAGNUS6, 3, at)(T)
    summed = closed_compliance(ARM, STATICS[scene], 3, at, False).function(T)[0]
    assert gap(np.array(swept), np.array(summed)) < 1e-13


@pytest.mark.parametrize("scene", ["paper", "silicone"])
def test_derivatives_of_a_sweep_are_those_through_every_newton_step(scene: str) -> None:
    x = ca.MX.sym("T", ARM.n_tendons)
    swept = closed_give(ARM, STATICS[scene], MAGNUS6, 1, ARM.length)(x)[1, 1]
    summed = closed_compliance(ARM, STATICS[scene], 1, ARM.length, False).function(x)[0][1, 1]
    found, wanted = (ca.Function("h", [x], list(ca.hessian(C, x)))(T) for C in (swept, summed))
    for one, other in zip(found, wanted, strict=True):
        assert gap(np.array(one), np.array(other)) < 1e-11


@pytest.mark.parametrize("hold", ["tension", "length"])
def test_what_an_unloaded_program_sees_is_what_stiffness_says(hold: Any) -> None:
    EA_held = EA if hold == "length" else None
    k = stiffness(ARM, T, STATICS["exact"], hold, accuracy=1e-9, tendon_EA=EA_held)
    D = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 0.2]])
    seen = tip_give(ARM, STATICS["exact"], "magnus6", 8, Look(hold, 2, EA_held))(T, D)
    assert gap(np.array(seen), D.T @ k.compliance[:3, :3] @ D) < 1e-8


Case = tuple[Arm, tuple[Effect, ...], Target]
PROGRAMS: dict[str, Case] = {
    "payload": (ARM, (Extension(), TipLoad((0.0, 0.0, -1e-3))), Stiffest(ALONG)),
    "in water, a matrix": (ARM, (Extension(), *IN_WATER), MinimumStiffness(MATRIX, 0.5)),
    "in water, locked": (
        ARM,
        (Extension(), *IN_WATER),
        MinimumStiffness(ALONG, 0.5, "length", EA),
    ),
    "current, locked": (
        ONE_SECTION,
        (Extension(), Current((0.02, 0.01, -0.05))),
        Softest(ALONG, hold="length", tendon_EA=EA),
    ),
    "follower": (ARM, (TipLoad((0.0, 1e-3, 0.0), follower=True),), Softest(ALONG)),
    "shear": (ARM, (Extension(), Shear()), Stiffest(ALONG)),
    "friction": (ONE_SECTION, (Extension(), Friction(0.1, (1, 1, -1, -1))), Stiffest(ALONG)),
    "silicone in water": (
        ONE_SECTION,
        (*Scene.silicone().effects, *IN_WATER),
        MinimumStiffness(ALONG, 0.5),
    ),
}


def fourth_order(f: Any, h: float) -> Any:
    """The derivative of f at 0 by the central formula of four points."""
    return (f(-2 * h) - 8 * f(-h) + 8 * f(h) - f(2 * h)) / (12 * h)


@pytest.mark.parametrize(("arm", "effects", "target"), PROGRAMS.values(), ids=PROGRAMS)
def test_derivatives_of_a_loaded_program_with_a_stiffness_are_differences_of_it(
    arm: Arm, effects: tuple[Effect, ...], target: Target
) -> None:
    targets, limits = (TipPosition((0.2, 0.05, 0.01)), target), Limits.of(arm, 20.0)
    statement = Statement("multiple-shooting", scheme="rk4", refinement=2)
    problem = build(arm, targets, Scene(*effects), statement)
    rng, p = np.random.default_rng(5), problem.parameters(targets, limits)
    x = problem.unknowns(rng.uniform(0.05, 0.3, arm.n_tendons), limits, p)
    x = x + 1e-3 * rng.normal(size=x.size)
    lam, way = rng.normal(size=problem.nlp["g"].numel()), rng.normal(size=x.size)
    values = ca.Function("v", [problem.nlp[k] for k in "xp"], [problem.nlp[k] for k in "fg"])

    def lagrangian(share: float) -> float:
        f, g = values(x + share * way, p)
        return float(f) + float(lam @ np.array(g).ravel())

    def slopes(share: float) -> Array:
        gradient, _, jacobian = problem.derivatives.slopes(x + share * way, p)
        return np.asarray(np.array(gradient).ravel() + np.array(jacobian).T @ lam)

    assert slopes(0.0) @ way == pytest.approx(fourth_order(lagrangian, 1e-4), rel=1e-6)
    H = np.array(problem.derivatives.curvature(x, p, 1.0, lam))
    assert gap(H @ way, fourth_order(slopes, 1e-4)) < 1e-6
    assert np.abs(H - H.T).max() < 1e-10 * np.abs(H).max()


@pytest.mark.parametrize("hold", ["tension", "length"])
def test_what_a_loaded_program_sees_is_what_stiffness_says(hold: Any) -> None:
    scene, EA_held = with_effects(STATICS["paper"], *IN_WATER), EA if hold == "length" else None
    k = stiffness(ARM, T, scene, hold, accuracy=1e-9, tendon_EA=EA_held)
    d = np.array(ALONG) / np.linalg.norm(ALONG)
    wanted = float(1 / (d @ k.compliance[:3, :3] @ d))
    targets = (MinimumStiffness(ALONG, wanted, hold, EA_held),)
    limits = Limits.of(ARM, 20.0)
    statement = Statement("multiple-shooting", scheme="rk6", refinement=8)
    problem = build(ARM, targets, scene, statement)
    p = problem.parameters(targets, limits)
    g = np.array(problem.derivatives.slopes(problem.unknowns(T, limits, p), p)[1]).ravel()
    assert abs(g[0]) < 1e-7
