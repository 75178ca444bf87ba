"""Heavy loads against elastica, and stiff friction against an initial value problem."""

from __future__ import annotations

from typing import Any

import numpy as np

from octoplan.model import Scene, SnapError, settle
from octoplan.model.effects import Extension, TipLoad
from octoplan.model.extensions.friction import Friction
from tests.core.effects.bars import (
    NO_PULL,
    Bar,
    capstan,
    dead_elastica,
    elastica,
    follower_elastica,
    one_tendon,
)
from tests.core.hard_cases.family import Array, Family, WrongAnswerError
from tests.random_arms import log_uniform

# In units of E J / L2: turns the tip by 85 degrees (a dead load never reaches 90) and by 90.
DEAD, FOLLOWER = 14.7, 3.5
KINDS = ("dead", "dead, tapered", "follower", "follower, tapered", "pushed", "pushed on its axis")


def loaded(rng: np.random.Generator) -> tuple[Bar, str, tuple[float, float]]:
    """Draw a bar, the direction of its load (along, across), and the load [N].

    Axial loads are 0.5 to 1.5 times Euler's load, some exactly on the axis.
    """
    kind = str(rng.choice(KINDS))
    tip = 0.01 * (rng.uniform(0.5, 1) if kind.endswith("tapered") else 1.0)
    bar = Bar(0.01, tip, float(rng.uniform(0.2, 0.4)))
    unit = float(bar.EJ(bar.length)) / bar.length**2
    if kind.startswith("pushed"):
        tilt = 0.0 if kind.endswith("axis") else log_uniform(rng, 1e-2, 0.3)
        push = rng.uniform(0.5, 1.5) * np.pi**2 / 4 * unit
        return bar, kind, (-float(push * np.cos(tilt)), float(push * np.sin(tilt)))
    usual = DEAD if kind.startswith("dead") else FOLLOWER
    return bar, kind, (0.0, log_uniform(rng, 0.1, 20) * usual * unit)


def check_loaded(bar: Bar, kind: str, force: tuple[float, float]) -> float:
    """Return the error of positions over L; a push beyond Euler's on the axis has to be refused."""
    along, across = force
    follows = kind.startswith("follower")
    sign = -1.0 if follows else 1.0
    scene = Scene(TipLoad((along, sign * across, 0.0), follower=follows))
    euler = np.pi**2 / 4 * float(bar.EJ(bar.length)) / bar.length**2
    try:
        shape = settle(bar.arm, NO_PULL, scene, 1e-7)
    except SnapError as error:
        if across == 0 and abs(error.load_factor * along / -euler - 1) < 1e-3:
            return 0.0
        raise
    if across == 0:
        if -along > euler * (1 + 1e-6):
            raise WrongAnswerError("settled straight beyond Euler's load")
        return float(np.linalg.norm(shape.tip - [bar.length, 0, 0])) / bar.length
    s = np.linspace(0, bar.length, 9)
    gap = np.abs(shape.position(s)[:, :2] - _wanted(bar, kind, np.array(force), s).T)
    return float(gap.max()) / bar.length


def _wanted(bar: Bar, kind: str, force: Array, s: Array) -> Array:
    """Return (x, y) at s by closed forms if there are any, otherwise by shooting."""
    if kind.startswith("follower"):
        return follower_elastica(bar, force[1], s).T
    alpha = force[1] * bar.length**2 / float(bar.EJ(bar.length))
    if kind == "dead" and alpha < 300:
        return dead_elastica(alpha, s, bar.length)
    return elastica(bar, lambda s: force, shares=max(16, int(2 * alpha)))(s)[:2]


HEAVY_LOADS = Family("heavy loads", 1e-6, loaded, check_loaded)


def rubbed(rng: np.random.Generator) -> tuple[Any, ...]:
    """Draw the arguments of `capstan`.

    A third of the offsets are constant, a third change sign; a quarter has no friction.
    """
    L, base = rng.uniform(0.2, 0.4), 0.012
    tip = base * rng.uniform(0.4, 1.0)
    a = base * rng.uniform(0.2, 0.7)
    b = [min(a, 0.7 * tip), -tip * rng.uniform(0.1, 0.6), tip * rng.uniform(0.1, 0.6)]
    most = 110e3 * np.pi * tip**2 * 0.25
    mu, way = rng.uniform(0, 2) * (rng.uniform() < 0.75), int(rng.choice([1, -1]))
    # The tension of a tendon that pays out grows towards the tip, and must not crush the tip.
    pull = most * rng.uniform(0.01, 1) * (1 if way == 1 else 0.2)
    end = b[int(rng.integers(3))]
    return (base, tip), (a, end), float(L), float(pull), float(mu), way


def check_rubbed(
    radii: tuple[float, float],
    offsets: tuple[float, float],
    length: float,
    T: float,
    mu: float,
    way: int,
) -> float:
    """Return the worst error of the tip over L and of the tension there, relative."""
    scene = Scene(Extension(), Friction(mu, way))
    shape = settle(one_tendon(radii, offsets, length), [T], scene, 1e-7)
    wanted = capstan(radii, offsets, length, T, mu, way)
    # The paper's base: n is -y, so that a pull towards n bends towards -y.
    gap = np.linalg.norm(shape.tip - [wanted[0], -wanted[1], 0]) / length
    return max(float(gap), abs(shape.tension(length)[0] / wanted[3] - 1))


# Some that pay out round more than a turn end with a million times the tension of the motor.
STIFF_FRICTION = Family("stiff friction", 1e-6, rubbed, check_rubbed, refuses=True)
