"""Plans of arms under loads: targets met, measured by settling again."""

from __future__ import annotations

import pickle

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
from planner.targets import Backbone, BendingPlane, Fetch, TipPose, TipPosition
from tests.planner.cases import Array, barrel_arm, bend_and_plane, moderate

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


@pytest.mark.slow
def test_five_sections_of_three_tendons_on_a_barrel_are_planned_under_loads() -> None:
    arm = barrel_arm()
    pulls = np.random.default_rng(2).uniform(0, 1.5, arm.n_tendons)
    scene = Scene(Extension(), *WATER, TipLoad((0.0, 0.0, -0.01)), PointLoad(0.25, (0, 0.01, 0)))
    point = settle(arm, pulls, scene, 1e-9).tip
    found = plan(arm, TipPosition(tuple(point)), scene, 10.0)
    assert found.certificate.passed, found.outcome
    assert np.linalg.norm(found.shape.tip - point) < 1e-6 * arm.length
    assert found.effort <= np.linalg.norm(pulls) * (1 + 1e-6)


@pytest.mark.slow
def test_three_prescribed_bends_in_a_current_are_made() -> None:
    scene, bends = SCENES["current"], np.radians([[60, 90], [50, -90], [70, 30]])
    found = plan(ARM, Fetch(*bends), scene, MAXIMUM)
    assert found.certificate.passed, found.outcome
    frames = settle(ARM, found.tensions, scene, 1e-9).frame(np.array([0, 0.135, 0.315, 0.45]))
    for (angle, plane), start, end in zip(bends, frames[:-1], frames[1:], strict=True):
        way = [np.cos(angle), -np.sin(angle) * np.sin(plane), np.sin(angle) * np.cos(plane)]
        assert np.allclose(start.T @ end[:, 0], way, rtol=0, atol=2e-6)


@pytest.mark.slow
def test_a_pose_under_a_payload_is_reached() -> None:
    scene = SCENES["payload in water"]
    shape = settle(ARM, moderate(), scene, 1e-9)
    found = plan(ARM, TipPose(shape.tip, shape.tip_frame), scene, MAXIMUM)
    assert found.certificate.passed, found.outcome
    assert np.linalg.norm(found.shape.tip - shape.tip) < 1e-6 * ARM.length
    assert np.abs(found.shape.tip_frame - shape.tip_frame).max() < 2e-6


@pytest.mark.slow
def test_a_backbone_under_a_payload_is_followed() -> None:
    scene = SCENES["payload in water"]
    s = np.linspace(0.1, 1.0, 8) * ARM.length
    points = settle(ARM, moderate(), scene, 1e-9).position(s)
    found = plan(ARM, Backbone(tuple(map(tuple, points)), s=tuple(s)), scene, MAXIMUM)
    assert found.certificate.passed, found.outcome
    assert np.abs(found.shape.position(s) - points).max() < 1e-5 * ARM.length


def test_what_the_unloaded_plan_gives_under_the_load_is_told_by_its_certificate() -> None:
    target = TipPosition(tuple(settle(ARM, moderate(), Scene(Extension()), 1e-9).tip))
    unloaded = plan(ARM, target, Scene(Extension()), MAXIMUM)
    loaded = plan(ARM, target, SCENES["payload"], MAXIMUM)
    assert loaded.certificate.passed, loaded.outcome
    sagged = settle(ARM, unloaded.tensions, SCENES["payload"])
    assert np.linalg.norm(sagged.tip - unloaded.shape.tip) > 1e-3 * ARM.length


def test_the_same_question_under_loads_gives_the_same_digits_and_travels_by_pickle() -> None:
    target = TipPosition(tuple(settle(ARM, drawn(1), IN_WATER, 1e-9).tip))
    one, other = (plan(ARM, target, IN_WATER, MAXIMUM) for _ in range(2))
    assert np.array_equal(one.tensions, other.tensions)
    copy = pickle.loads(pickle.dumps(one))
    assert copy == one
    assert copy.certificate == one.certificate


@pytest.mark.slow
def test_a_maximum_that_holds_under_a_load_is_named() -> None:
    found = plan(ARM, TipPosition((0.25, 0.3, 0.0)), IN_WATER, 0.2)
    assert not found.certificate.passed
    assert found.outcome.startswith("Not reached")
    assert "at its maximum of 0.2 N" in found.outcome
    assert found.certificate.bounds == 0
