"""Targets of every kind are met, with and without loads, as shapes settled anew tell."""

from __future__ import annotations

import pickle
from typing import Any

import casadi as ca
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
from planner.io.saved_files import load_plan
from planner.io.scene_file import read
from planner.targets import Backbone, BendingPlane, Fetch, TipPointing, TipPose, TipPosition
from planner.targets.base import View
from tests.planner.cases import (
    PAPER,
    Array,
    barrel_arm,
    bend_and_plane,
    figure_15,
    moderate,
    paper_tip,
)

ARM = Arm.from_paper("table-4")


@pytest.mark.parametrize("tensions", [moderate(), figure_15()], ids=["moderate", "figure 15"])
def test_the_tip_of_a_settled_shape_is_reached_with_no_more_effort(tensions: np.ndarray) -> None:
    point = paper_tip(ARM, tensions)
    found = plan(ARM, TipPosition(point), PAPER, 20.0)
    again = settle(ARM, found.tensions, PAPER, 1e-10, scheme="gauss6")
    assert found.certificate.passed
    assert np.linalg.norm(again.tip - point) < 1e-6 * ARM.length
    assert found.effort <= np.linalg.norm(tensions) * (1 + 1e-9)


@pytest.mark.quick("moderate")
@pytest.mark.parametrize("tensions", [moderate(), figure_15()], ids=["moderate", "figure 15"])
def test_a_pose_is_reached_in_place_and_turn(tensions: np.ndarray) -> None:
    shape = settle(ARM, tensions, PAPER, 1e-9)
    found = plan(ARM, TipPose(shape.tip, shape.tip_frame), PAPER, 20.0)
    assert found.certificate.passed
    assert np.linalg.norm(found.shape.tip - shape.tip) < 1e-6 * ARM.length
    assert np.abs(found.shape.tip_frame - shape.tip_frame).max() < 1e-6


@pytest.mark.quick("1-30", "2-150", "3-90")
@pytest.mark.parametrize(
    ("section", "bend"),
    # Section 3 cannot bend by 150 degrees in all planes: with extension it is crushed first.
    [(1, 30), (1, 90), (1, 150), (2, 30), (2, 90), (2, 150), (3, 30), (3, 90)],
)
def test_a_plane_and_bend_are_hit_by_neighbouring_tendons(section: int, bend: int) -> None:
    arm = Arm.from_paper("table-2")
    for angle in np.radians([-160, -45, 0, 20, 101]):
        found = plan(arm, BendingPlane(angle, np.radians(bend), section), PAPER, 60.0)
        assert found.certificate.passed, found.outcome
        measured_bend, plane = bend_and_plane(arm, found.shape)
        assert np.degrees(abs(measured_bend - np.radians(bend))) < 1e-4
        assert np.degrees(abs(np.angle(np.exp(1j * (plane - angle))))) < 1e-4
        own = found.tensions[section - 1]
        assert found.tensions.sum() == own.sum()
        assert own[0] * own[2] == 0
        assert own[1] * own[3] == 0


def test_three_prescribed_bends_are_made_between_the_anchorages() -> None:
    bends = np.radians([[60, 90], [50, -90], [70, 30]])
    found = plan(ARM, Fetch(*bends), PAPER, 20.0)
    assert found.certificate.passed
    frames = found.shape.frame(np.array([0, 0.135, 0.315, 0.45]))
    for (angle, plane), start, end in zip(bends, frames[:-1], frames[1:], strict=True):
        t, n, b = start.T @ end[:, 0]
        assert np.isclose(t, np.cos(angle), atol=1e-6)
        assert np.isclose(b, np.sin(angle) * np.cos(plane), atol=1e-6)
        assert np.isclose(n, -np.sin(angle) * np.sin(plane), atol=1e-6)


@pytest.mark.quick("in a plane")
@pytest.mark.parametrize("plane", [None, np.radians(90)], ids=["in space", "in a plane"])
def test_a_fetch_reaches_the_mouth_through_three_bends(plane: float | None) -> None:
    mouth = (0.05, 0.05, 0.0)
    found = plan(ARM, Fetch.reach(mouth, np.radians(40), plane), PAPER, 13.0)
    assert found.certificate.passed
    assert np.linalg.norm(found.shape.tip - mouth) < 1e-6 * ARM.length
    tangents = found.shape.frame(np.array([0, 0.135, 0.315, 0.45]))[:, :, 0]
    bends = np.arccos(np.sum(tangents[:-1] * tangents[1:], axis=1))
    assert bends.min() > np.radians(40) - 1e-6
    if plane is not None:
        assert np.abs(found.shape.position(np.array([0.135, 0.315, 0.45]))[:, 2]).max() < 1e-9


