"""Weight, buoyancy and masses on the way, against closed forms and references."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, solve_bvp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from octoplan.model import Anchorage, Arm, Linear, Material, Sampled, Scene, settle
from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    NeoHookean,
    PointLoad,
    PointMass,
    TipLoad,
    Weight,
)
from octoplan.model.extensions.friction import Friction
from octoplan.planner import plan, stiffness
from octoplan.planner.targets import TipPosition
from tests.core.effects.bars import NO_PULL, Bar, elastica
from tests.core.effects.cases import Array

UNIFORM, CONICAL = Bar(), Bar(0.012, 0.003)
BARS = pytest.mark.parametrize("bar", [UNIFORM, CONICAL], ids=["uniform", "conical"])
LIGHT = 1e-5


def sagging(bar: Bar, g: float) -> float:
    """Return the deflection of the tip under the bar's own weight, for small loads."""
    return bar.deflection(lambda s: bar.density * g * bar.A(s))


def test_a_uniform_cantilever_sags_by_w_L4_over_8_EJ() -> None:
    tip = settle(UNIFORM.arm, NO_PULL, Scene(Weight((0, 0, -LIGHT))), 1e-12).tip
    w, L = 1080 * np.pi * 0.01**2 * LIGHT, 0.3
    assert tip[2] == pytest.approx(-w * L**4 / (8 * UNIFORM.EJ(0.0)), rel=1e-9)
    assert abs(tip[1]) < 1e-18


@BARS
def test_a_cantilever_sags_by_the_unit_load_theorem(bar: Bar) -> None:
    tip = settle(bar.arm, NO_PULL, Scene(Weight((0, -LIGHT, 0))), 1e-12).tip
    assert tip[1] == pytest.approx(-sagging(bar, LIGHT), rel=1e-8)


@BARS
@pytest.mark.parametrize("g", [0.5, 4.0])
def test_a_bar_that_sags_far_is_the_heavy_elastica(
    bar: Bar, g: float, deviation: Callable[..., float]
) -> None:
    shape = settle(bar.arm, NO_PULL, Scene(Weight((0, -g, 0))), 1e-10)
    found = elastica(bar, lambda s: np.array([0.0, -bar.density * g * bar.volume(s)]), shares=6)
    s = np.linspace(0, bar.length, 7)
    assert found(s)[1, -1] < -0.2 * bar.length
    assert deviation(shape.position(s)[:, :2], found(s)[:2].T, bar.length) < 1e-10


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
    dry = sagging(CONICAL, LIGHT)
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


ARM = Arm.from_paper("table-2")
PULL = np.array([[0.0, 0.0, 0.3, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0]])
WATER = Weight((0.0, 0.0, -0.8))
OFF = (0.005, 0.02, -0.01)
SCENES = {
    "paper": (Extension(), WATER),
    "exact": (Extension(), ExactTendons(), WATER),
    "silicone": (*Scene.silicone().effects, WATER),
    "friction": (Extension(), ExactTendons(), Friction(0.1), WATER),
    "current": (Extension(), Current((0.0, 0.1, 0.0)), WATER),
}


def test_on_the_midline_a_mass_is_a_point_load() -> None:
    force = (0.0, 0.0, -0.8 * 0.03)
    tips = [
        settle(ARM, PULL, Scene(WATER, load), 1e-9).tip
        for load in (PointMass(0.2, 0.03), PointLoad(0.2, force), PointMass(0.2, 0.03, (0, 0, 0)))
    ]
    assert np.allclose(tips[0], tips[1], rtol=0, atol=1e-13)
    assert np.allclose(tips[0], tips[2], rtol=0, atol=1e-13)


@pytest.mark.quick("silicone", "friction")
@pytest.mark.parametrize("name", SCENES)
def test_off_the_tip_a_mass_is_a_force_and_its_moment_there(name: str) -> None:
    mass, effects = 0.02, SCENES[name]
    accuracy = 1e-7 if name == "friction" else 1e-9
    shape = settle(ARM, PULL, Scene(*effects, PointMass(ARM.length, mass, OFF)), accuracy)
    force = mass * np.array(WATER.g)
    moment = np.cross(shape.tip_frame @ np.array(OFF), force)
    dead = TipLoad(tuple(force.tolist()), tuple(moment.tolist()))
    other = settle(ARM, PULL, Scene(*effects, dead), accuracy)
    assert np.allclose(shape.tip, other.tip, rtol=0, atol=10 * accuracy * ARM.length)


