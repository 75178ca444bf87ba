"""Layouts: anchorages 1e-6 L apart; 1, 2, 10, 40 sections; 1 to 160 tendons."""

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
    """Anchorages are spread evenly, or in pairs 1e-6 L apart; 1 to 4 tendons a section."""
    L, n = rng.uniform(0.2, 0.6), int(rng.choice([1, 2, 10, 40]))
    ends = L * (1 - np.arange(n) / n)
    if rng.integers(2):
        ends[1::2] = ends[:-1:2][: ends[1::2].size] - 1e-6 * L
    radius, each = linear(0.015, 0.004, L), int(rng.integers(1, 5))
    sections = tuple(
        RodSection(float(at), linear(0.01, 0.8 * float(radius(at)), at), _angles(rng, each))
        for at in ends
    )
    rod = Rod(L, radius, sections)
    room = rod.E * np.pi * np.array([float(radius(at)) for at in ends]) ** 2
    grown = np.diff(room, prepend=0.0)
    return Member(rod, np.repeat(0.4 * grown / each, each) * rng.uniform(0, 1, n * each))


def _angles(rng: np.random.Generator, each: int) -> tuple[float, ...]:
    return tuple(rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(each) / each)


def check(member: Member) -> float:
    """Return the tip's error over L."""
    rod, T = member.rod, member.T
    shape = settle(arm_of(rod), T, Scene(Extension()), 1e-9)
    return float(np.linalg.norm(shape.tip - poses(rod, T, [rod.length], True)[0][0])) / rod.length


FAMILY = Family("layouts", 1e-8, draw, check)
