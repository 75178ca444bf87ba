"""Arms of difficult shapes: slender tips, many turns, layouts of anchorages and tendons.

The radius at the tip is 1/5 to 1/1000 of the radius at the base, and E J 1e12 times smaller; arms
curl up to five times round; anchorages 1e-6 L apart, 1, 2, 10, 40 sections, 1 to 160 tendons.
"""

from __future__ import annotations

import numpy as np

from octoplan.model import Scene, settle
from octoplan.model.effects import Extension
from tests.core.hard_cases.family import Array, Family, relative
from tests.core.model.cases import arm_of, mild_tensions
from tests.oracles import Rod, RodSection, linear, poses, strain
from tests.random_arms import log_uniform


def slender(rng: np.random.Generator) -> tuple[Rod, Array]:
    """One to four sections; tendons at a tenth to 0.9 of the radius, at both ends."""
    L, thick = rng.uniform(0.1, 0.6), rng.uniform(8e-3, 20e-3)
    radius = linear(thick, thick * log_uniform(rng, 1e-3, 0.2), L)
    ends = [L, *(L * np.sort(rng.uniform(0.1, 0.95, rng.integers(0, 4)))[::-1])]
    sections = []
    for at in ends:
        a, b = rng.uniform(0.1, 0.9, 2) * [thick, float(radius(at))]
        sections.append(RodSection(float(at), linear(a, b, at)))
    rod = Rod(L, radius, tuple(sections))
    return rod, mild_tensions(rng, rod)


def check_strains_and_tip(rod: Rod, T: Array) -> float:
    """Return the worst of strains (relative) and of the tip (over L)."""
    shape = settle(arm_of(rod), T, Scene(Extension()), 1e-9)
    s = rod.length * (1 - np.array([0.0, 1e-6, 1e-3, 0.1, 0.5, 0.9, 1.0]))
    wanted = np.array([strain(rod, T, x, True) for x in s])
    tip = poses(rod, T, [rod.length], True)[0][0]
    gap = np.linalg.norm(shape.tip - tip) / rod.length
    return max(relative(shape.strain(s), wanted), float(gap))


SLENDER = Family("slender tips", 1e-8, slender, check_strains_and_tip)


def curled(rng: np.random.Generator) -> tuple[Rod, Array]:
    """A long arm, mostly curled about one axis; a second section bends the arm out of its plane."""
    L, turns = 0.6, rng.uniform(1, 5)
    R = L / 100
    radius = linear(R, R * rng.uniform(0.5, 1), L)
    sections = [RodSection(L, linear(0.9 * R, 0.9 * float(radius(L)), L), (rng.uniform(0, 6),))]
    at = L * rng.uniform(0.3, 0.7)
    sections.append(RodSection(at, linear(0.5 * R, 0.4 * R, at), (rng.uniform(0, 6),)))
    rod, y = Rod(L, radius, tuple(sections)), 0.9 * R
    bent = 2 * np.pi * turns / L * y
    pull = bent / (1 - bent) * rod.E * np.pi * R**4 / 4 / y**2
    return rod, np.array([pull, pull * rng.uniform(0, 0.1)])


def check_tip_and_frames(rod: Rod, T: Array) -> float:
    """Return the tip's error over L; frames 1e5 times as sharp, to 1e-13."""
    shape = settle(arm_of(rod), T, Scene(Extension()), 1e-9)
    frames = shape.frame(np.linspace(0, rod.length, 101))
    skew = np.abs(np.swapaxes(frames, 1, 2) @ frames - np.eye(3)).max()
    tip = poses(rod, T, [rod.length], True)[0][0]
    return max(float(np.linalg.norm(shape.tip - tip)) / rod.length, float(skew) * 1e5)


CURLED = Family("many turns", 1e-8, curled, check_tip_and_frames)


def laid_out(rng: np.random.Generator) -> tuple[Rod, Array]:
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
    return rod, np.repeat(0.4 * grown / each, each) * rng.uniform(0, 1, n * each)


def _angles(rng: np.random.Generator, each: int) -> tuple[float, ...]:
    return tuple(rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(each) / each)


def check_tip(rod: Rod, T: Array) -> float:
    """Return the tip's error over L."""
    shape = settle(arm_of(rod), T, Scene(Extension()), 1e-9)
    return float(np.linalg.norm(shape.tip - poses(rod, T, [rod.length], True)[0][0])) / rod.length


LAYOUTS = Family("layouts", 1e-8, laid_out, check_tip)
