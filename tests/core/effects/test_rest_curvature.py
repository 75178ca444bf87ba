"""Arms that are curved at rest, against arcs, helices, sections and beams solved by SciPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import fsolve

from octoplan.model import (
    Anchorage,
    Arm,
    Linear,
    Material,
    RestCurvature,
    Sampled,
    Scene,
    settle,
    settle_many,
)
from octoplan.model.effects import ExactTendons, Extension, NeoHookean, Shear, TipLoad, Weight
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.friction import Friction
from octoplan.model.tendons import rest_lengths
from octoplan.planner import load_plan, plan, stiffness
from octoplan.planner.targets import TipPosition
from tests.core.effects.bars import helix
from tests.core.effects.cases import Array

L, R, Y, E, NU, DENSITY = 0.2, 0.01, 0.006, 150e3, 0.4, 1100.0
A, EJ = np.pi * R**2, E * np.pi * R**4 / 4
WORLD = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
# A follower load of size zero selects the equations of loaded arms.
NOTHING = TipLoad((0.0, 0.0, 0.0))


def _arm(n: Linear | Sampled, b: Linear | Sampled) -> Arm:
    """Return a cylinder with tendons at 0 and 90 degrees in the world frame."""
    tendons = Anchorage(L, Linear(Y, Y), (0.0, np.pi / 2))
    rest, body = RestCurvature(n, b), Material(E, NU, DENSITY)
    return Arm(L, Linear(R, R), (tendons,), body, WORLD, rest_curvature=rest)


SCENES = [
    Scene(),
    Scene(Extension()),
    Scene(Extension(), ExactTendons()),
    Scene.silicone(),
    Scene(NOTHING),
    Scene(Extension(), Shear(), NOTHING),
    Scene(*Scene.silicone().effects, NOTHING),
    Scene(Extension(), ExactTendons(), Friction(0.1)),
]


@pytest.mark.quick("scene0", "scene3", "scene5", "scene7")
@pytest.mark.parametrize("scene", SCENES)
def test_without_tensions_it_has_its_shape_at_rest(scene: Scene) -> None:
    shape = settle(_arm(Linear(2.0, 2.0), Linear(5.0, 5.0)), [0, 0], scene, 1e-10)
    assert np.allclose(
        shape.tip, helix(np.array([0.0, 2.0, 5.0]), np.eye(3)[0], L), rtol=0, atol=1e-9 * L
    )
    assert np.allclose(shape.strain(L / 3), [0, 2, 5, 0], rtol=0, atol=1e-9)
    assert shape.stability == pytest.approx(1.0, abs=1e-6)


def test_curvature_that_changes_its_direction_is_a_helix() -> None:
    k, w = 6.0, 9.0
    s = np.linspace(0, L, 41)
    paths = (Sampled(tuple(s), tuple(k * f(w * s))) for f in (np.sin, np.cos))
    shape = settle(_arm(*paths), [0, 0], Scene(Extension()), 1e-8)
    radius, rise = k / (k**2 + w**2), w / (k**2 + w**2)
    turned = np.hypot(k, w) * s
    along = np.gradient(shape.position(s), s, axis=0)[1:-1]
    axis = along.mean(axis=0) / np.linalg.norm(along.mean(axis=0))
    found = np.linalg.norm(shape.tip)
    wanted = np.hypot(2 * radius * np.sin(turned[-1] / 2), rise * turned[-1])
    assert found == pytest.approx(wanted, rel=1e-5)
    assert abs(axis[0]) < 1


@pytest.mark.parametrize("T", [0.4, 3.0])
def test_a_weightless_tendon_adds_to_the_curvature_at_rest(T: float) -> None:
    """With the paper's tangent EJ (k - k_0) + y^2 T k = y T: k = (EJ k_0 + y T) / (EJ + y^2 T)."""
    k0 = -7.0
    shape = settle(_arm(Linear(0, 0), Linear(k0, k0)), [T, 0], Scene(), 1e-11)
    k = (EJ * k0 + Y * T) / (EJ + Y**2 * T)
    wanted = [np.sin(k * L) / k, (1 - np.cos(k * L)) / k, 0]
    assert np.allclose(shape.tip, wanted, rtol=0, atol=1e-10 * L)


