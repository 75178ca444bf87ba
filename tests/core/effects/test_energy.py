"""The energy of settled sections and arms, written again in NumPy, is stationary."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Chebyshev
from scipy.integrate import simpson
from scipy.linalg import expm
from scipy.optimize import minimize

from octoplan.model import Anchorage, Arm, Linear, Scene, Shape, settle
from octoplan.model.effects import (
    Buoyancy,
    ExactTendons,
    Extension,
    NeoHookean,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from tests.core.effects.cases import EXACT, SILICONE, SWOLLEN, Array

ARM = Arm.from_paper("table-2")
L, E, G = 0.31, 110e3, 110e3 / 3
ENDS, OFFSETS = (0.31, 0.217, 0.093), ((7.5e-3, 1e-3), (3.5e-3, 3.5e-3), (6e-3, 6e-3))
SCENES = {
    "bending only": Scene(ExactTendons()),
    "linear": EXACT,
    "neo-Hookean": SILICONE,
    "with the shift": SWOLLEN,
}


def tensions(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    pulled = rng.uniform(size=(3, 4)) < 0.6
    return rng.uniform(size=(3, 4)) * pulled * np.array([0.2, 1.0, 3.0])[:, None]


def section_energies(v: Any, s: Any, scene: Scene, T: Any) -> tuple[Any, Any]:
    """Energy per unit reference length of the body and of the tendons, at s (N,).

    Strains v (N, 6) are kappa and nu, whose first part is the stretch.
    """
    R = 15e-3 + (6.5e-3 - 15e-3) * s / L
    A, J = np.pi * R**2, np.pi * R**4 / 4
    twist, bend, stretch, slide = v[:, 0], v[:, 1:3], v[:, 3], v[:, 4:]
    bent = np.sum(bend**2, axis=1)
    rubber, shear = scene.find(NeoHookean), scene.find(Shear)
    if rubber:
        body = E * A / 6 * (stretch**2 + 2 / stretch - 3) + G * J * twist**2 / stretch
        body = body + E * J * (1 + 2 / stretch**3) / (6 * stretch) * bent
    else:
        body = E * A / 2 * (stretch - 1) ** 2 + E * J / 2 * bent + G * J * twist**2
    body = body + (shear.k_s if shear else 0) * G * A / 2 * np.sum(slide**2, axis=1)
    shrink = stretch**-0.5 if rubber else 1.0
    tendons = 0.0
    for i, (end, (a, b)) in enumerate(zip(ENDS, OFFSETS, strict=True)):
        slope = (b - a) / end
        y = a + slope * s
        for j in range(4):
            d = np.array([0, [1, 0, -1, 0][j], [0, 1, 0, -1][j]])
            c = shrink * (y * np.cross(v[:, :3], d).T + slope * np.outer(d, np.ones_like(s)))
            c = v[:, 3:].T + c
            if rubber and rubber.anticlastic:
                inward = y * (bend[:, 1] * d[1] - bend[:, 0] * d[2])
                across = y * (bend[:, 1] * d[2] + bend[:, 0] * d[1])
                c[0] = c[0] - (inward**2 - across**2) / (4 * stretch**2)
            tendons = tendons + T[i, j] * (s < end) * np.sqrt(np.sum(c**2, axis=0))
    return body, tendons


def energy(v: Array, s: float, T: Array, scene: Scene) -> Array:
    """Energies (N,) of (kappa_t, kappa_n, kappa_b, lambda) (N, 4) in one section."""
    rows = np.atleast_2d(v)
    at = np.full(len(rows), s)
    return np.sum(section_energies(np.pad(rows, ((0, 0), (0, 2))), at, scene, T), axis=0)


@pytest.mark.quick("0-bending only", "1-linear", "2-neo-Hookean", "3-with the shift")
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("seed", range(6))
def test_no_strain_nearby_has_less_energy(name: str, seed: int) -> None:
    scene, T = SCENES[name], tensions(seed)
    shape = settle(ARM, T, scene, 1e-6)
    rng = np.random.default_rng(seed)
    for s in (0.05, 0.15, 0.28, 0.309):
        tau, xi, k, q = shape.strain(s)
        settled = np.array([tau, xi, k, 1.0]) * np.array([1 + q] * 3 + [1.0]) + [0, 0, 0, q]
        free = np.array([1, 1, 1, float(scene.has(Extension))])
        least = energy(settled, s, T, scene)
        size = np.array([1.0, 1.0, 1.0, 1e-2])
        steps = rng.normal(size=(20, 4)) * size * free
        for h in (1e-4, 1e-2):
            assert np.all(energy(settled + h * steps, s, T, scene) > least)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["linear", "neo-Hookean", "with the shift"])
def test_a_minimiser_finds_the_same_strains(name: str) -> None:
    scene, T = SCENES[name], tensions(3)
    for s in (0.07, 0.2, 0.3):
        _, xi, k, q = settle(ARM, T, scene, 1e-6).strain(s)
        scale = np.array([10.0, 10.0, 0.1])
        found = minimize(
            lambda x, s=s, scale=scale: energy(
                np.array([0, *(x * scale)[:2], 1 + (x * scale)[2]]), s, T, scene
            )[0],
            np.zeros(3),
            method="Nelder-Mead",
            options={"xatol": 1e-10, "fatol": 1e-16, "maxiter": 4000},
        )
        kn, kb, stretch = found.x * scale + [0, 0, 1]
        assert np.allclose([kn / stretch, kb / stretch], [xi, k], atol=1e-4 * (1 + abs(k)))
        assert np.isclose(stretch - 1, q, atol=1e-6)


def test_one_tendon_on_the_axis_shortens_by_the_uniaxial_law() -> None:
    arm = Arm(0.2, Linear(0.01, 0.01), (Anchorage(0.2, Linear(0.0, 0.0), (0.0,)),))
    for tension in (0.01, 1.0, 10.0, 100.0):
        q = settle(arm, [tension], SILICONE, 1e-9).strain(0.1)[3]
        stress = 110e3 / 3 * ((1 + q) - (1 + q) ** -2)
        assert stress * np.pi * 0.01**2 == pytest.approx(-tension, rel=1e-9)


def test_for_small_tensions_rubber_is_the_linear_material() -> None:
    arm, T = Arm.from_paper("table-4"), 1e-6 * tensions(1) * [[1], [2], [2]]
    soft, linear = (settle(arm, T, scene, 1e-10).strain(0.3) for scene in (SILICONE, EXACT))
    assert np.allclose(soft, linear, rtol=1e-5, atol=0)


FORCE, POINT, AT = (2e-3, -1.5e-3, 1e-3), (0.0, 4e-3, -3e-3), 0.15
LINEAR, RUBBER = (Extension(), ExactTendons()), (Extension(), ExactTendons(), NeoHookean())
SWOLLEN_LAW = (Extension(), ExactTendons(), NeoHookean(anticlastic=True))
LOADS = (TipLoad(FORCE), PointLoad(AT, POINT))
CONSERVATIVE = {
    "tip force": Scene(ExactTendons(), TipLoad(FORCE)),
    "linear, forces and shear": Scene(*LINEAR, *LOADS, Shear(0.9)),
    "rubber in water": Scene(*RUBBER, Weight(), Buoyancy(1000.0)),
    "all at once": Scene(*SWOLLEN_LAW, *LOADS, Weight((0.3, 0.4, 0.2)), Buoyancy(700.0), Shear()),
}
TENSIONS = np.array([[0, 0.3, 0.2, 0], [0.4, 0, 0, 0.3], [0, 0, 1.0, 0.5]])
_PIECES = 60


@dataclass(frozen=True)
class Grid:
    """Return the steps between anchorages and loads, and their two Gauss nodes."""

    ends: Any
    h: Any
    nodes: Any

    @classmethod
    def made(cls) -> Grid:
        cuts = [0.0, *sorted({AT, *ENDS})]
        ends = [np.linspace(a, b, _PIECES + 1) for a, b in pairwise(cuts)]
        h = np.concatenate([np.diff(piece) for piece in ends])
        starts = np.concatenate([piece[:-1] for piece in ends])
        gauss = 0.5 + np.array([-1, 1]) * np.sqrt(3) / 6
        return cls(ends, h, starts[:, None] + h[:, None] * gauss)


GRID = Grid.made()


def settled_strains(shape: Shape) -> Any:
    """Return (kappa, nu) (N, 6) at the nodes; nu, the slope of the midline, includes shear."""
    s = GRID.nodes.ravel()
    slope = np.zeros((s.size, 3))
    for piece in GRID.ends:
        a, b = piece[0], piece[-1]
        x = (a + b) / 2 + (b - a) / 2 * np.cos(np.pi * (np.arange(24) + 0.5) / 24)
        inside = (s > a) & (s < b)
        for i, u in enumerate(shape.position(x).T):
            slope[inside, i] = Chebyshev.fit(x, u, 23, (a, b)).deriv()(s[inside])
    nu = np.einsum("nij,ni->nj", shape.frame(s), slope)
    return np.hstack([nu[:, :1] * shape.strain(s)[:, :3], nu])


def midline(v: Any) -> Any:
    """Positions (M + 1, 3) at the ends of the steps by fourth-order Magnus."""
    matrices = np.zeros((len(v), 4, 4), dtype=v.dtype)
    k, nu = v[:, :3].T, v[:, 3:]
    matrices[:, [2, 0, 1], [1, 2, 0]] = k.T
    matrices[:, [1, 2, 0], [2, 0, 1]] = -k.T
    matrices[:, :3, 3] = nu
    first, second = matrices[::2], matrices[1::2]
    h = GRID.h[:, None, None]
    bracket = first @ second - second @ first
    steps = expm(h / 2 * (first + second) + np.sqrt(3) / 12 * h**2 * bracket)
    g = np.diag([1.0, -1, -1, 1]).astype(v.dtype)
    points = [g[:3, 3]]
    for step in steps:
        g = g @ step
        points.append(g[:3, 3])
    return np.array(points)


def work_of_loads(u: Any, scene: Scene) -> Any:
    tip, weight, fluid = scene.find(TipLoad), scene.find(Weight), scene.find(Buoyancy)
    total = u[-1] @ np.array(tip.force) if tip else 0.0
    for i, piece in enumerate(GRID.ends):
        if weight:
            R = 15e-3 + (6.5e-3 - 15e-3) * piece / L
            heavy = (1080 - (fluid.density if fluid else 0)) * np.pi * R**2
            high = u[i * _PIECES : (i + 1) * _PIECES + 1] @ np.array(weight.g)
            total = total + simpson(heavy * high, x=piece)
        if piece[-1] == AT and scene.has(PointLoad):
            total = total + u[(i + 1) * _PIECES] @ np.array(POINT)
    return total


def terms(v: Any, scene: Scene, T: Any) -> Any:
    """The potential: of the body, the tendons, and the loads."""
    weights = np.repeat(GRID.h / 2, 2)
    body, tendons = section_energies(v, GRID.nodes.ravel(), scene, T)
    return np.array([weights @ body, weights @ tendons, -work_of_loads(midline(v), scene)])


def variation(scene: Scene, seed: int) -> Any:
    """Return a smooth change of the strains of the scene, of the size of the strains."""
    rng = np.random.default_rng(seed)
    waves = np.cos(np.outer(GRID.nodes.ravel() / L, np.pi * np.arange(4)))
    size = np.array([1 / L] * 3 + [0.3 * scene.has(Extension)] + [0.3 * scene.has(Shear)] * 2)
    return waves @ rng.normal(size=(4, 6)) * size


@cache
def settled(name: str) -> Any:
    return settled_strains(settle(Arm.from_paper("table-2"), TENSIONS, CONSERVATIVE[name], 1e-10))


def imbalance(name: str, seed: int, T: Any) -> float:
    """Return the change of the potential over the sum of the sizes of the changes of its parts."""
    v, scene = settled(name), CONSERVATIVE[name]
    parts = terms(v + 1e-30j * variation(scene, seed), scene, T).imag / 1e-30
    return float(abs(parts.sum()) / np.abs(parts).sum())


@pytest.mark.quick("tip force-0", "rubber in water-1", "all at once-2")
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", CONSERVATIVE)
def test_the_potential_of_a_settled_arm_is_stationary(name: str, seed: int) -> None:
    assert imbalance(name, seed, TENSIONS) < 2e-10


@pytest.mark.parametrize("name", CONSERVATIVE)
def test_that_of_an_arm_pulled_a_little_otherwise_is_not(name: str) -> None:
    assert max(imbalance(name, seed, 1.001 * TENSIONS) for seed in range(4)) > 1e-5
