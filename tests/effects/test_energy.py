"""Settled sections are stationary points of an energy that is written again here in NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from model import Arm, Scene, settle
from model.effects import ExactTendons, Extension, NeoHookean
from tests.effects.cases import EXACT, SILICONE, SWOLLEN, Array

ARM = Arm.from_paper("table-4")
SCENES = {
    "bending only": Scene(ExactTendons()),
    "linear": EXACT,
    "neo-Hookean": SILICONE,
    "with the shift": SWOLLEN,
}


def tensions(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    pulled = rng.uniform(size=(3, 4)) < 0.6
    return rng.uniform(size=(3, 4)) * pulled * np.array([0.2, 2.0, 6.0])[:, None]


def energy(v: Array, s: float, T: Array, scene: Scene) -> float:
    """Energy per unit reference length of v = (kappa_t, kappa_n, kappa_b, lambda)."""
    R = 0.015 + (0.002 - 0.015) * s / 0.45
    E, A, J = 110e3, np.pi * R**2, np.pi * R**4 / 4
    twist, bend, stretch = v[0], v[1:3], v[3]
    rubber = scene.find(NeoHookean)
    if rubber:
        total = E * A / 6 * (stretch**2 + 2 / stretch - 3)
        total += E * J * (1 + 2 / stretch**3) / (6 * stretch) * (bend @ bend)
        total += E / 3 * 2 * J * twist**2 / (2 * stretch)
    else:
        total = E * A / 2 * (stretch - 1) ** 2 + E * J / 2 * (bend @ bend)
        total += E / 3 * 2 * J * twist**2 / 2
    shrink = stretch**-0.5 if rubber else 1.0
    ends, base, end = (0.45, 0.315, 0.135), (7.5e-3, 3.5e-3, 6e-3), (1e-3, 3.5e-3, 6e-3)
    for i in range(3):
        if s > ends[i]:
            continue
        slope = (end[i] - base[i]) / ends[i]
        y = base[i] + slope * s
        for j, d in enumerate(([0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, -1])):
            c = np.array([stretch, 0, 0]) + shrink * (
                slope * np.array(d) + y * np.cross(np.array([twist, *bend]), d)
            )
            if rubber and rubber.anticlastic:
                g, Y = np.array([bend[1], -bend[0]]), y * np.array(d[1:])
                c[0] -= ((g @ Y) ** 2 - (g[0] * Y[1] - g[1] * Y[0]) ** 2) / (4 * stretch**2)
            total += T[i, j] * float(np.linalg.norm(c))
    return float(total)


@pytest.mark.quick("0-bending only", "1-linear", "2-neo-Hookean", "3-with the shift")
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("seed", range(6))
def test_no_strain_nearby_has_less_energy(name: str, seed: int) -> None:
    scene, T = SCENES[name], tensions(seed)
    shape = settle(ARM, T, scene, 1e-6)
    rng = np.random.default_rng(seed)
    for s in (0.05, 0.2, 0.4, 0.449):
        tau, xi, k, q = shape.strain(s)
        settled = np.array([tau, xi, k, 1.0]) * np.array([1 + q] * 3 + [1.0]) + [0, 0, 0, q]
        free = np.array([1, 1, 1, float(scene.has(Extension))])
        least = energy(settled, s, T, scene)
        size = np.array([1.0, 1.0, 1.0, 1e-2])
        steps = rng.normal(size=(20, 4)) * size * free
        for h in (1e-4, 1e-2):
            changes = np.array([energy(settled + h * step, s, T, scene) - least for step in steps])
            assert np.all(changes > 0)


@pytest.mark.quick("neo-Hookean", "with the shift")
@pytest.mark.parametrize("name", ["linear", "neo-Hookean", "with the shift"])
def test_a_minimiser_finds_the_same_strains(name: str) -> None:
    scene, T = SCENES[name], tensions(3)
    for s in (0.1, 0.3, 0.44):
        _, xi, k, q = settle(ARM, T, scene, 1e-6).strain(s)
        scale = np.array([10.0, 10.0, 0.1])
        found = minimize(
            lambda x, s=s, scale=scale: energy(
                np.array([0, *(x * scale)[:2], 1 + (x * scale)[2]]), s, T, scene
            ),
            np.zeros(3),
            method="Nelder-Mead",
            options={"xatol": 1e-10, "fatol": 1e-16, "maxiter": 4000},
        )
        kn, kb, stretch = found.x * scale + [0, 0, 1]
        assert np.allclose([kn / stretch, kb / stretch], [xi, k], atol=1e-4 * (1 + abs(k)))
        assert np.isclose(stretch - 1, q, atol=1e-6)


def test_one_tendon_on_the_axis_shortens_by_the_uniaxial_law() -> None:
    from model import Anchorage, Linear

    arm = Arm(0.2, Linear(0.01, 0.01), (Anchorage(0.2, Linear(0.0, 0.0), (0.0,)),))
    for tension in (0.01, 1.0, 10.0, 100.0):
        q = settle(arm, [tension], SILICONE, 1e-9).strain(0.1)[3]
        stress = 110e3 / 3 * ((1 + q) - (1 + q) ** -2)
        assert stress * np.pi * 0.01**2 == pytest.approx(-tension, rel=1e-9)


def test_for_small_tensions_rubber_is_the_linear_material() -> None:
    T = tensions(1) * 1e-6
    soft, linear = (settle(ARM, T, scene, 1e-10).strain(0.3) for scene in (SILICONE, EXACT))
    assert np.allclose(soft, linear, rtol=1e-5, atol=0)