def test_a_backbone_that_the_arm_can_take_is_followed() -> None:
    s = np.linspace(0.1, 1.0, 8) * ARM.length
    shape = settle(ARM, moderate(), PAPER, 1e-9)
    found = plan(ARM, Backbone(shape.position(s), s=tuple(s)), PAPER, 20.0)
    assert found.certificate.passed
    assert np.abs(found.shape.position(s) - shape.position(s)).max() < 1e-5 * ARM.length


def test_weights_move_a_backbone_towards_the_points_that_weigh_more() -> None:
    points = ((0.1, 0.05, 0.0), (0.2, 0.15, 0.0), (0.3, -0.1, 0.0), (0.2, 0.0, 0.2))
    s = (0.1, 0.2, 0.3, 0.45)
    gaps = []
    for weight in (1.0, 50.0):
        target = Backbone(points, s, (1.0, 1.0, 1.0, weight))
        gaps.append(np.linalg.norm(plan(ARM, target, PAPER, 20.0, starts=3).shape.tip - points[-1]))
    assert gaps[1] < gaps[0]


def test_targets_combine() -> None:
    shape = settle(ARM, moderate(), PAPER, 1e-9)
    through = Backbone((tuple(shape.position(0.2)),), (0.2,))
    found = plan(ARM, [TipPosition(tuple(shape.tip)), through], PAPER, 20.0)
    assert found.certificate.passed
    assert np.linalg.norm(found.shape.tip - shape.tip) < 1e-6 * ARM.length
    assert np.linalg.norm(found.shape.position(0.2) - shape.position(0.2)) < 1e-6 * ARM.length


@pytest.mark.slow
def test_an_arm_of_five_sections_of_three_tendons_on_a_barrel_is_planned_and_certified() -> None:
    arm = barrel_arm()
    rng = np.random.default_rng(2)
    point = settle(arm, rng.uniform(0, 1.5, arm.n_tendons), PAPER, 1e-9).tip
    for target in (TipPosition(tuple(point)), Fetch.reach((0.1, 0.1, 0.05), np.radians(20))):
        found = plan(arm, target, PAPER, 10.0)
        assert found.certificate.passed, found.outcome
    assert found.tensions.shape == (5, 3)


TURNED = np.array([[0, 0, 0.4, 0.1], [1.5, 0, 0, 0], [0, 3.0, 0, 0]])


def _unit(rng: np.random.Generator) -> Any:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def _frame(rng: np.random.Generator) -> Any:
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return Q * np.sign(np.linalg.det(Q))


def _terms(target: Any) -> ca.Function:
    pose = ca.MX.sym("pose", 7)
    p = ca.MX.sym("p", target.parameters(ARM).size)
    own = target.terms(View(ARM, {ARM.length: pose}), p).equality
    return ca.Function("terms", [pose, p], list(own.values()))


def _quaternion(frame: Any) -> Any:
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(frame).as_quat(), 1)


@pytest.mark.parametrize("seed", range(6))
def test_residuals_are_the_chord_of_the_angle_between_directions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    wanted, frame, place, tip = _unit(rng), _frame(rng), rng.normal(size=3), rng.normal(size=3)
    target = TipPointing(tuple(place), tuple(7.0 * wanted))
    pose = np.concatenate([_quaternion(frame), tip])
    off, turned = (np.array(x).ravel() for x in _terms(target)(pose, target.parameters(ARM)))
    assert off == pytest.approx((tip - place) / ARM.length)
    angle = np.arccos(np.clip(frame[:, 0] @ wanted, -1, 1))
    assert np.linalg.norm(turned) == pytest.approx(2 * np.sin(angle / 2), rel=1e-9)


OPPOSITE = [
    TipPointing((0.45, 0.0, 0.0), (-1.0, 0.0, 0.0)),
    TipPose((0.45, 0.0, 0.0), ((-1, 0, 0), (0, -1, 0), (0, 0, 1))),
    TipPose((0.45, 0.0, 0.0), ((1, 0, 0), (0, 1, 0), (0, 0, 1))),
]


@pytest.mark.parametrize("target", OPPOSITE)
def test_the_opposite_orientation_is_not_taken_for_the_one_that_is_wanted(target: Any) -> None:
    straight = settle(ARM, np.zeros(12), PAPER)
    pose = straight.poses(ARM.length)
    off = np.array(_terms(target)(pose, target.parameters(ARM))[1])
    assert np.linalg.norm(off) == pytest.approx(2.0)


@pytest.mark.parametrize("seed", range(6))
def test_a_pose_s_residual_is_the_chord_of_the_angle_between_frames(seed: int) -> None:
    rng = np.random.default_rng(seed)
    wanted, frame = _frame(rng), _frame(rng)
    target = TipPose((0.0, 0.0, 0.0), tuple(map(tuple, wanted)))
    pose = np.concatenate([_quaternion(frame), np.zeros(3)])
    off = np.array(_terms(target)(pose, target.parameters(ARM))[1]).ravel()
    angle = np.arccos(np.clip((np.trace(wanted.T @ frame) - 1) / 2, -1, 1))
    assert np.linalg.norm(off) == pytest.approx(2 * np.sin(angle / 2), rel=1e-9)
    twice = np.array(_terms(target)(np.append(3 * pose[:4], pose[4:]), target.parameters(ARM))[1])
    assert twice.ravel() == pytest.approx(off)


