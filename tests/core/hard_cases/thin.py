"""Long thin bars, 100 to 5000 times as long as thick, against the elastica."""

from __future__ import annotations

import numpy as np

from octoplan.model import Scene, settle
from octoplan.model.effects import TipLoad
from tests.core.effects.bars import NO_PULL, Bar, dead_elastica, follower_elastica
from tests.core.hard_cases.family import Array, Family
from tests.random_arms import log_uniform


def thin(rng: np.random.Generator) -> tuple[Bar, bool, float]:
    """Draw a bar of rubber to steel, whether its load follows the tip, and the load [N].

    Dead loads bend the tip by up to 85 degrees, followers by up to 200.
    """
    L = log_uniform(rng, 0.05, 2.0)
    radius = L / log_uniform(rng, 200.0, 1e4)
    follows = bool(rng.integers(2))
    taper = rng.uniform(0.3, 1.0) if follows else 1.0
    bar = Bar(radius, radius * taper, L, E=log_uniform(rng, 1e5, 2e11))
    unit = float(bar.EJ(L)) / L**2
    return bar, follows, unit * log_uniform(rng, 0.1, 8.0 if follows else 20.0)


def check_thin(bar: Bar, follows: bool, load: float) -> float:
    """Return the error of positions over L."""
    L = bar.length
    force = (0.0, -load if follows else load, 0.0)
    shape = settle(bar.arm, NO_PULL, Scene(TipLoad(force, follower=follows)), 1e-8)
    s = np.linspace(0, L, 9)
    gap = np.abs(shape.position(s)[:, :2] - _wanted(bar, follows, load, s))
    return float(gap.max()) / L


def _wanted(bar: Bar, follows: bool, load: float, s: Array) -> Array:
    if follows:
        return np.asarray(follower_elastica(bar, load, s))
    alpha = load * bar.length**2 / float(bar.EJ(bar.length))
    return np.asarray(dead_elastica(alpha, s, bar.length)).T


THIN = Family("long thin bars", 1e-7, thin, check_thin)
