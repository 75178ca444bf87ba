"""Where the tip points, and what counts where position and orientation cannot both be had."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from model import Arm, Scene, settle
from model.effects import Buoyancy, Extension, Weight
from planner import plan
from planner.io.saved_files import load_plan
from planner.io.scene_file import read
from planner.targets import TipPointing, TipPose
from planner.targets.base import View

ARM = Arm.from_paper("table-4")
PAPER = Scene(Extension())
T = np.array([[0, 0, 0.4, 0.1], [1.5, 0, 0, 0], [0, 3.0, 0, 0]])


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
    shape = settle(ARM, T, scene)
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