@pytest.mark.parametrize("loaded", [(), (NOTHING,)])
@pytest.mark.parametrize("rubber", [False, True])
def test_sections_with_exact_tendons_balance_what_differs_from_rest(
    loaded: tuple[Effect, ...], rubber: bool
) -> None:
    """Energy plus T |c| stationary in kappa and lambda, by SciPy; c = nu + w kappa x Y."""
    T, rest = np.array([1.2, 2.0]), np.array([4.0, -6.0])
    Ys = np.array([[0.0, Y, 0.0], [0.0, 0.0, Y]])

    def energy(v: Array) -> float:
        bend, stretch = v[:2] - rest, v[2]
        width = stretch**-0.5 if rubber else 1.0
        c = np.array([stretch, 0, 0]) + width * np.cross([0.0, *v[:2]], Ys)
        pulls = T @ np.linalg.norm(c, axis=1)
        if not rubber:
            return float(E * A * (stretch - 1) ** 2 / 2 + EJ * bend @ bend / 2 + pulls)
        stiff = EJ * (1 + 2 / stretch**3) / (3 * stretch)
        along = E * A / 6 * (stretch**2 + 2 / stretch - 3)
        return float(along + stiff * bend @ bend / 2 + pulls)

    def slope(v: Array) -> Array:
        h = np.array([1e-3, 1e-3, 1e-5])
        steps = np.diag(h)
        return np.array(
            [
                (8 * (energy(v + d) - energy(v - d)) - energy(v + 2 * d) + energy(v - 2 * d))
                / (12 * size)
                for d, size in zip(steps, h, strict=True)
            ]
        ) * [1 / EJ, 1 / EJ, 1 / (E * A)]

    wanted = fsolve(slope, [*rest, 0.95], xtol=1e-9)
    arm = _arm(*(Linear(x, x) for x in rest))
    effects = (Scene.silicone() if rubber else Scene(Extension(), ExactTendons())).effects
    shape = settle(arm, T, Scene(*effects, *loaded), 1e-10)
    tau, xi, k, q = shape.strain(L / 2)
    found = np.array([xi * (1 + q), k * (1 + q), 1 + q])
    assert np.allclose(found, wanted, rtol=1e-7)
    assert abs(tau) < 1e-9
    kappa = np.array([0.0, *wanted[:2]])
    assert np.allclose(shape.tip, wanted[2] * helix(kappa, np.eye(3)[0], L), atol=1e-7 * L)


def test_a_curved_cantilever_under_its_weight_is_the_beam_of_solve_bvp() -> None:
    """EJ (theta' - k_0(s)) = M, M' = -(t x F), F the weight beyond; a plane problem."""
    first, last, g = -3.0, 8.0, 9.81
    weight = DENSITY * A * g

    def rates(s: Array, y: Array) -> Array:
        theta, M = y[2], y[3]
        bend = first + (last - first) * s / L + M / EJ
        return np.array([np.cos(theta), np.sin(theta), bend, np.cos(theta) * weight * (L - s)])

    def ends(a: Array, b: Array) -> Array:
        return np.array([a[0], a[1], a[2], b[3]])

    s = np.linspace(0, L, 41)
    oracle = solve_bvp(rates, ends, s, np.zeros((4, s.size)), tol=1e-10, max_nodes=20000)
    assert oracle.success
    scene = Scene(Weight((0.0, -g, 0.0)))
    shape = settle(_arm(Linear(0, 0), Linear(first, last)), [0, 0], scene, 1e-10)
    places = shape.position(s)
    assert np.allclose(places[:, :2].T, oracle.sol(s)[:2], rtol=0, atol=1e-8)
    assert np.abs(places[:, 2]).max() < 1e-12


