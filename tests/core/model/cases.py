"""Arms and tensions to test with: rods of the oracles and the same as arms of the model."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline, PPoly
from scipy.spatial.transform import Rotation

from octoplan.model import Anchorage, Arm, Linear, Material, Sampled
from octoplan.model.paths import Path
from tests.oracles import Array, Rod, RodSection, least_stretch, linear, paper_rod, sampled

MOST = {"table-2": (2.0, 4.0, 10.0), "table-4": (0.4, 3.0, 8.0)}


def arm_of(rod: Rod) -> Arm:
    """Return the model's arm with the numbers of a rod."""
    sections = [Anchorage(x.at, path_of(x.offset), x.angles) for x in rod.sections]
    return Arm(
        rod.length,
        path_of(rod.radius),
        tuple(sections),
        Material(rod.E, rod.nu),
        tuple(map(tuple, rod.frame)),
        tuple(rod.position),
    )


def path_of(profile: PPoly) -> Path:
    """Return the model's path with the numbers of a profile."""
    if isinstance(profile, CubicSpline):
        return Sampled(tuple(profile.x), tuple(profile(profile.x)))
    return Linear(float(profile(profile.x[0])), float(profile(profile.x[-1])))


def random_rod(rng: np.random.Generator) -> Rod:
    """Return a rod of 1 to 6 sections with 1 to 5 tendons each at any angle; half are sampled."""
    L, thick = rng.uniform(0.1, 0.6), rng.uniform(8e-3, 20e-3)
    thin = thick * rng.uniform(0.15, 1.0)
    curved = rng.integers(2) == 0
    if curved:
        s = np.linspace(0, L, 9)
        radius = sampled(s, thin + (thick - thin) * np.cos(np.pi / 2 * s / L) ** 2)
    else:
        radius = linear(thick, thin, L)
    n = rng.integers(1, 7)
    ends = L * np.sort(rng.permutation(np.arange(2, 10))[:n] / 10 + rng.uniform(0, 0.05, n))[::-1]
    if rng.integers(2):
        ends[0] = L
    sections = []
    for at in ends:
        wide, narrow = rng.uniform(0.1, 0.9) * thin, rng.uniform(0.1, 0.9) * float(radius(at))
        offset = linear(wide, narrow, at)
        if curved:
            places = np.linspace(0, at, 6)
            offset = sampled(places, wide * (1 + 0.1 * np.sin(4 * places / at)))
        sections.append(RodSection(at, offset, tuple(rng.uniform(-4, 4, rng.integers(1, 6)))))
    frame = Rotation.random(random_state=rng).as_matrix()
    E, nu = rng.uniform(5e4, 1e6), rng.uniform(-0.3, 0.5)
    return Rod(L, radius, tuple(sections), E, nu, frame, rng.uniform(-1, 1, 3))


def mild_tensions(rng: np.random.Generator, rod: Rod) -> Array:
    """Return tensions that shorten no section by more than some 0.4; some are slack."""
    counts = [len(section.angles) for section in rod.sections]
    T = rng.uniform(0, 1, sum(counts))
    T[1:] *= rng.uniform(0, 1, T.size - 1) < 0.8
    worth = [rod.E * np.pi * float(rod.radius(section.at)) ** 2 for section in rod.sections]
    return T * 0.4 / sum(counts) * np.repeat(worth, counts)


def paper_tensions(rng: np.random.Generator, name: str) -> Array:
    """Return random tensions (12,) on an arm of the paper that leave 1 + q above 0."""
    while True:
        T = np.ravel(rng.uniform(0, 1, (3, 4)) * np.array(MOST[name])[:, None])
        if least_stretch(paper_rod(name), T) > 0:
            return T
