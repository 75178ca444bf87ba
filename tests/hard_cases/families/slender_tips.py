"""Slender tips: the radius at the tip is 1/5 to 1/1000 of that at the base, E J 1e12 times less."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model import Scene, settle
from model.effects import Extension
from tests.hard_cases.family import Array, Family, log_uniform, relative
from tests.model.cases import arm_of, mild_tensions
from tests.oracles import Rod, RodSection, linear, poses, strain


@dataclass(frozen=True, eq=False)
class Member:
    """A rod and its tensions."""

    rod: Rod
    T: Array


def draw(rng: np.random.Generator) -> Member:
    """One to four sections; tendons at a tenth to 0.9 of the radius, at both of their ends."""
    L, thick = rng.uniform(0.1, 0.6), rng.uniform(8e-3, 20e-3)
    radius = linear(thick, thick * log_uniform(rng, 1e-3, 0.2), L)
    ends = [L, *(L * np.sort(rng.uniform(0.1, 0.95, rng.integers(0, 4)))[::-1])]
    sections = []
    for at in ends:
        a, b = rng.uniform(0.1, 0.9, 2) * [thick, float(radius(at))]
        sections.append(RodSection(float(at), linear(a, b, at)))
    rod = Rod(L, radius, tuple(sections))
    return Member(rod, mild_tensions(rng, rod))


def check(member: Member) -> float:
    """Return the worst of strains (relative) and of the tip (over L)."""
    rod, T = member.rod, member.T
    shape = settle(arm_of(rod), T, Scene(Extension()), 1e-9)
    s = rod.length * (1 - np.array([0.0, 1e-6, 1e-3, 0.1, 0.5, 0.9, 1.0]))
    wanted = np.array([strain(rod, T, x, True) for x in s])
    tip = poses(rod, T, [rod.length], True)[0][0]
    gap = np.linalg.norm(shape.tip - tip) / rod.length
    return max(relative(shape.strain(s), wanted), float(gap))


FAMILY = Family("slender tips", 1e-8, draw, check)
