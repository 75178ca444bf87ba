"""Integrators that choose their steps: what a refinement is to them, and what their errors say."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
import pytest

from model import Arm, NotSettledError, Scene, settle
from model.effects import ExactTendons, Extension
from model.forward import forward_map, schemes_of
from model.integrators.adaptive import CVODES, ERK, Adaptive
from tests.model.cases import MOST, arm_of, mild_tensions, paper_tensions, random_rod
from tests.oracles import Array

PAPER = Scene(Extension())
# Tensions on random arms are mild, as strong ones leave exact tendons without equilibrium.
ON_PAPER_ARMS = (Scene(), PAPER, Scene.as_printed())
ON_RANDOM_ARMS = (Scene(), PAPER, Scene(Extension(), ExactTendons()))
BOTH = pytest.mark.parametrize("scheme", ["erk", "cvodes"])
SETS = 24


@dataclass(frozen=True, eq=False)
class Case:
    arm: Arm
    scene: Scene
    T: Array
    asked: float
    tip: Array


@cache
def cases() -> tuple[Case, ...]:
    """Return random arms, tensions and accuracies; the truth is a fine mesh of another scheme."""
    found = []
    for seed in range(SETS):
        rng = np.random.default_rng(seed)
        if seed % 2:
            name = str(rng.choice(list(MOST)))
            arm, T = Arm.from_paper(name), paper_tensions(rng, name)
            scene = ON_PAPER_ARMS[rng.integers(3)]
        else:
            rod = random_rod(rng)
            rod.position[:] = 0
            arm, T, scene = arm_of(rod), mild_tensions(rng, rod), ON_RANDOM_ARMS[rng.integers(3)]
        T, asked = T * 10 ** rng.uniform(-2, 0), float(10 ** rng.uniform(-8, -3))
        finest = forward_map(arm, scene, schemes_of(scene)[0], 64).run(T)[0][-1, 4:7]
        found.append(Case(arm, scene, T, asked, finest))
    return tuple(found)


@cache
def outcomes(scheme: str) -> tuple[tuple[float, float, float], ...]:
    """Return the error asked for, stated and true of each case, over the length."""
    found = []
    for x in cases():
        shape = settle(x.arm, x.T, x.scene, x.asked, scheme)
        gap = float(np.linalg.norm(shape.tip - x.tip)) / x.arm.length
        found.append((x.asked, shape.error, gap))
    return tuple(found)


@BOTH
def test_tip_is_within_the_accuracy_asked_for(scheme: str) -> None:
    assert all(true <= asked for asked, _, true in outcomes(scheme))


@BOTH
def test_stated_error_bounds_the_true_one(scheme: str) -> None:
    rounding = 1e-13
    assert all(true <= stated + rounding for _, stated, true in outcomes(scheme))


@BOTH
@pytest.mark.parametrize("name", MOST)
def test_tip_error_falls_at_the_stated_order_or_faster(scheme: str, name: str) -> None:
    arm = Arm.from_paper(name)
    for seed in range(4):
        T = paper_tensions(np.random.default_rng(seed), name)
        wanted = forward_map(arm, PAPER, "magnus6", 256).run(T)[0][-1, 4:7]
        maps = [forward_map(arm, PAPER, scheme, r) for r in (2, 8)]
        coarse, fine = (np.linalg.norm(f.run(T)[0][-1, 4:7] - wanted) for f in maps)
        assert np.log2(coarse / fine) / 2 > maps[0].order - 0.3


@BOTH
def test_strain_error_falls_with_the_tolerance(scheme: str) -> None:
    arm = Arm.from_paper("table-4")
    T = paper_tensions(np.random.default_rng(2), "table-4")
    wanted = forward_map(arm, PAPER, "rk8", 128).run(T)[0][0, 7:]
    maps = [forward_map(arm, PAPER, scheme, r) for r in (1, 2, 4, 8)]
    errors = [float(np.linalg.norm(f.run(T)[0][0, 7:] - wanted)) for f in maps]
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 3)


@pytest.mark.parametrize("scheme", [ERK, CVODES])
def test_refining_divides_the_tolerance_by_the_sixth_power(scheme: Adaptive) -> None:
    assert scheme.refined(1) == scheme
    assert scheme.refined(8).tolerance == pytest.approx(scheme.tolerance / 8**6, rel=1e-15)
    assert scheme.refined(8).order == scheme.order


def test_cvodes_owns_to_missing_an_accuracy_beyond_its_tolerances() -> None:
    T = paper_tensions(np.random.default_rng(0), "table-4")
    with pytest.raises(NotSettledError, match="cvodes failed on a step: ask for less accuracy"):
        settle(Arm.from_paper("table-4"), T, PAPER, 1e-11, "cvodes")


@pytest.mark.parametrize("scheme", [ERK, CVODES])
def test_numbers_between_the_samples_are_those_of_the_polynomial_through_them(
    scheme: Adaptive,
) -> None:
    x, d = ca.SX.sym("x", 1), ca.SX.sym("d", 1)
    step = scheme.refined(16).stepper(ca.Function("slope", [x, d], [d]), np.ones(1))
    for degree in range(13):
        given = np.array(scheme.samples) ** degree
        assert float(step(0.0, given[None, :], 0.5)) == pytest.approx(0.5 / (degree + 1), abs=1e-9)
