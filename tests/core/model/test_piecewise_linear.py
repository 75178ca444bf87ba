"""Routes and radii with kinks, against shooting in SciPy that stops at each kink."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from octoplan import (
    Anchorage,
    Arm,
    ExactTendons,
    Extension,
    Friction,
    InputError,
    Linear,
    Material,
    PiecewiseLinear,
    Scene,
    TipLoad,
    TipPosition,
    plan,
    settle,
)
from octoplan.model.mesh import graded

L = 0.3
E = 2e6
TIP = 0.27
OFFSETS = ((0.0, 0.08, 0.17, TIP), (8e-3, 3e-3, 7e-3, 2e-3))
RADII = ((0.0, 0.12, 0.2, L), (12e-3, 9e-3, 10e-3, 8e-3))
STOPS = sorted({*OFFSETS[0], *RADII[0]})
ARM = Arm(
    L,
    PiecewiseLinear(*RADII),
    (Anchorage(TIP, PiecewiseLinear(*OFFSETS), (0.0, np.pi)),),
    Material(E, 0.4, 1100.0),
)


def shoot(pulls: Any, force: Any) -> Any:
    """Position and angle of the tip in the plane of t and n; tendons run at +y and -y.

    The integration runs from the tip to the base and stops at each kink.
    """

    def bend(s: float, moment: float, low: float, high: float) -> float:
        y, rate = 0.0, 0.0
        middle = (low + high) / 2
        if middle < TIP:
            y = float(np.interp(s, *OFFSETS))
            piece = np.searchsorted(OFFSETS[0], middle) - 1
            rate = float((np.diff(OFFSETS[1]) / np.diff(OFFSETS[0]))[piece])
        EJ = E * np.pi * np.interp(s, *RADII) ** 4 / 4

        def balance(k: float) -> float:
            wrench = EJ * k - moment
            for T, side in zip(pulls, (1, -1), strict=True):
                along = 1 - k * side * y
                wrench -= T * (middle < TIP) * side * y * along / np.hypot(along, rate)
            return float(wrench)

        return float(brentq(balance, -100, 100, xtol=1e-14, rtol=1e-15))

    def run(angle: float) -> Any:
        state = np.array([0.0, 0.0, angle, 0.0])
        for low, high in [*pairwise(STOPS)][::-1]:

            def rates(s: float, y: Any, low: float = low, high: float = high) -> Any:
                t = np.cos(y[2]), np.sin(y[2])
                return [*t, bend(s, y[3], low, high), -(t[0] * force[1] - t[1] * force[0])]

            state = solve_ivp(rates, (high, low), state, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
        return state

    angle = brentq(lambda a: run(a)[2], -2.0, 2.0, xtol=1e-12)
    x, y = -run(angle)[:2]
    return np.array([x, y]), angle


@pytest.mark.parametrize("force", [(0.0, 0.0), (-0.3, 0.5)], ids=["free", "loaded"])
def test_kinks_of_route_and_radius_agree_with_shooting(force: tuple[float, float]) -> None:
    pulls = [9.0, 2.0]
    (x, n), angle = shoot(pulls, force)
    scene = Scene(ExactTendons(), *([TipLoad((force[0], -force[1], 0.0))] if any(force) else []))
    shape = settle(ARM, pulls, scene, 1e-9)
    assert abs(angle) > 0.3
    assert np.abs(shape.tip - [x, -n, 0]).max() < 2e-9 * L
    assert np.abs(shape.tip_frame[:, 0] - [np.cos(angle), -np.sin(angle), 0]).max() < 1e-8


def test_kinks_are_nodes_of_meshes() -> None:
    nodes = graded(ARM, 1).s.tolist()
    assert {*OFFSETS[0], *RADII[0]} <= {*nodes}


@pytest.mark.parametrize("mu", [0.1, 0.5])
def test_a_kink_costs_tension_by_the_capstan_law(mu: float) -> None:
    s, y = (0.0, 0.1, 0.2, L), (2e-3, 15e-3, 5e-3, 18e-3)
    sections = (Anchorage(L, PiecewiseLinear(s, y), (0.0,)),)
    rigid = Arm(L, Linear(0.02, 0.02), sections, Material(1e13, 0.4))
    turned = np.abs(np.diff(np.arctan(np.diff(y) / np.diff(s)))).sum()
    shape = settle(rigid, [5.0], Scene(Extension(), ExactTendons(), Friction(mu)), 1e-9)
    assert shape.tension(L)[0] == pytest.approx(5.0 * np.exp(-mu * turned), rel=1e-8)


def test_plans_along_kinks_are_certified() -> None:
    scene = Scene(Extension(), ExactTendons())
    sections = (
        Anchorage(TIP, PiecewiseLinear(*OFFSETS), (0.0, 2.0, 4.0)),
        Anchorage(0.15, Linear(6e-3, 6e-3), (0.0, 2.0, 4.0)),
    )
    arm = Arm(L, PiecewiseLinear(*RADII), sections, Material(E, 0.4, 1100.0))
    target = settle(arm, [4.0, 1.0, 0.0, 0.0, 6.0, 2.0], scene).tip
    result = plan(arm, TipPosition(tuple(target)), scene, tension_max=40.0)
    assert result.certificate.passed
    assert np.abs(result.shape.tip - target).max() < 1e-5 * L


def test_unusable_kinks_are_refused() -> None:
    with pytest.raises(InputError, match=r"PiecewiseLinear\.s .* strictly increasing"):
        PiecewiseLinear((0.0, 0.2, 0.1), (1e-3, 1e-3, 1e-3))
    with pytest.raises(InputError, match=r"PiecewiseLinear\.values"):
        PiecewiseLinear((0.0, 0.1), (1e-3,))
    with pytest.raises(InputError, match=r"Arm\.radius\.s .* samples from 0 to 0.3 m"):
        Arm(L, PiecewiseLinear((0.0, 0.2), (0.01, 0.01)), ARM.sections)
