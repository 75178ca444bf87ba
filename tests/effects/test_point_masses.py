"""Masses on and off the midline, against loads that are the same and against beams by SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from model import Anchorage, Arm, Linear, Material, Scene, settle
from model.effects import (
    Current,
    ExactTendons,
    Extension,
    Friction,
    PointLoad,
    PointMass,
    TipLoad,
    Weight,
)
from model.scene import Scene as SceneOf
from planner import plan, stiffness
from planner.targets import TipPosition
from tests.effects.bars import NO_PULL, Bar
from tests.effects.cases import Array

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
        """The moment of a mass about z: x of its place times its weight, downward along y."""
        return np.asarray(-mass * g * (np.cos(theta) * off[0] - np.sin(theta) * off[1]))

    def rates(x: Array, y: Array) -> Array:
        """Both pieces side by side: (x, y, theta, M) of each over a share of its length."""
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
    scene = SceneOf(Weight((0.0, -g, 0.0)), *loads)
    shape = settle(bar.turned(base_frame=frame), NO_PULL, scene, 1e-10)
    s = np.linspace(0.05, 0.95, 7)
    for piece, place in ((0, s * at), (1, at + s * (L - at))):
        wanted = oracle.sol(s)[4 * piece : 4 * piece + 2]
        assert np.allclose(shape.position(place)[:, :2].T, wanted, rtol=0, atol=1e-8)


@pytest.mark.parametrize("name", ["exact", "silicone"])
def test_a_mass_has_a_potential_so_compliance_is_symmetric(name: str) -> None:
    scene = Scene(*SCENES[name], PointMass(0.2, 0.02, OFF), PointMass(0.31, 0.01, (0, 0.03, 0)))
    C = stiffness(ARM, PULL, scene, accuracy=1e-8).compliance
    assert np.abs(C - C.T).max() <= 1e-7 * np.abs(C).max()


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
