"""Cross-sections without loads, with turning tendons and shear, against NumPy and SciPy."""

import numpy as np
import pytest
import scipy

from octoplan.model.anchorage import Anchorage, Material
from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import cross_section_of
from octoplan.model.cross_section.sections import Sections
from octoplan.model.effects import ExactTendons, Extension, NeoHookean, Shear, Weight
from octoplan.model.paths import Linear
from octoplan.model.scene import Scene

L, ANGLES, TURN, K_S = 0.3, (0.2, 2.0, 4.1), 3.0, 0.8
MATERIAL = Material(0.5e6, 0.45)
ARM = Arm(
    L,
    Linear(0.02, 0.01),
    (Anchorage(L, Linear(0.014, 0.006), ANGLES, turn=Linear(0.0, TURN)),),
    MATERIAL,
)
S = np.array([0.02, 0.13, 0.29])
TENSIONS = np.array([3.0, 0.5, 1.5])


def _numbers(s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return E A, E J, G I, k_s G A; offsets Y (3, 3) of the tendons, and their derivatives."""
    R, y, slope = 0.02 - 0.01 * s / L, 0.014 - 0.008 * s / L, -0.008 / L
    A, J, G = np.pi * R**2, np.pi * R**4 / 4, MATERIAL.E / (2 * (1 + MATERIAL.nu))
    phi = np.array(ANGLES) + TURN * s / L
    d = np.stack([0 * phi, np.cos(phi), np.sin(phi)], axis=1)
    across = np.stack([0 * phi, -np.sin(phi), np.cos(phi)], axis=1)
    body = np.array([MATERIAL.E * A, MATERIAL.E * J, 2 * G * J, K_S * G * A])
    return body, y * d, slope * d + y * TURN / L * across


def _linear(s: float) -> np.ndarray:
    """Return kappa, q, shears by the paper's balance, eqs. (8) and (9), which is linear."""
    (EA, EJ, GI, GA), Y, Y_rate = _numbers(s)
    stiff = np.array([GI, EJ, EJ, EA, GA, GA])

    def wrench(v: np.ndarray) -> np.ndarray:
        c = np.array([1.0, 0, 0]) + Y_rate + np.cross(v[:3], Y)
        moment, force = TENSIONS @ np.cross(Y, c), TENSIONS @ c
        return stiff * v + np.append(moment, force)

    rest = wrench(np.zeros(6))
    D = np.stack([wrench(e) - rest for e in np.eye(6)], axis=1)
    v = np.linalg.solve(D, -rest)
    return np.append((1 + v[3]) * v[:3], v[3:])


def _least(s: float, rubber: bool) -> np.ndarray:
    """Return kappa, q, shears of the least energy of body and tendons, from physics alone."""
    (EA, EJ, GI, GA), Y, Y_rate = _numbers(s)

    def energy(x: np.ndarray) -> float:
        kappa, stretch, shear = 50 * x[:3], np.exp(x[3]), x[4:]
        w = stretch**-0.5 if rubber else 1.0
        c = np.append(stretch, shear) + w * (Y_rate + np.cross(kappa, Y))
        tendons = TENSIONS @ np.linalg.norm(c, axis=1)
        bends, twists, shears = (np.sum(part**2) for part in (kappa[1:], kappa[:1], shear))
        if rubber:
            along = EA / 6 * (stretch**2 + 2 / stretch - 3) + GA * shears / 2
            bent = EJ * (1 + 2 / stretch**3) / (6 * stretch) * bends
            return float(along + bent + GI * twists / (2 * stretch) + tendons)
        body = EA * (stretch - 1) ** 2 + EJ * bends + GI * twists + GA * shears
        return float(body / 2 + tendons)

    least = scipy.optimize.minimize(energy, np.zeros(6), tol=1e-14, options={"gtol": 1e-9})
    return np.concatenate([50 * least.x[:3], [np.expm1(least.x[3])], least.x[4:]])


@pytest.mark.parametrize("law", ["paper", "exact", "rubber"])
def test_sections_twist_and_shear_as_their_balance_says(law: str) -> None:
    effects = {"paper": (), "exact": (ExactTendons(),), "rubber": (ExactTendons(), NeoHookean())}
    scene = Scene(Extension(), Shear(k_s=K_S), Weight(), *effects[law])
    of = cross_section_of(scene)
    sections = Sections(ARM, scene, of, S, np.ones(S.size, dtype=np.int64))
    v = sections.strains(TENSIONS)
    if law == "paper":
        expected = np.array([_linear(s) for s in S])
        v[:, :3] *= 1 + v[:, 3:4]
        assert np.allclose(v, expected, rtol=1e-12, atol=1e-12)
    else:
        expected = np.array([_least(s, law == "rubber") for s in S])
        v[:, 3] -= 1
        assert np.abs(expected[:, [0, 4]]).min() > 1e-4
        assert np.allclose(v, expected, rtol=1e-5, atol=1e-5)