def test_masses_off_a_beam_bend_it_as_solve_bvp_says() -> None:
    """Plane: EJ theta' = M; M' = -(t x F); at each mass F jumps by m g, M by (R o) x m g."""
    bar, g = Bar(tip=0.01, base=0.01), 9.81
    EJ, L, per_length = float(bar.EJ(0.0)), bar.length, bar.density * bar.A(0.0) * g
    at, masses, offs = 0.6 * L, (0.004, 0.006), ((0.01, -0.03), (-0.02, 0.04))

    def lever(theta: Array, off: tuple[float, float], mass: float) -> Array:
        """The moment of a mass about z is x times the weight, which acts along -y."""
        return np.asarray(-mass * g * (np.cos(theta) * off[0] - np.sin(theta) * off[1]))

    def rates(x: Array, y: Array) -> Array:
        """Integrate both pieces together: (x, y, theta, M) of each over its length."""
        found = []
        for piece, (start, size) in enumerate(((0.0, at), (at, L - at))):
            theta, M = y[4 * piece + 2 : 4 * piece + 4]
            s = start + x * size
            force = per_length * (L - s) + g * (masses[1] + (masses[0] if piece == 0 else 0))
            row = [np.cos(theta), np.sin(theta), M / EJ, np.cos(theta) * force]
            found += [size * np.asarray(own) for own in row]
        return np.array(found)

    def ends(a: Array, b: Array) -> Array:
        jump = lever(b[2], offs[0], masses[0])
        there = [b[0] - a[4], b[1] - a[5], b[2] - a[6], (b[3] - a[7] - jump) / EJ]
        return np.array([*a[:3], *there, (b[7] - lever(b[6], offs[1], masses[1])) / EJ])

    x = np.linspace(0, 1, 41)
    oracle = solve_bvp(rates, ends, x, np.zeros((8, 41)), tol=1e-9, max_nodes=20000)
    assert oracle.success
    frame = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    loads = [
        PointMass(s, mass, (*off, 0.0)) for s, mass, off in zip((at, L), masses, offs, strict=True)
    ]
    scene = Scene(Weight((0.0, -g, 0.0)), *loads)
    shape = settle(bar.turned(base_frame=frame), NO_PULL, scene, 1e-10)
    s = np.linspace(0.05, 0.95, 7)
    for piece, place in ((0, s * at), (1, at + s * (L - at))):
        wanted = oracle.sol(s)[4 * piece : 4 * piece + 2]
        assert np.allclose(shape.position(place)[:, :2].T, wanted, rtol=0, atol=1e-8)


@pytest.mark.quick("silicone")
@pytest.mark.parametrize("name", ["exact", "silicone"])
def test_a_mass_has_a_potential_so_compliance_is_symmetric(name: str) -> None:
    scene = Scene(*SCENES[name], PointMass(0.2, 0.02, OFF), PointMass(0.31, 0.01, (0, 0.03, 0)))
    C = stiffness(ARM, PULL, scene, accuracy=1e-8).compliance
    assert np.abs(C - C.T).max() <= 1e-7 * np.abs(C).max()


@pytest.mark.quick("paper")
@pytest.mark.parametrize("name", ["paper", "silicone"])
def test_plans_by_lengths_and_strains_feel_masses(name: str) -> None:
    scene = Scene(*SCENES[name], PointMass(0.2, 0.02, OFF))
    shape = settle(ARM, PULL, scene, 1e-9)
    held = settle(ARM, lengths=shape.tendon_lengths, scene=scene, accuracy=1e-8)
    assert np.allclose(held.tip, shape.tip, rtol=0, atol=1e-8)
    near = shape.strain(np.array([0.2, 0.2 + 1e-9]))
    assert np.linalg.norm(near[0, :3] - near[1, :3]) > 1e-3
    assert plan(ARM, TipPosition((0.2, 0.1, -0.1)), scene, 20.0, starts=2).certificate.passed


def test_an_arm_of_one_tendon_carries_a_mass_at_its_base() -> None:
    arm = Arm(0.2, Linear(0.01, 0.01), (Anchorage(0.2, Linear(0, 0), (0.0,)),), Material())
    free = settle(arm, [0.0], Scene(WATER), 1e-11)
    laden = settle(arm, [0.0], Scene(WATER, PointMass(0.0, 1.0, OFF)), 1e-11)
    assert np.allclose(free.tip, laden.tip, rtol=0, atol=1e-11)
