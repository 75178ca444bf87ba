"""Paths of tendons: helices, against a balance in NumPy; a different path for each tendon."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

from octoplan.model import (
    Anchorage,
    Arm,
    Linear,
    Material,
    Sampled,
    Scene,
    settle,
    settle_many,
    tip_jacobian,
)
from octoplan.model.effects import ExactTendons, Extension, TipLoad, Weight
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.friction import Friction
from octoplan.model.mesh import stations, tendon_paths
from octoplan.model.tendons import rest_lengths
from octoplan.planner.plan import plan
from octoplan.planner.targets import TipPosition

L, R, Y, E, NU = 0.2, 0.01, 0.006, 150e3, 0.5
ANGLE, TURN = 0.4, 1.1
NOTHING = TipLoad((0.0, 0.0, 0.0))
EXACT = Scene(Extension(), ExactTendons(), NOTHING)


TURNING = Linear(0.0, TURN)


def _arm(turn: Linear | Sampled | None = TURNING) -> Arm:
    anchorage = Anchorage(L, Linear(Y, Y), (ANGLE, ANGLE + np.pi / 2), turn)
    return Arm(L, Linear(R, R), (anchorage,), Material(E, NU))


def tip_of_helix(T: float, turn: float = TURN) -> np.ndarray:
    """Integrate u' = R nu, R' = R kappa with stationary energy plus T |c| at each section.

    Strain energies of a linear section; c = nu + Y' + kappa x Y with Y turning along s. A single
    tendon, no loads: each cross-section balances by itself.
    """
    A, J = np.pi * R**2, np.pi * R**4 / 4
    EA, EJ, GI = E * A, E * J, E / (2 * (1 + NU)) * 2 * J

    def strains(s: float, guess: np.ndarray) -> np.ndarray:
        phi, rate = ANGLE + turn * s / L, turn / L
        offset = Y * np.array([0.0, np.cos(phi), np.sin(phi)])
        slope = Y * rate * np.array([0.0, -np.sin(phi), np.cos(phi)])

        def balance(v: np.ndarray) -> np.ndarray:
            kappa, stretch = v[:3], v[3]
            c = np.array([stretch, 0, 0]) + slope + np.cross(kappa, offset)
            unit = c / np.linalg.norm(c)
            moment = np.array([GI, EJ, EJ]) * kappa + T * np.cross(offset, unit)
            return np.append(moment / EJ, (EA * (stretch - 1) + T * unit[0]) / EA)

        return np.asarray(fsolve(balance, guess, xtol=1e-11))

    def rates(s: float, y: np.ndarray) -> np.ndarray:
        v = strains(s, np.array([0.0, 0.0, 0.0, 1.0]))
        w, r = y[0], y[1:4]
        frame = Rotation.from_quat([*r, w]).as_matrix()
        q = 0.5 * np.append(-r @ v[:3], w * v[:3] + np.cross(r, v[:3]))
        return np.append(q, frame @ np.array([v[3], 0.0, 0.0]))

    base = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    return np.asarray(solve_ivp(rates, (0, L), base, rtol=1e-10, atol=1e-12).y[4:, -1])


@pytest.mark.parametrize("T", [0.3, 1.5])
def test_a_helical_tendon_bends_and_twists_as_its_balance_says(T: float) -> None:
    shape = settle(_arm(), [T, 0.0], EXACT, accuracy=1e-9)
    assert np.allclose(shape.tip, tip_of_helix(T), atol=1e-8 * L)
    assert abs(shape.strain(L / 2)[0]) > 0.01


@pytest.mark.parametrize(
    "effects", [(Extension(),), (ExactTendons(),), (Extension(), ExactTendons())]
)
def test_helical_tendons_need_no_load(effects: tuple[Effect, ...]) -> None:
    scene = Scene(*effects)
    negligible = TipLoad((1e-11, 0.0, 0.0))
    T = [1.5, 0.4]
    free = settle(_arm(), T, scene, accuracy=1e-9)
    loaded = settle(_arm(), T, Scene(*effects, negligible), accuracy=1e-9)
    assert np.allclose(free.tip, loaded.tip, rtol=0, atol=2e-9 * L)
    assert np.allclose(free.tendon_lengths, loaded.tendon_lengths, rtol=0, atol=2e-9 * L)
    many = settle_many(_arm(), [T, [0.2, 1.0]], scene, accuracy=1e-7)
    assert np.allclose(many.tip[0], free.tip, rtol=0, atol=1e-7 * L)


@pytest.mark.parametrize("T", [0.3, 4.0])
def test_unloaded_helix_follows_an_independent_balance(T: float) -> None:
    scene = Scene(Extension(), ExactTendons())
    shape = settle(_arm(), [T, 0.0], scene, accuracy=1e-9)
    assert np.allclose(shape.tip, tip_of_helix(T), rtol=0, atol=1e-8 * L)
    assert shape.stability == pytest.approx(1.0)


def test_unloaded_helix_has_the_tip_jacobian_of_differences() -> None:
    scene = Scene(Extension(), ExactTendons())
    step = 0.02
    ahead = tip_of_helix(0.3 + step)
    behind = tip_of_helix(0.3 - step)
    jacobian = tip_jacobian(_arm(), [0.3, 0.0], scene, accuracy=1e-8)
    difference = (ahead - behind) / (2 * step)
    assert np.allclose(jacobian[:3, 0], difference, rtol=0, atol=1e-3 * np.abs(difference).max())


def test_unloaded_helix_is_planned_to_its_own_tip() -> None:
    scene = Scene(Extension(), ExactTendons())
    angles = (ANGLE, ANGLE + 2 * np.pi / 3, ANGLE + 4 * np.pi / 3)
    arm = Arm(L, Linear(R, R), (Anchorage(L, Linear(Y, Y), angles, TURNING),), Material(E, NU))
    tip = settle(arm, [0.8, 0.4, 0.0], scene, 1e-9).tip
    found = plan(arm, TipPosition(tuple(tip)), scene, tension_max=5.0)
    assert found.certificate.passed, found.outcome
    again = settle(arm, found.tensions, Scene(*scene.effects, NOTHING), 1e-9)
    assert np.allclose(again.tip, tip, rtol=0, atol=2e-6 * L)
    # Co-contraction costs effort, so that the slack tendon stays slack.
    assert np.allclose(found.tensions, [0.8, 0.4, 0.0], rtol=0, atol=1e-4)


@pytest.mark.parametrize("turn", [1.1, 4.0])
def test_a_helical_tendon_that_bends_the_arm_far_is_borne(turn: float) -> None:
    """Equilibria without loads had no torsion: the arm was refused "at 0.0 % of the loads"."""
    shape = settle(_arm(Linear(0.0, turn)), [4.0, 0.0], EXACT, accuracy=1e-9)
    assert np.allclose(shape.tip, tip_of_helix(4.0, turn), atol=1e-8 * L)
    assert shape.stability == pytest.approx(1.0)


def test_a_turn_of_the_whole_tendon_is_an_angle() -> None:
    scene = Scene(Extension(), Weight())
    turned = settle(_arm(Linear(0.3, 0.3)), [0.5, 1.0], scene)
    anchorage = Anchorage(L, Linear(Y, Y), (ANGLE + 0.3, ANGLE + 0.3 + np.pi / 2))
    other = Arm(L, Linear(R, R), (anchorage,), Material(E, NU))
    assert np.allclose(turned.tip, settle(other, [0.5, 1.0], scene).tip, rtol=0, atol=1e-12)


def test_a_sampled_turn_with_friction_settles_near_the_linear_one() -> None:
    s = tuple(np.linspace(0.0, L, 5).tolist())
    sampled = Sampled(s, tuple(TURN * x / L for x in s))
    scene = Scene(Extension(), ExactTendons(), Friction(0.1))
    tips = [settle(_arm(turn), [1.0, 0.2], scene, 1e-7).tip for turn in (sampled, Linear(0, TURN))]
    assert np.allclose(*tips, atol=1e-7)


def test_each_tendon_may_have_a_path_of_its_own() -> None:
    """Two sections that end together have the same forces, tendon by tendon."""
    scene, T = Scene(Extension(), ExactTendons(), Weight()), [0.5, 1.0]
    offsets, turns = (Linear(Y, Y / 2), Linear(Y / 3, Y)), (TURNING, Linear(0.2, -0.4))
    both = Anchorage(L, offsets, (ANGLE, ANGLE + np.pi / 2), turns)
    arm = Arm(L, Linear(R, R), (both,), Material(E, NU))
    # One tendon alone has the path of a section with that path.
    for j in (0, 1):
        one = Anchorage(L, offsets[j], both.angles, turns[j])
        alone = Arm(L, Linear(R, R), (one,), Material(E, NU))
        pulled = np.where(np.arange(2) == j, T, 0.0)
        tips = [settle(own, pulled, scene, 1e-12).tip for own in (arm, alone)]
        assert np.allclose(*tips, rtol=0, atol=1e-12)
    same = Anchorage(L, (Linear(Y, Y),) * 2, both.angles, (TURNING,) * 2)
    tips = [
        settle(own, T, scene, 1e-9).tip
        for own in (Arm(L, Linear(R, R), (same,), Material(E, NU)), _arm())
    ]
    assert np.allclose(*tips, rtol=0, atol=1e-12)


@pytest.mark.parametrize("effects", [(), (ExactTendons(),)])
def test_offsets_by_tendon_hold_in_closed_form_too(effects: tuple[Effect, ...]) -> None:
    offsets = (Linear(Y, Y / 2), Linear(Y / 3, Y))
    arm = Arm(L, Linear(R, R), (Anchorage(L, offsets, (ANGLE, 2.0)),), Material(E, NU))
    scene, T = Scene(Extension(), *effects), [0.5, 1.0]
    free, loaded = settle(arm, T, scene, 1e-9), settle(arm, T, Scene(*scene.effects, NOTHING), 1e-9)
    assert np.allclose(free.tip, loaded.tip, rtol=0, atol=1e-9)
    assert np.allclose(settle_many(arm, [T] * 40, scene).tip[7], free.tip, rtol=0, atol=1e-6)
    held = settle(arm, lengths=free.tendon_lengths, scene=scene)
    assert np.allclose(held.tip, free.tip, rtol=0, atol=1e-6)
    straight = [np.hypot(L, path.end - path.base) for path in offsets]
    assert np.allclose(rest_lengths(arm), straight, rtol=1e-12)


def test_lengths_at_rest_are_those_of_the_helix() -> None:
    assert rest_lengths(_arm())[0] == pytest.approx(np.hypot(L, Y * TURN), rel=1e-12)


def test_rates_of_a_path_that_tapers_and_turns_are_those_of_its_closed_form() -> None:
    # Y = y (cos, sin)(ANGLE + phi): Y'' has y' phi' twice, which friction's bends are made of.
    a, b, c = Y, -0.4 * Y / L, TURN / L
    anchorage = Anchorage(L, Linear(Y, 0.6 * Y), (ANGLE, ANGLE + 1.0), TURNING)
    arm = Arm(L, Linear(R, R), (anchorage,), Material(E, NU))
    s = np.array([0.03, 0.11])
    at = stations(arm, s, np.ones(2, dtype=int))
    found = tendon_paths(arm, at, np.arange(2), np.zeros(2, dtype=int), 1).reshape(2, 2, -1)
    path = (a + b * s) * np.exp(1j * (ANGLE + c * s))
    rate = b * np.exp(1j * (ANGLE + c * s)) + 1j * c * path
    curve = 2j * b * c * np.exp(1j * (ANGLE + c * s)) - c**2 * path
    for own, wanted in zip(found, (rate, curve), strict=True):
        assert np.allclose(own, [wanted.real, wanted.imag], rtol=1e-12, atol=1e-15)
