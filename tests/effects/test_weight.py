"""Weight and buoyancy against beams, hanging bars and quadrature."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from model import Anchorage, Arm, Linear, Material, Sampled, Scene, settle
from model.effects import Buoyancy, ExactTendons, Extension, NeoHookean, Weight
from tests.effects.bars import NO_PULL, Bar, elastica

UNIFORM, CONICAL = Bar(), Bar(0.012, 0.003)
BARS = pytest.mark.parametrize("bar", [UNIFORM, CONICAL], ids=["uniform", "conical"])
LIGHT = 1e-5


def deflection(bar: Bar, g: float) -> float:
    """Of the tip, by the unit load theorem for small loads."""

    def moment(s: float) -> float:
        return quad(lambda x: bar.density * g * bar.A(x) * (x - s), s, bar.length)[0]

    def part(s: float) -> float:
        return moment(s) * (bar.length - s) / bar.EJ(s)

    return float(quad(part, 0, bar.length, epsrel=1e-12)[0])


def test_a_uniform_cantilever_sags_by_w_L4_over_8_EJ() -> None:
    tip = settle(UNIFORM.arm, NO_PULL, Scene(Weight((0, 0, -LIGHT))), 1e-12).tip
    w, L = 1080 * np.pi * 0.01**2 * LIGHT, 0.3
    assert tip[2] == pytest.approx(-w * L**4 / (8 * UNIFORM.EJ(0.0)), rel=1e-9)
    assert abs(tip[1]) < 1e-18


@BARS
def test_a_cantilever_sags_by_the_unit_load_theorem(bar: Bar) -> None:
    tip = settle(bar.arm, NO_PULL, Scene(Weight((0, -LIGHT, 0))), 1e-12).tip
    assert tip[1] == pytest.approx(-deflection(bar, LIGHT), rel=1e-8)


@BARS
@pytest.mark.parametrize("g", [0.5, 4.0])
def test_a_bar_that_sags_far_is_the_heavy_elastica(bar: Bar, g: float) -> None:
    shape = settle(bar.arm, NO_PULL, Scene(Weight((0, -g, 0))), 1e-10)
    found = elastica(bar, lambda s: np.array([0.0, -bar.density * g * bar.volume(s)]), shares=6)
    s = np.linspace(0, bar.length, 7)
    assert found(s)[1, -1] < -0.2 * bar.length
    assert np.allclose(shape.position(s)[:, :2], found(s)[:2].T, rtol=0, atol=1e-10 * bar.length)


@BARS
@pytest.mark.parametrize("g", [9.81, -9.81], ids=["hanging", "standing"])
def test_a_bar_along_gravity_stretches_by_the_weight_beyond(bar: Bar, g: float) -> None:
    if g < 0:
        bar = Bar(bar.base, bar.tip, 0.1)  # short enough not to buckle
    shape = settle(bar.arm, NO_PULL, Scene(Extension(), Weight((g, 0, 0))), 1e-12)
    s = np.linspace(0, bar.length, 9)
    q = bar.density * g * bar.volume(s) / (bar.E * bar.A(s))
    assert np.allclose(shape.strain(s)[:, 3], q, rtol=1e-12, atol=1e-16)
    length = quad(lambda x: 1 + bar.density * g * bar.volume(x) / (bar.E * bar.A(x)), 0, bar.length)
    assert np.allclose(shape.tip, [length[0], 0, 0], rtol=0, atol=1e-12 * bar.length)
    if bar.base == bar.tip:
        longer = bar.density * g * bar.length**2 / (2 * bar.E)
        assert shape.tip[0] - bar.length == pytest.approx(longer, rel=1e-12)


def test_a_hanging_bar_of_rubber_stretches_by_the_uniaxial_law() -> None:
    scene = Scene(Extension(), ExactTendons(), NeoHookean(), Weight((100.0, 0, 0)))
    shape = settle(UNIFORM.arm, NO_PULL, scene, 1e-11)

    def stretch(s: float) -> float:
        stress = 1080 * 100.0 * (0.3 - s)
        return float(brentq(lambda x: 110e3 / 3 * (x - x**-2) - stress, 0.5, 9, xtol=1e-14))

    for s in (0.0, 0.1, 0.29):
        assert 1 + shape.strain(s)[3] == pytest.approx(stretch(s), rel=1e-11)
    assert shape.tip[0] == pytest.approx(quad(stretch, 0, 0.3, epsrel=1e-12)[0], rel=1e-11)
    assert stretch(0.0) > 1.3


@pytest.mark.parametrize("fluid", [0.0, 500.0, 1000.0, 1160.0, 2160.0])
def test_buoyancy_takes_off_the_weight_of_the_fluid(fluid: float) -> None:
    scene = Scene(Weight((0, 0, -LIGHT)), Buoyancy(fluid))
    tip = settle(CONICAL.arm, NO_PULL, scene, 1e-12).tip
    dry = deflection(CONICAL, LIGHT)
    assert tip[2] == pytest.approx(-dry * (1080 - fluid) / 1080, rel=1e-8)


@pytest.mark.parametrize("g", [(0, 0, -9.81), (20.0, -9.81, 300.0)])
def test_a_neutrally_buoyant_arm_does_not_move(g: tuple[float, float, float]) -> None:
    arm = Arm.from_paper("table-4")
    T = np.zeros((3, 4))
    T[0, 2], T[1, 0], T[2, 1] = 0.5, 4.0, 13.0
    floating = settle(arm, T, Scene(Extension(), Weight(g), Buoyancy(1080.0)), 1e-11).tip
    assert np.allclose(floating, settle(arm, T, Scene(Extension()), 1e-11).tip, rtol=0, atol=1e-11)


BARREL_S = np.linspace(0, 0.3, 7)
BARREL_R = np.array([8.0, 10.5, 12.0, 12.5, 11.0, 8.0, 5.0]) * 1e-3


def barrel(density: float) -> Arm:
    radius = Sampled(tuple(BARREL_S), tuple(BARREL_R))
    axis = (Anchorage(0.3, Linear(0, 0), (0.0,)),)
    return Arm(0.3, radius, axis, Material(110e3, 0.5, density))


def barrel_moment(power: int) -> float:
    """The integral of area times s to a power, piece by piece."""
    R = CubicSpline(BARREL_S, BARREL_R)
    return sum(quad(lambda s: np.pi * R(s) ** 2 * s**power, *ab)[0] for ab in pairwise(BARREL_S))


def test_the_weight_of_a_barrel_hangs_on_its_base() -> None:
    shape = settle(barrel(900.0), NO_PULL, Scene(Extension(), Weight((5.0, 0, 0))), 1e-9)
    q = 900.0 * 5.0 * barrel_moment(0) / (110e3 * np.pi * BARREL_R[0] ** 2)
    assert shape.strain(0.0)[3] == pytest.approx(q, rel=1e-13)


def test_the_weight_of_a_barrel_bends_its_base() -> None:
    shape = settle(barrel(900.0), NO_PULL, Scene(Weight((0, -LIGHT, 0))), 1e-10)
    # Bending towards n = -y is positive.
    k = 900.0 * LIGHT * barrel_moment(1) / (110e3 * np.pi * BARREL_R[0] ** 4 / 4)
    assert shape.strain(0.0)[2] == pytest.approx(k, rel=1e-8)


def test_gravity_turned_about_the_bar_turns_its_shape() -> None:
    down = settle(CONICAL.arm, NO_PULL, Scene(Weight((0, 0, -4.0))), 1e-10).tip
    angle = 0.7
    g = 4.0 * np.array([0, np.sin(angle), -np.cos(angle)])
    tip = settle(CONICAL.arm, NO_PULL, Scene(Weight(tuple(g))), 1e-10).tip
    turned = [down[0], -down[2] * np.sin(angle), down[2] * np.cos(angle)]
    assert np.allclose(tip, turned, rtol=0, atol=1e-13)