@pytest.mark.quick("in water")
@pytest.mark.parametrize(
    "scene", [PAPER, Scene(Extension(), Weight(), Buoyancy())], ids=["paper", "in water"]
)
def test_the_tip_points_where_it_is_asked_to_and_rolls_as_it_likes(scene: Scene) -> None:
    shape = settle(ARM, TURNED, scene)
    target = TipPointing(tuple(shape.tip), tuple(shape.tip_frame[:, 0]))
    found = plan(ARM, target, scene, 20.0)
    assert found.reached, found.outcome
    assert found.shape.tip == pytest.approx(shape.tip, abs=1e-6 * ARM.length)
    assert found.shape.tip_frame[:, 0] == pytest.approx(shape.tip_frame[:, 0], abs=2e-6)
    assert set(found.certificate.equality) == {"tip position", "tip direction"}
    assert "tip direction [rad]" in str(found.certificate)
    posed = plan(ARM, TipPose(tuple(shape.tip), shape.tip_frame), scene, 20.0)
    assert found.effort <= posed.effort * (1 + 1e-6)


@pytest.mark.parametrize("kind", ["pose", "pointing"])
def test_weights_choose_what_comes_nearer_where_both_cannot_be_had(kind: str) -> None:
    far = (0.5, 0.0, 0.0)
    frame = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))
    name = {"pose": "tip rotation", "pointing": "tip direction"}[kind]
    places, angles = [], []
    for weights in ((1.0, 1e-2), (1.0, 1.0)):
        target = (
            TipPose(far, frame, weights)
            if kind == "pose"
            else TipPointing(far, (0.0, 0.0, -1.0), weights)
        )
        found = plan(ARM, target, PAPER, 20.0, starts=1)
        assert not found.reached
        places.append(found.certificate.equality["tip position"])
        angles.append(found.certificate.equality[name])
    assert places[0] < 0.9 * places[1]
    assert angles[1] < 0.3 * angles[0]


def test_scene_files_have_them_and_plans_are_saved(tmp_path: Any) -> None:
    text = b"""
    [arm]
    preset = "table-4"
    [effects]
    extension = true
    [target]
    type = "tip-pointing"
    position_mm = [350, 100, -50]
    direction = [1, 0, -2]
    weights = [2, 1]
    [limits]
    tension_max = 20
    """
    asked = read(text)
    size = np.sqrt(5)
    (target,) = asked.targets
    assert isinstance(target, TipPointing)
    assert target.position == pytest.approx((0.35, 0.1, -0.05))
    assert target.direction == pytest.approx((1 / size, 0, -2 / size))
    assert target.weights == (2.0, 1.0)
    found = plan(asked.arm, target, asked.scene, **asked.options)
    assert load_plan(found.save(tmp_path / "p.json")) == found
    figure = found.plot()
    assert any("direction wanted" in str(own.get_label()) for own in _artists(figure))


def _artists(figure: Any) -> list[Any]:
    return [artist for ax in figure.axes for artist in ax.get_children()]


def test_derivatives_are_exact() -> None:
    rng = np.random.default_rng(3)
    target = TipPointing((0.1, 0.2, 0.3), tuple(_unit(rng)))
    function, p = _terms(target), target.parameters(ARM)
    x, symbol = np.concatenate([_quaternion(_frame(rng)), rng.normal(size=3)]), ca.MX.sym("x", 7)
    r = ca.vertcat(*function(symbol, p))
    J = np.array(ca.Function("J", [symbol], [ca.jacobian(r, symbol)])(x))
    values = ca.Function("r", [symbol], [r])
    steps = 1e-6 * np.eye(7)
    by_steps = [np.array(values(x + h) - values(x - h)).ravel() / 2e-6 for h in steps]
    assert pytest.approx(np.array(by_steps).T, abs=1e-8) == J


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


def random_pulls(seed: int) -> Array:
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
    check_tip(ARM, SCENES[name], random_pulls(1))


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
    check_tip(ARM, scene, random_pulls(seed))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *range(2, 8)])
@pytest.mark.parametrize("name", SCENES)
def test_many_tips_are_reached(name: str, seed: int) -> None:
    check_tip(ARM, SCENES[name], random_pulls(seed))


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
    target = TipPosition(tuple(settle(ARM, random_pulls(1), scene, 1e-9).tip))
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
        tip = settle(ARM, random_pulls(seed), SCENES[name], 1e-5).tip
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
    target = TipPosition(tuple(settle(ARM, random_pulls(1), IN_WATER, 1e-9).tip))
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
