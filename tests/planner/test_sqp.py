"""Sequential quadratic programming: the optima that ipopt finds, soon, or none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import Buoyancy, Extension, Friction, Weight
from model.time_limit import OutOfTime, time_limit
from planner.program.limits import Limits
from planner.program.problem import TRACES, Problem, build
from planner.program.statement import Statement
from planner.solve.ipopt import solve
from planner.solve.newton import optimality
from planner.solve.sqp import solve_quadratic
from planner.targets import TipPose, TipPosition
from tests.oracles import Array

ARM, PAPER = Arm.from_paper("table-4"), Scene(Extension())
COARSE = Statement(refinement=1)
SCENES = {
    "the paper's tendons in water": Scene(Extension(), Weight(), Buoyancy(1000.0)),
    "in water": Scene.silicone(Weight(), Buoyancy(1000.0)),
    "friction": Scene(Extension(), Friction(0.1)),
}


def stated(
    T: Array, kind: str, upper: float = 20.0, scene: Scene = PAPER, machine_code: bool = False
) -> tuple[Problem, Array, Limits]:
    """Return the program of a target that tensions meet, its parameters and limits."""
    shape = settle(ARM, T, scene)
    tip, frame = tuple(shape.tip), tuple(map(tuple, shape.tip_frame))
    target = (TipPosition(tip) if kind == "tip" else TipPose(tip, frame),)
    limits = Limits.of(ARM, upper)
    problem = build(ARM, target, scene, COARSE, machine_code)
    return problem, problem.parameters(target, limits, TRACES[0]), limits


@pytest.mark.quick("tip-paper", "pose-silicone")
@pytest.mark.parametrize("scene", [PAPER, Scene.silicone()], ids=["paper", "silicone"])
@pytest.mark.parametrize("kind", ["tip", "pose"])
def test_it_finds_optima_near_initial_guesses_in_few_steps(kind: str, scene: Scene) -> None:
    rng, steps, alike = np.random.default_rng(3), [], []
    for _ in range(12):
        T = rng.uniform(size=12) * np.repeat([0.15, 1.0, 4.0], 4)
        problem, p, limits = stated(T, kind, scene=scene)
        x = problem.free(T * rng.uniform(0.5, 1.0), limits)
        bounds = problem.free_bounds(limits)
        found, wanted = solve_quadratic(problem, x, p, bounds), solve(problem, x, p, bounds)
        if found is None or not found.met:
            continue
        worst = optimality(problem, found.x, p, found.lam_x, found.lam_g, bounds).worst
        assert worst <= 1e-6
        steps.append(found.iterations)
        alike.append(wanted.met and found.f == pytest.approx(wanted.f, rel=1e-3))
    assert len(steps) >= 9
    assert np.median(steps) <= 8
    assert np.mean(alike) >= 0.8


@pytest.mark.parametrize("name", SCENES)
def test_states_follow_to_optima(name: str) -> None:
    rng, steps = np.random.default_rng(4), []
    for _ in range(4):
        T = rng.uniform(size=12) * np.repeat([0.1, 0.5, 2.0], 4)
        problem, p, limits = stated(T, "tip", scene=SCENES[name])
        x = problem.unknowns(T * rng.uniform(0.5, 1.0), limits, p)
        found = solve_quadratic(problem, x, p, problem.free_bounds(limits))
        if found is None or not found.met:
            continue
        own = found.free(problem)
        worst = optimality(problem, own.x, p, own.lam_x, own.lam_g, problem.free_bounds(limits))
        assert worst.worst <= 1e-6
        assert np.abs(problem.constraints(found.x, p)[-50:]).max() <= 1e-6
        steps.append(found.iterations)
    assert len(steps) >= 3
    assert np.median(steps) <= 12


@pytest.mark.parametrize("machine_code", [False, True], ids=["interpreted", "compiled"])
def test_steps_do_not_creep_where_the_hessian_is_not_convex(machine_code: bool) -> None:
    # In air: they came to shapes that meet the target, and crept towards less effort from there.
    target = (TipPosition((0.0771475, 0.0540127, -0.2411071)),)
    problem = build(ARM, target, Scene.silicone(Weight()), COARSE, machine_code)
    limits = Limits.of(ARM, 20.0)
    p, bounds = problem.parameters(target, limits, TRACES[0]), problem.free_bounds(limits)
    for T in ([0, 0.3, 0.6, 0, 0, 0, 1, 0.5, 0, 0, 0, 0], [0.1] * 4 + [0.5] * 4 + [1.0] * 4):
        found = solve_quadratic(problem, problem.unknowns(np.array(T), limits, p), p, bounds)
        assert found is not None
        assert found.met


def test_what_comes_near_a_known_optimum_is_taken_for_it() -> None:
    T = np.array([0, 0, 0.2, 0, 0, 0.4, 0, 0, 0, 0, 1.0, 0])
    problem, p, limits = stated(T, "tip")
    x, bounds = problem.free(T, limits), problem.free_bounds(limits)
    alone = solve_quadratic(problem, x, p, bounds)
    assert alone is not None
    assert alone.met
    joined = solve_quadratic(problem, x, p, bounds, known=[alone])
    assert joined is not None
    assert np.array_equal(joined.x, alone.x)
    assert joined.iterations < alone.iterations
    elsewhere = replace(alone, x=alone.x + 0.05 * np.abs(alone.x).max())
    apart = solve_quadratic(problem, x, p, bounds, known=[elsewhere])
    assert apart is not None
    assert apart.iterations == alone.iterations


@pytest.mark.parametrize("upper", [20.0, 0.3], ids=["met", "not met"])
@pytest.mark.parametrize("kind", ["tip", "pose"])
@pytest.mark.parametrize("name", ["paper", "silicone", "in water"])
def test_steps_in_c_are_those_in_python(name: str, kind: str, upper: float) -> None:
    scene = {"paper": PAPER, "silicone": Scene.silicone(), **SCENES}[name]
    rng, met = np.random.default_rng(5), list[bool]()
    for _ in range(6):
        T = rng.uniform(size=12) * np.repeat([0.1, 0.7, 3.0], 4)
        problem, p, limits = stated(T, kind, upper, scene)
        compiled, _, _ = stated(T, kind, upper, scene, machine_code=True)
        bounds = problem.free_bounds(limits)
        x = problem.unknowns(np.minimum(0.7 * T, upper), limits, p)
        wanted = solve_quadratic(problem, x, p, bounds)
        found = solve_quadratic(compiled, x, p, bounds)
        assert wanted is not None
        assert found is not None
        assert found.met == wanted.met
        met.append(found.met)
        if not wanted.met:
            continue
        assert found.iterations == wanted.iterations
        for name in ("x", "g", "lam_x", "lam_g"):
            assert np.abs(getattr(found, name) - getattr(wanted, name)).max() <= 1e-6
        joined = solve_quadratic(compiled, x, p, bounds, known=[wanted])
        assert joined is not None
        assert np.array_equal(joined.x, wanted.x)
    assert any(met) if upper == 20.0 else not all(met)


def test_what_cannot_be_met_has_no_optimum() -> None:
    T = np.array([0, 0, 0.2, 0, 0, 0.4, 0, 0, 0, 0, 1.0, 0])
    problem, p, limits = stated(T, "tip", upper=0.05)
    found = solve_quadratic(problem, problem.free(T, limits), p, problem.free_bounds(limits))
    assert found is None or not found.met


def test_least_squares_are_left_to_ipopt() -> None:
    T = np.array([0, 0, 0.2, 0, 0, 0.4, 0, 0, 0, 0, 1.0, 0])
    target, limits = (TipPosition(tuple(settle(ARM, T, PAPER).tip)),), Limits.of(ARM, 20.0)
    problem = build(ARM, target, PAPER, COARSE.but(mode="nearest"))
    p = problem.parameters(target, limits, TRACES[0])
    x = problem.unknowns(T, limits, p)
    assert solve_quadratic(problem, x, p, problem.free_bounds(limits)) is None


def test_a_time_limit_ends_it() -> None:
    T = np.array([0, 0, 0.2, 0, 0, 0.4, 0, 0, 0, 0, 1.0, 0])
    problem, p, limits = stated(T, "tip")
    with pytest.raises(OutOfTime), time_limit(1e-9):
        solve_quadratic(problem, problem.free(T, limits), p, problem.free_bounds(limits))
