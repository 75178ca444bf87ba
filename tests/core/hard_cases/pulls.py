"""Tensions from 1e-9 N to y2 T = 1000 E J, and antagonists that shorten the arm to nothing."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from octoplan.model import Anchorage, Arm, Linear, Scene, settle
from octoplan.model.effects import ExactTendons, Extension
from octoplan.model.support.errors import CollapsedError
from tests.core.hard_cases.family import Array, Family, WrongAnswerError, relative
from tests.core.hard_cases.sections import CrossSection
from tests.core.model.cases import arm_of
from tests.oracles import Rod, RodSection, linear, poses, strain
from tests.random_arms import log_uniform

STATICS = {
    "paper": Scene(Extension()),
    "exact": Scene(Extension(), ExactTendons()),
    "silicone": Scene.silicone(),
}


def pulled(rng: np.random.Generator, statics: str) -> tuple[str, Rod, Array]:
    """Draw a rod with one to four tendons that end at the tip.

    One tendon is taut, at 0.6 to 0.95 of the radius; others have up to a twentieth of its tension.
    """
    L, thick = rng.uniform(0.1, 0.5), rng.uniform(8e-3, 20e-3)
    thin = thick * rng.uniform(0.3, 0.9)
    a, b = rng.uniform(0.6, 0.95, 2) * [thick, thin]
    n = int(rng.integers(1, 5))
    angles = tuple(rng.uniform(0, 2 * np.pi) + np.arange(n) * np.pi / 2)
    rod = Rod(L, linear(thick, thin, L), (RodSection(L, linear(a, b, L), angles),))
    most = 1000 * rod.E * np.pi * thick**4 / 4 / a**2
    T = np.full(n, log_uniform(rng, 1e-9, most))
    # Others that pulled as hard as the first would crush a linear body.
    room = rod.E * np.pi * thin**2 / 20
    T[1:] = np.minimum(T[1:] * rng.uniform(0, 0.05, n - 1), room * rng.uniform(0, 1, n - 1))
    return statics, rod, T


def wanted_strain(statics: str, rod: Rod, T: Array, s: float) -> Array:
    """Return (xi, k, q) at s by the oracle."""
    if statics == "paper":
        return strain(rod, T, s, True)[1:]
    R, section = float(rod.radius(s)), rod.sections[0]
    EA, ones = rod.E * np.pi * R**2, np.ones(T.size)
    y, slope = float(section.offset(s)) * ones, float(section.slope(s)) * ones
    rubber = statics == "silicone"
    return CrossSection(EA, EA * R**2 / 4, T, y, slope, np.array(section.angles), rubber).strains()


def check_pulled(statics: str, rod: Rod, T: Array) -> float:
    """Return the worst of the strains (relative), and with the paper's statics of the tip."""
    shape = settle(arm_of(rod), T, STATICS[statics], 1e-9)
    s = rod.length * np.array([0.0, 0.3, 0.7, 1.0])
    found = shape.strain(s)[:, 1:]
    # Towards each of the tendons: another one may bend the arm across.
    phi = np.array(rod.sections[0].angles)
    towards = found[:, :1] * -np.sin(phi) + found[:, 1:2] * np.cos(phi)
    bend = towards * rod.sections[0].offset(s)[:, None]
    if statics == "paper" and bend.max() >= 1:
        raise WrongAnswerError(f"curvature is {bend.max()} times 1 / y")
    # A neo-Hookean body has lambda, and so q, to 1e-16: of strains below 1e-7 not all digits.
    least = 1e-7 if statics == "silicone" else 1e-30
    error = relative(found, np.array([wanted_strain(statics, rod, T, x) for x in s]), least)
    if statics == "paper":
        tip = poses(rod, T, [rod.length], True)[0][0]
        error = max(error, float(np.linalg.norm(shape.tip - tip)) / rod.length)
    return error


def of_any_tension(statics: str) -> Family:
    return Family(f"any tension, {statics}", 1e-8, lambda rng: pulled(rng, statics), check_pulled)


ANY_TENSION = [of_any_tension(statics) for statics in STATICS]


L, R, E = 0.3, 0.01, 110e3


def shortened(rng: np.random.Generator, statics: str) -> tuple[str, float, float]:
    """Draw the smallest 1 + q of a linear body, and the tendons' offset [m].

    A fifth of the members would be inverted, a fifth are within 1e-5 of this limit.
    """
    stretch = [rng.uniform(0, 0.5), rng.uniform(1e-6, 1e-5), -rng.uniform(1e-6, 0.3)]
    return statics, stretch[rng.choice(3, p=[0.6, 0.2, 0.2])], rng.uniform(0, 0.9) * R


def check_shortened(statics: str, stretch: float, offset: float) -> float:
    """Return the error of the length over L; tensions beyond a linear body must be refused."""
    arm = Arm(L, Linear(R, R), (Anchorage(L, Linear(offset, offset)),))
    EA = E * np.pi * R**2
    T = np.full(4, (1 - stretch) * EA / 4)
    wanted = stretch
    if statics == "silicone":
        force = T.sum() / EA
        wanted = brentq(lambda x: (x - x**-2) / 3 + force, 1e-3, 1, xtol=1e-15, rtol=1e-14)
    try:
        shape = settle(arm, T, STATICS[statics], 1e-9)
    except CollapsedError:
        if wanted <= 0:
            return 0.0
        raise
    if wanted <= 0:
        raise WrongAnswerError("settled, with no length left")
    return float(np.linalg.norm(shape.tip - [wanted * L, 0, 0])) / L


def of_compression(statics: str) -> Family:
    return Family(
        f"compression, {statics}", 1e-8, lambda rng: shortened(rng, statics), check_shortened
    )


COMPRESSION = [of_compression(statics) for statics in STATICS]