def test_curved_out_of_plane_it_twists_under_its_weight_as_kirchhoff_says() -> None:
    """M' = -u' x F, K (kappa - kappa_0) = R^T M: solve_bvp over frames (nine numbers)."""
    rest = np.array([0.0, 4.0, 3.0])
    K = np.array([EJ / (1 + NU), EJ, EJ])
    weight = np.array([0.0, 0.0, -DENSITY * A * 2.0])

    def rate(
        s: float,
        y: Array,
    ) -> Array:
        frame, M = y[3:12].reshape(3, 3), y[12:]
        kappa = rest + frame.T @ M / K
        x, y_, z = kappa
        turn = np.array([[0, -z, y_], [z, 0, -x], [-y_, x, 0]])
        return np.concatenate(
            [frame[:, 0], (frame @ turn).ravel(), -np.cross(frame[:, 0], weight * (L - s))]
        )

    def run(moment: Array) -> Array:
        start = np.concatenate([np.zeros(3), np.eye(3).ravel(), moment])
        return np.asarray(solve_ivp(rate, (0, L), start, rtol=1e-11, atol=1e-13).y[:, -1])

    moment = EJ * fsolve(lambda m: run(EJ * m)[12:] / EJ, np.zeros(3), xtol=1e-10)
    arm = _arm(Linear(4.0, 4.0), Linear(3.0, 3.0))
    shape = settle(arm, [0, 0], Scene(Weight((0.0, 0.0, -2.0))), 1e-10)
    assert np.allclose(shape.tip, run(moment)[:3], rtol=0, atol=1e-8)
    assert abs(shape.strain(L / 3)[0]) > 0.1


CURVED = replace(
    Arm.from_paper("table-4"), rest_curvature=RestCurvature(Linear(1.0, -2.0), Linear(2.0, 3.0))
)
PULL = np.array([[0.0, 0.0, 0.3, 0.0], [2.0, 0.0, 0.0, 0.0], [0.0, 5.0, 0.0, 0.0]])


@pytest.mark.quick("scene1", "scene2")
@pytest.mark.parametrize("scene", SCENES[1:4])
def test_all_ways_to_settle_agree(scene: Scene) -> None:
    shape = settle(CURVED, PULL, scene, 1e-9)
    loaded = settle(CURVED, PULL, Scene(*scene.effects, NOTHING), 1e-9)
    assert np.allclose(shape.tip, loaded.tip, rtol=0, atol=1e-9)
    assert np.allclose(settle_many(CURVED, [PULL] * 40, scene).tip, shape.tip, rtol=0, atol=1e-6)
    held = settle(CURVED, lengths=shape.tendon_lengths, scene=scene, accuracy=1e-7)
    assert np.allclose(held.tip, shape.tip, rtol=0, atol=1e-7)


def test_lengths_at_rest_are_those_of_the_curved_arm() -> None:
    shape = settle(CURVED, np.zeros(12), Scene(Extension(), ExactTendons()), 1e-10)
    assert np.allclose(rest_lengths(CURVED), shape.tendon_lengths, rtol=1e-9)


def test_stiffness_of_a_curved_arm_is_that_of_differences() -> None:
    scene, h = Scene(Extension(), ExactTendons(), Weight()), 1e-5
    arm = replace(CURVED, material=Material(1e6))
    found = stiffness(arm, PULL, scene, accuracy=1e-7).compliance[:3, 0]

    def tip(force: float) -> Array:
        pushed = Scene(*scene.effects, TipLoad((force, 0.0, 0.0)))
        return settle(arm, PULL, pushed, 1e-11).tip

    assert np.allclose(found, (tip(h) - tip(-h)) / (2 * h), rtol=1e-5)


@pytest.mark.quick("effects1")
@pytest.mark.parametrize("effects", [(), (ExactTendons(), NeoHookean(), Weight((0, 0, -1.0)))])
def test_plans_of_curved_arms_are_certified_and_load_back(
    effects: tuple[Effect, ...], tmp_path: object
) -> None:
    found = plan(
        CURVED,
        TipPosition((0.25, 0.1, -0.1)),
        Scene(Extension(), *effects),
        20.0,
        starts=2,
    )
    assert found.certificate.passed
    again = load_plan(found.save(f"{tmp_path}/plan.json"))
    assert again.arm == CURVED
    assert np.allclose(again.tensions, found.tensions)
