"""Tendons that rub in their sheaths, one in a plane: an initial value problem from the base."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from model import Anchorage, Arm, Linear, Scene, settle
from model.effects import Extension, Friction
from tests.effects.cases import Array

E, L = 110e3, 0.3
WAYS = pytest.mark.parametrize("way", [1, -1], ids=["in", "out"])


def one_tendon(radii: tuple[float, float], offsets: tuple[float, float], length: float = L) -> Arm:
    return Arm(length, Linear(*radii), (Anchorage(length, Linear(*offsets), (0.0,)),))


@WAYS
@pytest.mark.parametrize("mu", [0.05, 0.3, 1.0])
def test_a_tendon_loses_by_the_angle_that_the_arm_bends(mu: float, way: int) -> None:
    arm, T = one_tendon((0.01, 0.01), (5e-3, 5e-3)), 0.6
    shape = settle(arm, [T], Scene(Extension(), Friction(mu, way)), 1e-11)
    # With a constant offset the tendon is parallel to the midline.
    t = shape.frame(np.linspace(0, L, 40))[:, :, 0]
    theta = np.sum(np.arccos(np.sum(t[:-1] * t[1:], axis=1)))
    assert theta > 0.6
    assert shape.tension(0.0)[0] == pytest.approx(T, rel=1e-12)
    left = T * np.exp(-way * mu * theta)
    assert shape.tension(L)[0] == pytest.approx(left, rel=1e-9)


ARMS = {
    "uniform": ((0.01, 0.01), (5e-3, 5e-3), L),
    "conical body": ((0.012, 0.005), (4e-3, 4e-3), L),
    "conical": ((0.015, 0.0065), (7.5e-3, 1e-3), L),
    "widening tendon": ((0.012, 0.012), (1e-3, 9e-3), L),
    "steep": ((0.02, 0.004), (0.018, 0.002), 0.1),
}


def planar(name: str, T: float, mu: float, way: int, extension: bool) -> Array:
    """(x, y, angle of the tip, T there) of an arm with one tendon, from base to tip.

    With c = (1 - y k) t + y' n the tendon is at the angle psi = atan2(y', 1 - y k) to t and turns
    at the rate (1 + q) k + psi', where k' has a part in T'.
    """
    (R0, R1), (a, b), length = ARMS[name]
    taper, slope = (R1 - R0) / length, (b - a) / length

    def rate(s: float, state: Array) -> Array:
        _, _, angle, pull = state
        R, y = R0 + taper * s, a + slope * s
        EJ, EJ_rate = E * np.pi * R**4 / 4, E * np.pi * R**3 * taper
        D = EJ + y**2 * pull
        k = pull * y / D
        q = -pull * (1 - y * k) / (E * np.pi * R**2) if extension else 0.0
        k_pull = y * EJ / D**2
        k_s = (pull * slope - k * (EJ_rate + 2 * y * slope * pull)) / D
        size = (1 - y * k) ** 2 + slope**2
        psi_pull, psi_s = slope * y * k_pull / size, slope * (slope * k + y * k_s) / size
        still = (1 + q) * k + psi_s
        rub = way * mu * pull * np.sign(still)
        pull_rate = -rub * still / (1 + rub * psi_pull)
        assert (still + psi_pull * pull_rate) * still > 0
        return np.array([*(1 + q) * np.array([np.cos(angle), np.sin(angle), k]), pull_rate])

    start = np.array([0, 0, 0, T])
    return solve_ivp(rate, (0, length), start, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]


def compare(name: str, T: float, mu: float, way: int, extension: bool, accuracy: float) -> None:
    scene = Scene(Friction(mu, way), *([Extension()] if extension else []))
    arm = one_tendon(*ARMS[name])
    shape = settle(arm, [T], scene, accuracy)
    x, y, angle, pull = planar(name, T, mu, way, extension)
    # n of the paper's base is -y: the arm bends there.
    assert np.allclose(shape.tip, [x, -y, 0], rtol=0, atol=2 * accuracy * arm.length)
    t = shape.tip_frame[:, 0]
    assert np.allclose(t, [np.cos(angle), -np.sin(angle), 0], rtol=0, atol=100 * accuracy)
    assert shape.tension(shape.arm.length)[0] == pytest.approx(pull, rel=100 * accuracy)


@pytest.mark.quick(
    "uniform-bending-out",
    "conical body-extension-in",
    "conical-extension-out",
    "widening tendon-bending-in",
)
@WAYS
@pytest.mark.parametrize("extension", [True, False], ids=["extension", "bending"])
@pytest.mark.parametrize("name", ["uniform", "conical body", "conical", "widening tendon"])
def test_one_tendon_in_a_plane_is_an_initial_value_problem(
    name: str, extension: bool, way: int
) -> None:
    compare(name, 0.25, 0.4, way, extension, 1e-10)
    compare(name, 1.2 if way > 0 else 0.5, 0.4, way, extension, 1e-10)


@pytest.mark.parametrize("accuracy", [1e-5, 1e-6, 1e-8])
@pytest.mark.parametrize("T", [0.6, 0.9])
def test_paying_out_round_two_right_angles_makes_the_tip_taut(T: float, accuracy: float) -> None:
    compare("uniform", T, 0.6, -1, False, accuracy)


@pytest.mark.parametrize("T", [3.0, 20.0])
def test_on_a_steep_taper_friction_is_as_accurate_as_asked(T: float) -> None:
    compare("steep", T, 1.0, 1, False, 1e-9)


@pytest.mark.slow
@WAYS
@pytest.mark.parametrize("mu", [0.05, 0.2, 0.6])
@pytest.mark.parametrize("name", ["uniform", "conical body", "conical", "widening tendon"])
def test_one_tendon_in_a_plane_from_slack_to_taut(name: str, mu: float, way: int) -> None:
    for T in np.geomspace(1e-3, 3.0 if way > 0 else 0.2, 6):
        compare(name, T, mu, way, True, 1e-10)
