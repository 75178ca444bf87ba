"""Hanging arms against a chain of links that is loaded first and pulled slowly afterwards.

Tapered arms of soft rubber hang down, in the plane of one tendon; their weight is small or large
compared with the bending stiffness, and the tendon bends the arm up to the fold at which it snaps.
"""

from __future__ import annotations

import numpy as np

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, SnapError, settle
from octoplan.model.effects import ExactTendons, Extension, Weight
from tests.core.effects.chain import Chain
from tests.core.hard_cases.family import Array, Family, WrongAnswerError
from tests.random_arms import log_uniform

G = 9.81
DOWN = ((0, -1, 0), (0, 0, 1), (-1, 0, 0))
SCENE = Scene(Extension(), ExactTendons(), Weight())
# The error of a chain of n links falls as 1 / n^2; two chains give the limit.
LINKS = 40, 80


def hung(rng: np.random.Generator) -> tuple[Array, Array, float, float, float]:
    """Draw radii and offsets at both ends [m], length [m], density [kg/m3], and tension [N].

    The tension bends the unloaded arm by 0.1 to 3 rad, if the stiffness is that of the base.
    """
    base, L = rng.uniform(0.008, 0.016), rng.uniform(0.2, 0.5)
    radii = base * np.array([1.0, rng.uniform(0.3, 1.0)])
    offsets = radii * rng.uniform(0.4, 0.9)
    density = log_uniform(rng, 300.0, 3000.0)
    EJ = Material().E * np.pi * base**4 / 4
    tension = log_uniform(rng, 0.1, 3.0) * EJ / (L * offsets[0])
    return radii, offsets, float(L), density, float(tension)


def check_hung(radii: Array, offsets: Array, L: float, density: float, tension: float) -> float:
    """Return the error of the tip over L; both programs, or neither, find a stable branch."""
    arm = Arm(
        L,
        Linear(*radii.tolist()),
        (Anchorage(L, Linear(*offsets.tolist()), (0.0,)),),
        Material(density=density),
        base_frame=DOWN,
    )
    try:
        coarse, fine = (
            _tip(radii, offsets, L, density, arm.material.E, tension, links) for links in LINKS
        )
    except AssertionError:
        coarse = fine = None
    try:
        shape = settle(arm, [tension], SCENE, 1e-7)
    except SnapError:
        if coarse is not None:
            raise
        return 0.0
    if fine is None or coarse is None:
        raise WrongAnswerError("settled beyond the fold of the chain")
    side, down = fine + (fine - coarse) / 3
    gap = [np.hypot(shape.tip[0], shape.tip[1]) - abs(side), shape.tip[2] + down]
    return float(np.linalg.norm(gap)) / L


def _tip(
    radii: Array, offsets: Array, L: float, density: float, E: float, tension: float, links: int
) -> Array:
    """Return the tip (2,) [m], sideways and down, of a chain."""
    at = (np.arange(links) + 0.5) / links
    radius = radii[0] + (radii[1] - radii[0]) * at
    offset = offsets[0] + (offsets[1] - offsets[0]) * at
    taper = np.full(links, (offsets[1] - offsets[0]) / L)
    chain = Chain(radius, offset, taper, L, E, density * G)
    return chain.pulled(np.linspace(0, tension, 17)[1:])


HANGING = Family("hanging", 1e-4, hung, check_hung)
