"""Many turns: arms that curl up to five times round."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model import Scene, settle
from model.effects import Extension
from tests.hard_cases.family import Array, Family
from tests.model.cases import arm_of
from tests.oracles import Rod, RodSection, linear, poses


@dataclass(frozen=True, eq=False)
class Member:
    """A rod and its tensions."""

    rod: Rod
    T: Array


def draw(rng: np.random.Generator) -> Member:
    """A long arm, mostly curled about one axis, out of its plane by a second section."""
    L, turns = 0.6, rng.uniform(1, 5)
    R = L / 100
    radius = linear(R, R * rng.uniform(0.5, 1), L)
    sections = [RodSection(L, linear(0.9 * R, 0.9 * float(radius(L)), L), (rng.uniform(0, 6),))]
    at = L * rng.uniform(0.3, 0.7)
    sections.append(RodSection(at, linear(0.5 * R, 0.4 * R, at), (rng.uniform(0, 6),)))
    rod, y = Rod(L, radius, tuple(sections)), 0.9 * R
    bent = 2 * np.pi * turns / L * y
    pull = bent / (1 - bent) * rod.E * np.pi * R**4 / 4 / y**2
    return Member(rod, np.array([pull, pull * rng.uniform(0, 0.1)]))


def check(member: Member) -> float:
    """Return the tip's error over L; frames 1e5 times as sharp, to 1e-13."""
    rod, T = member.rod, member.T
    shape = settle(arm_of(rod), T, Scene(Extension()), 1e-9)
    frames = shape.frame(np.linspace(0, rod.length, 101))
    skew = np.abs(np.swapaxes(frames, 1, 2) @ frames - np.eye(3)).max()
    tip = poses(rod, T, [rod.length], True)[0][0]
    return max(float(np.linalg.norm(shape.tip - tip)) / rod.length, float(skew) * 1e5)


FAMILY = Family("many turns", 1e-8, draw, check)
