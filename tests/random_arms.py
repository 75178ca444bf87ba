"""Random arms, for the model and as rods of the oracles."""

from __future__ import annotations

import numpy as np

from octoplan.model import Anchorage, Arm, Linear, Material
from tests.oracles import Array, Rod, RodSection, linear

DENSITY = 1080.0


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def random_arm(
    rng: np.random.Generator, longest: float, anchorages: int, tendons: int
) -> tuple[Arm, Rod]:
    """Return an arm from 5 cm long on, of up to so many anchorages and tendons, at any angles."""
    L = log_uniform(rng, 0.05, longest)
    base = L * rng.uniform(0.02, 0.06)
    tip = base * rng.uniform(0.2, 1.0)
    E, nu = log_uniform(rng, 5e4, 2e6), float(rng.uniform(0.3, 0.5))
    ends = [L, *np.sort(L * rng.uniform(0.15, 0.9, rng.integers(0, anchorages)))[::-1]]
    sections, own = [], []
    for at in map(float, ends):
        share = rng.uniform(0.4, 0.95)
        first, last = share * base, share * (base + (tip - base) * at / L)
        angles = tuple(rng.uniform(0, 2 * np.pi, rng.integers(2, tendons + 1)).tolist())
        sections.append(Anchorage(at, Linear(first, last), angles))
        own.append(RodSection(at, linear(first, last, at), angles))
    arm = Arm(L, Linear(base, tip), tuple(sections), Material(E, nu, DENSITY))
    return arm, Rod(L, linear(base, tip, L), tuple(own), E, nu)


def random_pulls(arm: Arm, rng: np.random.Generator, most: float) -> Array:
    """Return tensions (n_tendons,), half of them 0; each bends the arm by up to `most` rad."""
    at = np.array([arm.sections[i].at for i, _ in arm.tendons])
    radius = arm.radius.evaluate(at, arm.length)[0]
    unit = arm.material.E * np.pi * radius**3 / 4 / at
    pulled = rng.uniform(0, most, at.size)
    return np.asarray(unit * pulled * (rng.uniform(size=at.size) < 0.5))
