"""Any arm, scene, tensions, targets: a finite result within its accuracy, or an OctoplanError."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from octoplan.model import Anchorage, Arm, Linear, Material, OctoplanError, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, NeoHookean, TipLoad, Weight
from octoplan.model.effects.base import Effect
from octoplan.model.support.progress import OutOfTime, time_limit
from octoplan.planner import plan, stiffness
from octoplan.planner.targets import Backbone, BendingPlane, Target, TipPosition

# Usual numbers, and numbers that no user has.
ANY = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from([0.0, -0.0, 5e-324, 1e-300, 1e308, -1e308, float("nan"), float("inf")]),
    st.floats(1e-3, 10.0),
)
SOUND = st.floats(1e-3, 1.0)
SECONDS = 2.0
Check = Callable[..., None]
Drawn = tuple[st.SearchStrategy[Any], ...]
BASIC = settings(
    deadline=None,
    suppress_health_check=list(HealthCheck),
    phases=[Phase.explicit, Phase.reuse, Phase.generate],
)


@st.composite
def arms(draw: st.DrawFn) -> Arm:
    """Draw an arm of up to four sections, most of them valid."""
    L = draw(st.floats(0.05, 1.0))
    R = draw(st.floats(0.01, 0.1)) * L
    n = draw(st.integers(1, 4))
    tip = R * draw(st.floats(0.01, 1.0))
    ends = [L * (1 - i / n) for i in range(n)]
    share = draw(st.floats(0.1, 0.9))
    angles = tuple(np.arange(draw(st.integers(1, 5))) * 2.1)
    sections = tuple(
        Anchorage(at, Linear(share * R, share * (R + (tip - R) * at / L)), angles) for at in ends
    )
    return Arm(L, Linear(R, tip), sections, Material(draw(st.floats(1e3, 1e9))))


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    """A scene without loads or with small ones."""
    effects: list[Effect] = []
    if draw(st.booleans()):
        effects.append(Extension())
        if draw(st.booleans()):
            effects.append(ExactTendons())
            if draw(st.booleans()):
                effects.append(NeoHookean())
    if draw(st.integers(0, 9)) == 0:
        effects.append(draw(st.sampled_from([Weight(), TipLoad((0.0, 0.0, -1e-3))])))
    return Scene(*effects)


def any_tensions_settle_or_are_refused(
    arm: Arm, scene: Scene, numbers: list[float], accuracy: float
) -> None:
    T = np.resize(numbers, arm.n_tendons)
    try:
        with time_limit(SECONDS):
            shape = settle(arm, T, scene, accuracy)
    except (OctoplanError, OutOfTime):
        return
    assert np.all(np.isfinite(shape.states)) and shape.error <= accuracy
    assert np.linalg.norm(shape.tip) <= arm.length * (1 + 1e-9) or not scene.effects


def force(arm: Arm, share: float) -> float:
    """Return a tension that is a fraction of the crushing force of the tip [N]."""
    R = float(arm.radius.evaluate(np.array([arm.length]), arm.length)[0][0])
    return share * arm.material.E * np.pi * R**2


def moderate_pulls_have_a_compliance_that_is_symmetric(
    arm: Arm, scene: Scene, shares: list[float]
) -> None:
    T = np.array([force(arm, 0.05 * share) for share in shares])
    try:
        with time_limit(SECONDS):
            k = stiffness(arm, np.resize(T, arm.n_tendons), scene)
    except (OctoplanError, OutOfTime):
        return
    size = np.repeat([arm.length, 1.0], 3)
    scaled = k.compliance / np.outer(size, size)
    # Tendons along their reference tangents have no energy: the error is of the order of T / EA.
    allowed = 1e-5 if scene.has(ExactTendons) else 0.05
    assert np.abs(scaled - scaled.T).max() <= allowed * np.abs(scaled).max()


def targets_of(arm: Arm, numbers: list[float], kind: int) -> Target:
    """Return a target of some kind, near the arm or far from the arm."""
    L = arm.length
    if kind == 0:
        return TipPosition(tuple(L * x for x in numbers[:3]))
    if kind == 1:
        return BendingPlane(numbers[0], abs(numbers[1]), 1)
    return Backbone(tuple(tuple(L * x for x in numbers[i : i + 3]) for i in (0, 3)))


def any_target_ends_in_a_plan_or_is_refused(
    arm: Arm, scene: Scene, numbers: list[float], kind: int, most: Any
) -> None:
    try:
        found = plan(arm, targets_of(arm, numbers, kind), scene, most, time_limit=SECONDS)
    except OctoplanError:
        return
    T = np.ravel(found.tensions)
    assert np.all(np.isfinite(T)) and np.all(T >= 0) and np.all(most >= T)
    if found.reached:
        assert found.certificate.residual <= found.accuracy


WHOLE = (arms(), scenes())
CHECKS = [
    (any_tensions_settle_or_are_refused, 40, (st.lists(ANY, min_size=1, max_size=20), ANY)),
    (
        moderate_pulls_have_a_compliance_that_is_symmetric,
        15,
        (st.lists(SOUND, min_size=20, max_size=20),),
    ),
    (
        any_target_ends_in_a_plan_or_is_refused,
        5,
        (
            st.lists(st.one_of(st.floats(-1.5, 1.5), ANY), min_size=6, max_size=6),
            st.integers(0, 2),
            ANY,
        ),
    ),
]
NAMES = [check.__name__ for check, _, _ in CHECKS]


@pytest.mark.quick("any_target_ends_in_a_plan_or_is_refused", "any_tensions_settle_or_are_refused")
@pytest.mark.parametrize(("check", "examples", "drawn"), CHECKS, ids=NAMES)
def test_it_holds_for_the_same_few(check: Check, examples: int, drawn: Drawn) -> None:
    settings(BASIC, max_examples=(examples + 1) // 2, derandomize=True)(
        given(*WHOLE, *drawn)(check)
    )()


@pytest.mark.slow
@pytest.mark.parametrize(("check", "examples", "drawn"), CHECKS, ids=NAMES)
def test_it_holds_for_many_others(check: Check, examples: int, drawn: Drawn) -> None:
    settings(BASIC, max_examples=40 * examples)(given(*WHOLE, *drawn)(check))()
