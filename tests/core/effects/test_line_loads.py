"""Moments at places, and forces and moments per length, against closed forms and shooting."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root

from octoplan import (
    Arm,
    ExactTendons,
    Extension,
    Friction,
    InputError,
    LineLoad,
    Measured,
    PointLoad,
    Scene,
    TipPosition,
    Unknown,
    Weight,
    calibrate,
    plan,
    settle,
    settle_many,
)
from tests.core.effects.bars import NO_PULL, Bar

BAR = Bar(0.011, 0.007)
L = BAR.length
AT, BEGIN, END = 0.19, 0.07, 0.24
FORCE, MOMENT = (0.004, -0.006, 0.003), (4e-4, 5e-4, -7e-4)
LINE_FORCE, LINE_MOMENT = (0.06, 0.15, -0.1), (6e-3, -8e-3, 6e-3)


def shoot(follower: bool) -> tuple[Any, Any]:
    """Return the position and the frame at the tip of the bar, by shooting from the base.

    A force and a moment act at AT, a line load between BEGIN and END.
    """

    def run(wrench: Any, share: float) -> Any:
        state = np.concatenate([np.ravel(BAR.arm.base_frame), np.zeros(3), wrench])
        for low, high in pairwise([0.0, BEGIN, AT, END, L]):
            inside = share * (BEGIN <= low < END)

            def rates(s: float, y: Any, inside: float = inside) -> Any:
                R, M, F = y[:9].reshape(3, 3), y[12:15], y[15:]
                K = np.array([BAR.GI(s), BAR.EJ(s), BAR.EJ(s)])
                a, b, c = R.T @ M / K
                axes = R if follower else np.eye(3)
                f, m = inside * axes @ LINE_FORCE, inside * axes @ LINE_MOMENT
                turn = R @ np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
                return np.concatenate([turn.ravel(), R[:, 0], -np.cross(R[:, 0], F) - m, -f])

            state = solve_ivp(rates, (low, high), state, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
            if high == AT:
                state[12:15] -= share * np.array(MOMENT)
                state[15:] -= share * np.array(FORCE)
        return state

    wrench = np.zeros(6)
    for share in (0.5, 1.0):
        found = root(lambda w, share=share: 1e3 * run(w, share)[12:], wrench, tol=1e-12)
        wrench = found.x
    assert np.abs(found.fun).max() < 1e-9
    end = run(wrench, 1.0)
    return end[9:12], end[:9].reshape(3, 3)


@pytest.mark.parametrize("follower", [False, True], ids=["dead", "follower"])
def test_loads_along_a_bar_agree_with_shooting(
    follower: bool, deviation: Callable[..., float]
) -> None:
    position, frame = shoot(follower)
    line = LineLoad(LINE_FORCE, LINE_MOMENT, BEGIN, END, follower)
    shape = settle(BAR.arm, NO_PULL, Scene(PointLoad(AT, FORCE, MOMENT), line), 1e-10)
    assert np.linalg.norm(position - [L, 0, 0]) > 0.1 * L
    assert deviation(shape.tip, position, L) < 1e-9
    assert np.abs(shape.tip_frame - frame).max() < 1e-8


@pytest.mark.parametrize("follower", [False, True], ids=["dead", "follower"])
def test_moment_per_length_bends_a_bar_linearly(follower: bool) -> None:
    bar, m = Bar(), 1e-2
    # b of the base is -z, and stays: a moment about b has the curvature m (L - s) / EJ.
    moment = (0.0, 0.0, m) if follower else (0.0, 0.0, -m)
    shape = settle(bar.arm, NO_PULL, Scene(LineLoad(moment=moment, follower=follower)), 1e-10)
    s = np.linspace(0, L, 7)
    angle = m * (L * s - s**2 / 2) / bar.EJ(0)
    t = np.column_stack([np.cos(angle), -np.sin(angle), 0 * s])
    assert angle[-1] > 0.5
    assert np.abs(shape.frame(s)[:, :, 0] - t).max() < 1e-9


def test_line_load_of_the_weight_per_length_is_the_weight() -> None:
    arm = Bar().arm
    weight = 1080.0 * np.pi * 0.01**2 * 9.81
    line, body = (
        settle(arm, NO_PULL, Scene(load), 1e-10).tip
        for load in (LineLoad((0.0, 0.0, -weight)), Weight())
    )
    assert np.abs(line - body).max() < 1e-10 * L


def test_tendon_friction_under_moments_per_length_is_verified() -> None:
    arm = Arm.from_paper("section-5.2")
    line = LineLoad((0.02, 0.03, 0.0), (1e-3, 2e-3, -1e-3), 0.05, 0.2)
    shape = settle(arm, [2.0, 0.5, 0.0, 0.0], Scene(Extension(), line, Friction(0.2)), 1e-7)
    assert shape.error < 1e-7


def test_sets_and_plans_under_line_loads() -> None:
    arm = Arm.from_paper("table-2")
    scene = Scene.silicone(
        LineLoad((0.0, 0.0, -0.02), (0.0, 1e-4, 0.0), begin=0.1),
        PointLoad(0.2, (0.0, 0.0, 0.0), (0.0, 2e-4, 1e-4)),
    )
    sets = [np.linspace(0.0, 0.3, 12).reshape(3, 4), np.linspace(0.2, 0.0, 12).reshape(3, 4)]
    many = settle_many(arm, np.array(sets), scene, accuracy=1e-7)
    singly = settle(arm, sets[0], scene, 1e-7).tip
    assert np.abs(many.tip[0] - singly).max() < 3e-7 * arm.length
    result = plan(arm, TipPosition(tuple(many.tip[1])), scene, tension_max=20.0)
    assert result.certificate.passed


def test_calibration_finds_moments_and_loads_per_length() -> None:
    arm = Bar().arm
    true = Scene(
        PointLoad(0.2, (0.0, 0.0, 0.0), (0.0, 3e-4, 0.0)),
        LineLoad((0.0, 0.02, 0.0), begin=0.1),
    )
    start = Scene(
        PointLoad(0.2, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), LineLoad((0.0, 0.0, 0.0), begin=0.1)
    )
    shape = settle(arm, NO_PULL, true, 1e-10)
    places = (0.1, 0.2, 0.25, 0.3)
    points = [(s, (0, 0, 0), tuple(shape.position(s))) for s in places]
    found = calibrate(
        arm,
        start,
        [Measured(tensions=NO_PULL, points=points)],
        [
            Unknown("effects.point_loads[0].moment[1]", -1e-3, 1e-3),
            Unknown("effects.line_loads[0].force[1]", -0.1, 0.1),
        ],
    )
    assert found.values == pytest.approx((3e-4, 0.02), rel=1e-4)


def test_unusable_line_loads_are_refused() -> None:
    with pytest.raises(InputError, match=r"LineLoad\.end = 0\.1: must be above begin, 0\.2 m"):
        LineLoad(begin=0.2, end=0.1)
    with pytest.raises(InputError, match=r"LineLoad\.end = 0\.4: must be from 0 to"):
        settle(BAR.arm, NO_PULL, Scene(LineLoad(end=0.4)))
    with pytest.raises(InputError, match=r"LineLoad\.begin = 0\.3: must be below the arm's length"):
        settle(BAR.arm, NO_PULL, Scene(LineLoad(begin=0.3)))


def test_lengths_under_a_line_load_give_the_tensions_back() -> None:
    arm = Arm.from_paper("section-5.2")
    scene = Scene(Extension(), ExactTendons(), LineLoad((0.0, 0.0, -0.05), begin=0.1))
    pulled = settle(arm, [1.0, 0.6, 0.3, 0.5], scene, 1e-8)
    back = settle(arm, lengths=pulled.tendon_lengths, scene=scene, accuracy=1e-7)
    assert np.abs(back.tip - pulled.tip).max() < 1e-6 * arm.length
