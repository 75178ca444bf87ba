"""Plans that keep a place and are as stiff as was asked, in arms under loads."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import Extension, TipLoad
from octoplan.planner import Plan, plan, stiffness
from octoplan.planner.limits import Limits
from octoplan.planner.targets import MinimumStiffness, Softest, Stiffest, TipPosition
from tests.collocation import collocated
from tests.core.stiffness.cases import IN_WATER, STATICS, Array, moved, pushed, with_effects
from tests.core.stiffness.test_against_differences import STEP, TENDON_EA, with_lengths_held
from tests.differences import fourth_order

PAPERS = Arm.from_paper("table-4")
PAIRS = tuple(replace(section, angles=(0.0, 2.0, 4.0)) for section in PAPERS.sections[:2])
ARMS = {"table-4": PAPERS, "six tendons": replace(PAPERS, sections=PAIRS)}
PULLS = {
    "table-4": [[0.0, 0.0, 0.0, 0.05], [0.0, 0.0, 0.6, 0.1], [0.0, 0.0, 0.7, 0.1]],
    "six tendons": [[0.02, 0.0, 0.05], [0.3, 0.0, 0.6]],
}
SCENES = {
    "payload": Scene(Extension(), TipLoad((0.0, 0.0, -1e-3))),
    "water": with_effects(STATICS["paper"], *IN_WATER),
    "silicone in water": with_effects(STATICS["silicone"], *IN_WATER),
}
# Locked tendons pull and push alike as long as none of them is slack.
MOST, LEAST = 5.0, 0.01
ALONG = tuple((np.array([1.0, 2.0, 0.5]) / np.linalg.norm([1.0, 2.0, 0.5])).tolist())
Case = tuple[str, str, Any]


@cache
def place(arm: str, scene: str) -> TipPosition:
    """Return the tip under moderate tensions."""
    tip = settle(ARMS[arm], PULLS[arm], SCENES[scene], 1e-10).tip
    return TipPosition(tuple(tip.tolist()))


@cache
def least(arm: str, scene: str) -> Plan:
    """The plan of least effort for that place."""
    return plan(ARMS[arm], place(arm, scene), SCENES[scene], MOST, limits=Limits(tension_min=LEAST))


def stretchy(hold: Any) -> float | None:
    """Return the axial stiffness of tendons with constant lengths [N]."""
    return TENDON_EA if hold == "length" else None


def stiff(found: Plan, hold: Any, accuracy: float = 1e-8) -> float:
    """The stiffness of a planned tip along the direction [N/m]."""
    k = stiffness(
        found.arm, found.tensions, found.scene, hold, accuracy=accuracy, tendon_EA=stretchy(hold)
    )
    return float(1 / (ALONG @ k.compliance[:3, :3] @ ALONG))


def give_of_settled_shapes(found: Plan, hold: Any) -> float:
    """Displacement along the direction per newton, by central differences of settled shapes."""
    arm, T, scene = found.arm, np.ravel(found.tensions), found.scene
    start = settle(arm, T, scene, 1e-11)
    k = stiffness(arm, T, scene, hold, tendon_EA=stretchy(hold))
    force = np.array(ALONG) * STEP * arm.length / np.linalg.norm(k.compliance[:3, :3] @ ALONG)

    def at(share: float) -> Array:
        wrench = share * np.concatenate([force, np.zeros(3)])
        there = pushed(scene, wrench)
        if hold == "tension":
            return moved(start, settle(arm, T, there, 1e-11), arm.length)
        hint = k.tension_response @ wrench
        shape, _ = with_lengths_held(start, there, k.length_tension, hint)
        return moved(start, shape, arm.length)

    shift = fourth_order(at, 1.0)[:3] * arm.length
    return float(shift @ ALONG / np.linalg.norm(force))


CASES: list[Case] = [
    ("table-4", "payload", "tension"),
    ("six tendons", "water", "tension"),
    ("six tendons", "payload", "length"),
]
LARGER: list[Case] = [
    ("six tendons", "water", "length"),
    ("six tendons", "silicone in water", "tension"),
    ("six tendons", "silicone in water", "length"),
    ("table-4", "water", "tension"),
    ("table-4", "payload", "length"),
    ("table-4", "water", "length"),
    ("table-4", "silicone in water", "tension"),
]


@pytest.mark.quick("six tendons-payload-length")
@pytest.mark.parametrize(
    ("arm", "scene", "hold"),
    [*CASES, *(pytest.param(*case, marks=pytest.mark.slow) for case in LARGER)],
)
def test_the_stiffness_that_was_asked_for_is_had_at_the_place(
    arm: str, scene: str, hold: Any
) -> None:
    before = least(arm, scene)
    wanted = 1.1 * stiff(before, hold)
    target = MinimumStiffness(ALONG, wanted, hold, stretchy(hold))
    targets = [place(arm, scene), target]
    found = plan(
        ARMS[arm], targets, SCENES[scene], MOST, limits=Limits(tension_min=LEAST), accuracy=1e-8
    )
    assert found.certificate.passed, found.outcome
    assert found.outcome.startswith("Reached")
    tip = collocated(found.arm, found.tensions, found.scene, 2, 64).tip
    assert np.linalg.norm(tip - place(arm, scene).position) < 1e-6 * found.arm.length
    # The plan has no more stiffness than requested, because stiffness costs effort.
    assert stiff(found, hold, 1e-9) == pytest.approx(wanted, rel=1e-6)
    assert 1 / give_of_settled_shapes(found, hold) == pytest.approx(wanted, rel=2e-6)
    assert found.effort > before.effort
    # To the accuracy asked.
    assert found.certificate.kkt < 1e-8


def others(found: Plan, seed: int) -> Array:
    """Other tensions within the limits that hold the tip at the same place, or nearly."""
    arm, rng = found.arm, np.random.default_rng(seed)
    tip, T = found.shape.tip, np.ravel(found.tensions)
    turn = rng.normal(size=T.size) * rng.uniform(0.01, 0.2)
    T = T + np.where(T > LEAST, np.where(T < MOST, turn, -np.abs(turn)), np.abs(turn))
    for _ in range(10):
        T = np.clip(T, LEAST, MOST)
        k = stiffness(arm, T, found.scene, accuracy=1e-5)
        free = (T > LEAST) & (T < MOST)
        T[free] += np.linalg.pinv(k.pose_tension[:3, free]) @ (tip - k.shape.tip)
    return np.clip(T, LEAST, MOST)


@pytest.mark.parametrize(
    ("arm", "scene"),
    [
        pytest.param("table-4", "payload", marks=pytest.mark.slow),
        pytest.param("table-4", "water", marks=pytest.mark.slow),
    ],
)
def test_nothing_is_stiffer_than_the_stiffest_at_the_place_or_softer_than_the_softest(
    arm: str, scene: str
) -> None:
    before = stiff(least(arm, scene), "tension")
    targets = (Stiffest(ALONG), Softest(ALONG))
    where = place(arm, scene)
    plans = [
        plan(ARMS[arm], [where, t], SCENES[scene], MOST, limits=Limits(tension_min=LEAST))
        for t in targets
    ]
    for found in plans:
        assert found.certificate.passed, found.outcome
        assert found.tensions.max() <= MOST
    most, soft = (stiff(found, "tension") for found in plans)
    assert most > before > soft
    tried = 0
    for seed in range(6):
        for found in plans:
            T = others(found, seed)
            k = stiffness(found.arm, T, found.scene)
            if np.linalg.norm(k.shape.tip - found.shape.tip) < 1e-5 * found.arm.length:
                here = float(1 / (ALONG @ k.compliance[:3, :3] @ ALONG))
                assert soft * (1 - 1e-4) < here < most * (1 + 1e-4)
                tried += 1
    assert tried >= 4
