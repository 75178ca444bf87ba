"""Plans of arms under loads: targets met, measured by settling again."""

from __future__ import annotations

import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import (
    Buoyancy,
    Current,
    Effect,
    ExactTendons,
    Extension,
    Friction,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from planner import Plan, plan
from planner.targets import BendingPlane, Fetch, TipPosition
from tests.planner.cases import Array, bend_and_plane

ARM = Arm.from_paper("table-4")
ONE_SECTION = Arm.from_paper("section-5.2")
MAXIMUM = 20.0
WATER: tuple[Effect, ...] = (Weight(), Buoyancy())
IN_WATER = Scene(Extension(), *WATER)
SCENES: dict[str, Scene] = {
    "in water": IN_WATER,
    "bending, in water": Scene(*WATER),
    "payload": Scene(Extension(), TipLoad((0.0, 0.0, -1e-3))),
    "payload in water": Scene(Extension(), *WATER, TipLoad((0.0, 0.0, -5e-4), (0.0, 2e-5, 0.0))),
    "follower": Scene(Extension(), TipLoad((0.0, 1e-3, 0.0), follower=True)),
    "current": Scene(Extension(), Current((0.0, 0.0, -0.05))),
    "point load": Scene(Extension(), PointLoad(0.225, (0.0, 0.0, -5e-3))),
    "shear": Scene(Extension(), Shear()),
}
SILICONE_IN_WATER = Scene(*Scene.silicone().effects, *WATER)
ROUGH = Scene(Extension(), Friction(0.1))
SLOW = {
    "exact, in water": (Scene(Extension(), ExactTendons(), *WATER), 0),
    "silicone, in water": (SILICONE_IN_WATER, 0),
    "silicone, in water, another": (SILICONE_IN_WATER, 1),
    "friction": (ROUGH, 0),
    "friction, another": (ROUGH, 1),
    "friction, paying out, in water": (Scene(Extension(), *WATER, Friction(0.2, -1)), 2),
    "all at once": (
        Scene(
            *IN_WATER.effects,
            TipLoad((0.0, 0.0, -5e-4)),
            PointLoad(0.2, (0.0, 1e-3, 0.0)),
            Current((0.0, 0.03, 0.0)),
            Shear(),
        ),
        3,
    ),
}


def drawn(seed: int) -> Array:
    """Random tensions that bend every section of table 4 some way [N]; half of them are slack."""
    rng = np.random.default_rng(seed)
    pulls = rng.uniform(size=(3, 4)) * (rng.uniform(size=(3, 4)) < 0.5)
    return pulls * [[0.08], [1.0], [2.0]]


def check_tip(arm: Arm, scene: Scene, tensions: Array) -> Plan:
    """Plan for the tip of settled tensions; hold the plan to what it promises."""
    point = settle(arm, tensions, scene, 1e-9).tip
    found = plan(arm, TipPosition(tuple(point)), scene, MAXIMUM)
    assert found.certificate.passed, found.outcome
    assert found.reached and found.outcome.startswith("Reached")
    assert found.statement.solver == "ipopt" and found.statement.iterations > 0
    again = settle(arm, found.tensions, scene, 1e-9, scheme="gauss4")
    assert np.linalg.norm(again.tip - point) < 1e-6 * arm.length
    assert found.tensions.min() >= 0
    assert found.tensions.max() <= MAXIMUM
    assert found.effort == pytest.approx(np.linalg.norm(found.tensions), rel=1e-12)
    assert found.effort <= np.linalg.norm(tensions) * (1 + 1e-6)
    return found


@pytest.mark.quick("in water", "payload in water", "point load")
@pytest.mark.parametrize("name", SCENES)
def test_the_tip_of_an_arm_settled_under_loads_is_reached_with_no_more_effort(name: str) -> None:
    check_tip(ARM, SCENES[name], drawn(1))


@pytest.mark.quick("silicone")
@pytest.mark.parametrize(
    "scene",
    [SILICONE_IN_WATER, Scene(*IN_WATER.effects, Friction(0.1, (1, -1, -1, 1)))],
    ids=["silicone", "friction"],
)
def test_a_section_in_water_is_planned(scene: Scene) -> None:
    check_tip(ONE_SECTION, scene, np.array([[0.3, 0.2, 0.0, 0.1]]))


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "seed"), SLOW.values(), ids=SLOW)
def test_scenes_that_take_longer_are_planned(scene: Scene, seed: int) -> None:
    check_tip(ARM, scene, drawn(seed))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *range(2, 8)])
