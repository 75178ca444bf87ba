"""Random tensions that an arm bears, for the studies."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import numpy as np

from model import Arm, CollapsedError, OctoplanError, Scene, Shape, conical, settle
from model.effects import Buoyancy, Extension, Weight
from model.paths import Array

# The most that a tendon pulls in plans [N], and the scenes that they are drawn in.
MAXIMUM = 20.0
SCENES = {
    "paper": Scene(Extension()),
    "silicone": Scene.silicone(),
    "silicone-in-water": Scene.silicone(Weight(), Buoyancy()),
}
# The share of what would crush the arm that all tendons at their most would pull.
_SHARE = 0.8


def most(arm: Arm) -> Array:
    """Return the most that each tendon is to pull [N], so that they strain all sections alike.

    Pulls add up from the tip to the base, as the sections grow from the tip to the base.
    """
    at = np.array([section.at for section in arm.sections])
    EA = arm.material.E * np.pi * arm.radius.evaluate(at, arm.length)[0] ** 2
    count = np.array([len(section.angles) for section in arm.sections])
    return np.repeat(_SHARE * np.diff(EA, prepend=0.0) / count, count)


def tensions(arm: Arm, rng: np.random.Generator, scale: float = 1.0, slack: float = 0.0) -> Array:
    """Return tensions (n_tendons,) [N] that settle, uniform up to `scale` times the most.

    `slack` is the share of tendons that do not pull.
    """
    while True:
        T = scale * most(arm) * rng.uniform(size=arm.n_tendons)
        T[rng.uniform(size=T.size) < slack] = 0.0
        try:
            settle(arm, T, Scene(Extension()), 1e-3)
        except CollapsedError:
            continue
        return T


def endless(arm: Arm, rng: np.random.Generator) -> Iterator[Array]:
    """Yield sets of tensions (n_tendons,) [N]."""
    while True:
        yield tensions(arm, rng)


def rows(arm: Arm, rng: np.random.Generator, count: int) -> Array:
    """Return `count` sets of tensions (count, n_tendons) [N]."""
    return np.array(list(islice(endless(arm, rng), count)))


def many_sections(n: int) -> Arm:
    """Return the body of table 4 with n sections of four tendons, which run at half the radius."""
    L, base, tip = 0.45, 15e-3, 2e-3
    ends = [L * (1 - i / n) for i in range(n)]
    offsets = [(base + (tip - base) * at / L) / 2 for at in ends]
    anchorages = [(at, base / 2, offset) for at, offset in zip(ends, offsets, strict=True)]
    return conical(L, (base, tip), anchorages)


def shape(arm: Arm, scene: Scene, rng: np.random.Generator, kind: int) -> Shape:
    """Return a settled shape of the arm of table 4 or 2 under random tensions.

    Of kind 0 each tendon is slack or pulls up to 1, 20, 20 N, tip section first; of kind 1 one
    tendon a section pulls; of kind 2 all do, up to 0.5, 4, 13 N. Tensions that the arm does not
    bear are drawn again.
    """
    while True:
        if kind == 0:
            scale = np.array([1.0, 20.0, 20.0])[:, None]
            T = rng.uniform(size=(3, 4)) * scale * (rng.uniform(size=(3, 4)) < 0.5)
        elif kind == 1:
            T = np.zeros((3, 4))
            T[np.arange(3), rng.integers(4, size=3)] = rng.uniform(size=3) * [0.6, 5.0, 15.0]
        else:
            T = rng.uniform(size=(3, 4)) * np.array([0.5, 4.0, 13.0])[:, None]
        try:
            return settle(arm, T, scene)
        except OctoplanError:
            continue
