"""Plans that keep a shape and are as stiff, or as soft, as was asked."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import Extension
from octoplan.planner import Plan, plan, stiffness
from octoplan.planner.targets import MinimumStiffness, Softest, Stiffest, TipPosition
from octoplan.planner.targets.target_set import TargetSet
from tests.core.stiffness.cases import STATICS, Array

ARM, MOST = Arm.from_paper("table-2"), 10.0
POINT = (0.18, 0.12, 0.06)
PLACE, ALONG = TipPosition(POINT), (1.0, 0.0, 0.0)
KEPT = 1e-6 * ARM.length


@cache
def least(scene: str) -> Plan:
    """The plan of least effort for the tip at a place well within reach."""
    return plan(ARM, PLACE, STATICS[scene], MOST, starts=5)


def stiff(found: Plan, hold: Any = "tension", along: Any = ALONG) -> float:
    """The stiffness of a planned tip along a direction [N/m], all tendons locked or none."""
    at = found.arm, found.tensions, found.scene, hold
    C = stiffness(*at, accuracy=1e-8, release=False).compliance
    return float(1 / (np.array(along) @ C[:3, :3] @ along))


def off(found: Plan) -> float:
    """Return the distance of the tip from the place [m]."""
    return float(np.linalg.norm(settle(found.arm, found.tensions, found.scene, 1e-10).tip - POINT))


def bound(found: Plan) -> Array:
    """The symmetric part of the stiffness against forces (3, 3) of a planned shape [N/m]."""
    C = stiffness(ARM, found.tensions, found.scene, accuracy=1e-8).compliance[:3, :3]
    return np.asarray(np.linalg.inv((C + C.T) / 2))


@pytest.mark.quick("paper-1.5")
@pytest.mark.parametrize(
    ("scene", "factor"),
    [
        pytest.param("paper", 1.2, marks=pytest.mark.slow),
        ("paper", 1.5),
        pytest.param("exact", 1.2, marks=pytest.mark.slow),
        ("exact", 1.5),
    ],
)
def test_the_tip_stays_and_stiffens_at_the_cost_of_effort(scene: str, factor: float) -> None:
    wanted = factor * stiff(least(scene))
    target = MinimumStiffness(ALONG, wanted)
    found = plan(ARM, [PLACE, target], STATICS[scene], MOST, starts=2)
    assert found.certificate.passed, found.outcome
    assert off(found) < KEPT
    # Effort grows with stiffness, so that the plan has no more stiffness than requested.
    assert stiff(found) == pytest.approx(wanted, rel=1e-5)
    assert abs(next(iter(found.certificate.inequality.values()))) < 1e-5
    assert found.effort > least(scene).effort * (1 + 1e-4)


@pytest.mark.slow
def test_a_matrix_is_a_lower_bound_in_all_directions() -> None:
    M = bound(least("paper").co_contract(0.3))
    found = plan(
        ARM,
        [PLACE, MinimumStiffness(M, 0.98)],
        STATICS["paper"],
        MOST,
        starts=2,
    )
    assert found.certificate.passed, found.outcome
    assert off(found) < KEPT
    root = np.linalg.inv(np.linalg.cholesky(M))
    shares = np.linalg.eigvalsh(root @ bound(found) @ root.T)
    assert shares[0] > 0.98 * (1 - 1e-5)


@pytest.mark.slow
def test_the_stiffest_is_stiffer_than_any_asked_and_the_softest_softer_than_the_least() -> None:
    scene, most_pull = STATICS["paper"], 4.0
    stiffest = plan(ARM, [PLACE, Stiffest(ALONG)], scene, most_pull, starts=3)
    softest = plan(ARM, [PLACE, Softest(ALONG)], scene, most_pull, starts=3)
    for found in (stiffest, softest):
        assert found.certificate.passed, found.outcome
        assert off(found) < KEPT
    assert stiff(softest) <= stiff(least("paper")) * (1 + 1e-6)
    most = stiff(stiffest)
    assert most > 1.05 * stiff(least("paper"))
    target = MinimumStiffness(ALONG, 0.99 * most)
    below = plan(ARM, [PLACE, target], scene, most_pull, starts=2)
    assert stiff(below) <= most * (1 + 1e-5)
    assert below.certificate.passed, below.outcome
    assert below.effort <= stiffest.effort * (1 + 1e-6)


@pytest.mark.slow
def test_an_impossible_stiffness_is_not_reached_and_the_outcome_says_by_how_much() -> None:
    wanted = 50 * stiff(least("paper"))
    target = MinimumStiffness(ALONG, wanted)
    found = plan(ARM, [PLACE, target], STATICS["paper"], 1.0)
    assert not found.reached
    assert found.outcome.startswith("Not reached")
    lack = min(found.certificate.inequality.values())
    assert lack == pytest.approx(stiff(found) / wanted - 1, rel=1e-4)
    assert f"({1 + lack:.4g} times the required value)" in found.outcome
    stiffest = plan(ARM, [PLACE, Stiffest(ALONG)], STATICS["paper"], 1.0, starts=3)
    # Stiffness may cost no more than the accuracy of a place that is out of reach.
    off, nearest = (np.linalg.norm(p.shape.tip - PLACE.position) for p in (found, stiffest))
    assert 0 <= off - nearest < 1e-6
    assert stiff(found) == pytest.approx(stiff(stiffest), rel=1e-3)


@pytest.mark.parametrize("kind", ["softest", "vector", "matrix"])
def test_lengths_held_lock_all_tendons_and_the_outcome_tells_it_with_slack_released(
    kind: str,
) -> None:
    targets: dict[str, Any] = {
        "softest": Softest(ALONG, hold="length", tendon_EA=1e3),
        "vector": MinimumStiffness(ALONG, 1.0, "length", 1e3),
        "matrix": MinimumStiffness(np.diag([0.1, 0.2, 0.15]), 1.0, "length", 1e3),
    }
    target = targets[kind]
    found = plan(ARM, [PLACE, target], STATICS["paper"], MOST, starts=1)
    assert found.certificate.passed, found.outcome
    numbers = []
    for release in (False, True):
        k = stiffness(
            ARM,
            found.tensions,
            found.scene,
            "length",
            tendon_EA=1e3,
            accuracy=1e-8,
            release=release,
        )
        C = k.compliance[:3, :3]
        C = (C + C.T) / 2
        if kind == "matrix":
            numbers.append(1 / np.linalg.eigvals(C @ np.array(target.direction)).real.max())
        else:
            along = np.array(target.direction)
            numbers.append(1 / (along @ C @ along) / getattr(target, "value", 1.0))
    assert k.slack
    assert numbers[1] < numbers[0] * (1 - 1e-4)
    unit = "N/m" if kind == "softest" else "times the required value"
    assert f"{numbers[0]:.4g} {unit} locked, {numbers[1]:.4g} released" in found.outcome
    assert all(name in found.outcome for name in k.slack)
    if kind == "vector":
        [share] = found.certificate.inequality.values()
        assert share == pytest.approx(numbers[0] - 1, rel=1e-5)
    held = plan(ARM, PLACE, STATICS["paper"], MOST, starts=1)
    assert "locked" not in held.outcome


@pytest.mark.quick("paper")
@pytest.mark.parametrize("scene", ["paper", "silicone"])
def test_co_contraction_keeps_the_tip_and_stiffens(scene: str) -> None:
    before = least(scene)
    levels = [before, before.co_contract(0.3), before.co_contract(0.8)]
    for level, found in zip((0.3, 0.8), levels[1:], strict=True):
        assert found.certificate.passed, found.outcome
        assert found.tensions.min() >= level
        assert off(found) < KEPT
    found_stiff = [stiff(found) for found in levels]
    assert np.all(np.diff(found_stiff) > 0)


def test_a_stiffness_that_is_infinite_at_the_optimum_is_met() -> None:
    """A straight arm with locked tendons has no axial compliance; the plan took minutes."""
    axial = MinimumStiffness((1.0, 0.0, 0.0), 0.1, "length")
    found = plan(Arm.from_paper("table-2"), axial, Scene(Extension()), 20.0, starts=1)
    assert found.reached
    assert found.effort < 1e-6


THREE = replace(ARM, sections=tuple(replace(s, angles=(0.0, 2.0, 4.0)) for s in ARM.sections))


@pytest.mark.parametrize(
    "spare",
    [(0.1, 0.2, 0.3), (-0.1, 0.2, 0.3), (0.1, -0.2, -0.3), (0.0, -0.2, -0.1), (0.1, 0.0, -0.2)],
    ids=str,
)
def test_a_matrix_that_is_not_attained_leaves_a_margin_below_0(spare: tuple[float, ...]) -> None:
    # The bound M whose root r has r C r = 1 - diag(spare): attained if spare is 0 or above.
    shape = least("paper").shape
    values, vectors = np.linalg.eigh(np.linalg.inv(bound(least("paper"))))
    half, back = ((vectors * values**power) @ vectors.T for power in (0.5, -0.5))
    inner, turn = np.linalg.eigh(half @ np.diag(1 - np.array(spare)) @ half)
    root = back @ (turn * np.sqrt(inner)) @ turn.T @ back
    targets = (MinimumStiffness(root @ root, 1.0),)
    together = TargetSet(ARM, targets)
    poses = shape.poses(np.array(together.stations))
    margin = together.values(poses, together.compliances(shape))[2]
    least_margin = min(float(np.min(rows)) for rows in margin.values())
    assert (least_margin < -1e-3) == (min(spare) < 0)


@pytest.mark.slow
@pytest.mark.parametrize("arm", [THREE, ARM], ids=["three tendons", "four tendons"])
def test_locked_lengths_are_planned_stiffer_too(arm: Arm) -> None:
    scene = STATICS["exact"]
    start = plan(arm, PLACE, scene, MOST, starts=2)
    wanted = 1.1 * stiff(start, "length")
    target = MinimumStiffness(ALONG, wanted, "length")
    found = plan(arm, [PLACE, target], scene, MOST, starts=2)
    assert found.certificate.passed, found.outcome
    assert off(found) < KEPT
    assert stiff(found, "length") >= wanted * (1 - 1e-5)
