"""Helical tendons of any pitch and tension, against a balance of each cross-section in NumPy."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, settle
from octoplan.model.effects import ExactTendons, Extension
from tests.core.hard_cases.family import Array, Family
from tests.random_arms import log_uniform

R, E, NU = 0.01, 150e3, 0.5
A, J = np.pi * R**2, np.pi * R**4 / 4
EA, EJ, GI = E * A, E * J, E / (2 * (1 + NU)) * 2 * J
SCENE = Scene(Extension(), ExactTendons())


def wound(rng: np.random.Generator) -> tuple[float, float, Array, float, Array]:
    """Draw length [m], offset [m], angles [rad], turn to the tip [rad], and tensions [N].

    One to three tendons turn by up to two rounds; together they pull with up to 0.2 E A.
    """
    n = int(rng.integers(1, 4))
    L, y = float(rng.uniform(0.1, 0.3)), float(rng.uniform(0.3, 0.9) * R)
    angles = rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(n) / max(n, 2)
    turn = float(rng.choice([-1, 1]) * log_uniform(rng, 0.05, 4 * np.pi))
    shares = rng.uniform(0, 1, n)
    T = log_uniform(rng, 1e-4, 0.2) * EA * shares / shares.sum()
    return L, y, angles, turn, T


def check_wound(L: float, y: float, angles: Array, turn: float, T: Array) -> float:
    """Return the error of the tip over L."""
    section = Anchorage(L, Linear(y, y), tuple(angles.tolist()), Linear(0.0, turn))
    arm = Arm(L, Linear(R, R), (section,), Material(E, NU))
    shape = settle(arm, T, SCENE, 1e-9)
    return float(np.linalg.norm(shape.tip - _tip(L, y, angles, turn, T))) / L


def _tip(L: float, y: float, angles: Array, turn: float, T: Array) -> Array:
    """Integrate the pose along strains (kappa, stretch) at which the energy is stationary.

    The energy per length is that of the linear section plus the sum of T |c|, with
    c = nu + Y' + kappa x Y for tendons at Y that turn along s.
    """

    def balance(v: Array, share: float, offset: Array, slope: Array) -> Array:
        kappa, stretch = v[:3], v[3]
        c = np.array([stretch, 0, 0]) + slope + np.cross(kappa, offset)
        unit = c / np.linalg.norm(c, axis=1)[:, None]
        moment = np.array([GI, EJ, EJ]) * kappa + share * T @ np.cross(offset, unit)
        return np.append(moment / EJ, (EA * (stretch - 1) + share * T @ unit[:, 0]) / EA)

    def paths(s: float) -> tuple[Array, Array]:
        phi, rate, zero = angles + turn * s / L, turn / L, np.zeros(angles.size)
        offset = y * np.stack([zero, np.cos(phi), np.sin(phi)], axis=1)
        slope = y * rate * np.stack([zero, -np.sin(phi), np.cos(phi)], axis=1)
        return offset, slope

    # The cross-section turns along s with the tendons: its strains at s follow from those at 0.
    start = np.array([0.0, 0.0, 0.0, 1.0])
    for share in np.linspace(0, 1, 9)[1:]:
        start = root(balance, start, args=(share, *paths(0.0)), tol=1e-14).x
    assert np.abs(balance(start, 1.0, *paths(0.0))).max() < 1e-11 / R

    def rates(s: float, state: Array) -> Array:
        about = Rotation.from_rotvec([turn * s / L, 0, 0])
        kappa, stretch = about.apply(start[:3]), start[3]
        w, r = state[0], state[1:4]
        frame = Rotation.from_quat([*r, w]).as_matrix()
        q = 0.5 * np.append(-r @ kappa, w * kappa + np.cross(r, kappa))
        return np.append(q, frame @ np.array([stretch, 0.0, 0.0]))

    # The frame of the base in the paper is half a turn about x.
    base = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    run = solve_ivp(rates, (0, L), base, "DOP853", rtol=1e-11, atol=1e-13)
    return np.asarray(run.y[4:, -1])


HELICES = Family("helical tendons", 1e-8, wound, check_wound)
