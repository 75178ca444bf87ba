"""Units: the same arm of a thousandth to a thousand times the size, of 1e3 to 1e9 Pa."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model import Arm, Material, Scene, conical, settle
from model.effects import ExactTendons, Extension
from planner import plan
from planner.targets import TipPosition
from tests.hard_cases.family import Array, Family, RefusedError, log_uniform

SCENES = (Scene(Extension()), Scene(Extension(), ExactTendons()), Scene.silicone())
E = 110e3


@dataclass(frozen=True, eq=False)
class Member:
    """By how much lengths and moduli grow; tensions of the arm of table 4, a scene, a maximum."""

    length: float
    modulus: float
    T: Array
    scene: Scene
    most: float


def draw(rng: np.random.Generator) -> Member:
    """Tensions are of an arm that bends by right angles, maxima a few times those."""
    T = np.ravel(rng.uniform(0, 1, (3, 4)) * [[0.2], [1], [3]]) * (rng.uniform(size=12) < 0.5)
    scene = SCENES[int(rng.integers(3))]
    modulus = log_uniform(rng, 1e3, 1e9) / E
    return Member(log_uniform(rng, 1e-3, 1e3), modulus, T, scene, 20.0)


def scaled(length: float, modulus: float) -> Arm:
    """Return the arm of table 4 in other units."""
    mm = 1e-3 * length
    rows = [(450, 7.5, 1.0), (315, 3.5, 3.5), (135, 6.0, 6.0)]
    anchorages = [(at * mm, a * mm, b * mm) for at, a, b in rows]
    return conical(450 * mm, (15 * mm, 2 * mm), anchorages, material=Material(E * modulus))


def check(member: Member) -> float:
    """Return how far the settles over L, and the planned tensions over the largest, are apart."""
    force = member.modulus * member.length**2
    arms = scaled(1.0, 1.0), scaled(member.length, member.modulus)
    first = settle(arms[0], member.T, member.scene, 1e-10)
    second = settle(arms[1], member.T * force, member.scene, 1e-10)
    L = arms[0].length
    apart = float(np.linalg.norm(second.tip / member.length - first.tip)) / L
    targets = TipPosition(tuple(first.tip)), TipPosition(tuple(first.tip * member.length))
    scene, most = member.scene, member.most
    plans = [plan(arms[0], targets[0], scene, most), plan(arms[1], targets[1], scene, most * force)]
    for one in plans:
        if not one.certificate.passed:
            raise RefusedError(one.outcome)
    T, other = (np.ravel(one.tensions) for one in plans)
    return max(apart, float(np.abs(other / force - T).max() / T.max()))


FAMILY = Family("units", 1e-10, draw, check)