@pytest.mark.parametrize("name", SCENES)
def test_many_tips_are_reached(name: str, seed: int) -> None:
    check_tip(ARM, SCENES[name], drawn(seed))


@pytest.mark.quick("2")
@pytest.mark.parametrize("section", [1, 2, 3])
def test_a_plane_and_bend_in_water_are_hit(section: int) -> None:
    angle, bend = 0.4, 1.0
    arm = Arm.from_paper("table-2")
    found = plan(arm, BendingPlane(angle, bend, section), IN_WATER, 60.0)
    assert found.certificate.passed, found.outcome
    again = settle(arm, found.tensions, IN_WATER, 1e-9, scheme="gauss4")
    assert bend_and_plane(arm, again) == pytest.approx((bend, angle), abs=2e-6)
    assert found.tensions.sum() == found.tensions[section - 1].sum()


def test_a_fetch_in_water_reaches_the_mouth_through_three_bends() -> None:
    mouth, least = (0.05, 0.05, 0.0), np.radians(30)
    found = plan(ARM, Fetch.reach(mouth, least), IN_WATER, MAXIMUM)
    assert found.certificate.passed, found.outcome
    again = settle(ARM, found.tensions, IN_WATER, 1e-9, scheme="gauss4")
    assert np.linalg.norm(again.tip - mouth) < 1e-6 * ARM.length
    tangents = again.frame(np.array([0, 0.135, 0.315, 0.45]))[:, :, 0]
    assert np.arccos(np.sum(tangents[:-1] * tangents[1:], axis=1)).min() > least - 1e-6


def test_limits_norms_and_minima_are_kept_under_loads() -> None:
    scene, arm = SCENES["payload in water"], ONE_SECTION
    target = TipPosition(tuple(settle(arm, [0.5, 0.4, 0.1, 0.2], scene, 1e-9).tip))
    plans = {norm: plan(arm, target, scene, MAXIMUM, norm=norm) for norm in ("2", "1", "inf")}
    tensions = {norm: found.tensions for norm, found in plans.items()}
    assert all(found.certificate.passed for found in plans.values())
    for norm, measure in {"2": np.linalg.norm, "1": np.sum, "inf": np.max}.items():
        least = measure(tensions[norm])
        assert all(least <= measure(T) * (1 + 1e-6) for T in tensions.values())
    held = plan(arm, target, scene, MAXIMUM, tension_min=0.02)
    assert held.certificate.passed, held.outcome
    assert held.tensions.min() >= 0.02
    assert held.effort >= plans["2"].effort * (1 - 1e-9)


@pytest.mark.slow
def test_a_total_pull_is_kept_under_loads_and_costs_effort() -> None:
    scene = SCENES["payload in water"]
    target = TipPosition(tuple(settle(ARM, drawn(1), scene, 1e-9).tip))
    free, least = (plan(ARM, target, scene, MAXIMUM, norm=norm) for norm in ("2", "1"))
    total = (free.tensions.sum() + least.tensions.sum()) / 2
    held = plan(ARM, target, scene, MAXIMUM, total_pull=total)
    assert held.certificate.passed, held.outcome
    assert held.tensions.sum() <= total * (1 + 1e-9)
    assert held.effort > free.effort


@pytest.mark.quick("in water")
@pytest.mark.parametrize("name", ["in water", "current"])
def test_a_point_beyond_the_arm_is_said_to_be_out_of_reach(name: str) -> None:
    found = plan(ARM, TipPosition((0.5, 0.0, 0.0)), SCENES[name], MAXIMUM, starts=2)
    assert not found.reached
    assert found.mode == "nearest"
    assert found.outcome.startswith("Not reached: the nearest attainable shape is off in tip")
    gap = np.linalg.norm(found.shape.tip - (0.5, 0.0, 0.0))
    assert gap >= 0.05
    off = np.abs(found.shape.tip - (0.5, 0.0, 0.0)).max() / ARM.length
    assert found.certificate.equality["tip position"] == pytest.approx(off, abs=1e-6)
    for seed in range(8):
        tip = settle(ARM, drawn(seed), SCENES[name], 1e-5).tip
        assert np.linalg.norm(tip - (0.5, 0.0, 0.0)) > gap - 1e-6
