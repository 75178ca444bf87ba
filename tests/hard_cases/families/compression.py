"""Compression: equal antagonists shorten the arm to half its length, to nothing, and beyond."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from model import Anchorage, Arm, CollapsedError, Linear, Scene, settle
from model.effects import ExactTendons, Extension
from tests.hard_cases.family import Family, WrongAnswerError

SCENES = {
    "paper": Scene(Extension()),
    "exact": Scene(Extension(), ExactTendons()),
    "silicone": Scene.silicone(),
}
L, R, E = 0.3, 0.01, 110e3


@dataclass(frozen=True)
class Member:
    """The statics, the least 1 + q that a linear body would have, and the tendons' offset [m]."""

    statics: str
    stretch: float
    offset: float


def draw(rng: np.random.Generator, statics: str) -> Member:
    """A fifth of the members would be turned inside out, a fifth are within 1e-5 of it."""
    stretch = [rng.uniform(0, 0.5), rng.uniform(1e-6, 1e-5), -rng.uniform(1e-6, 0.3)]
    return Member(statics, stretch[rng.choice(3, p=[0.6, 0.2, 0.2])], rng.uniform(0, 0.9) * R)


def check(member: Member) -> float:
    """Return the error of the length over L; what a linear body does not bear must be refused."""
    arm = Arm(L, Linear(R, R), (Anchorage(L, Linear(member.offset, member.offset)),))
    EA = E * np.pi * R**2
    T = np.full(4, (1 - member.stretch) * EA / 4)
    wanted = member.stretch
    if member.statics == "silicone":
        force = T.sum() / EA
        wanted = brentq(lambda x: (x - x**-2) / 3 + force, 1e-3, 1, xtol=1e-15, rtol=1e-14)
    try:
        shape = settle(arm, T, SCENES[member.statics], 1e-9)
    except CollapsedError:
        if wanted <= 0:
            return 0.0
        raise
    if wanted <= 0:
        raise WrongAnswerError("settled, with no length left")
    return float(np.linalg.norm(shape.tip - [wanted * L, 0, 0])) / L


def _family(statics: str) -> Family:
    return Family(f"compression, {statics}", 1e-8, lambda rng: draw(rng, statics), check)


FAMILIES = [_family(statics) for statics in SCENES]
