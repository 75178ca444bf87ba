"""Heavy loads: up to twenty times what bends a bar through 90 degrees, and near buckling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model import Scene, SnapError, settle
from model.effects import TipLoad
from tests.effects.bars import NO_PULL, Bar, dead_elastica, elastica, follower_elastica
from tests.hard_cases.family import Array, Family, WrongAnswerError, log_uniform

# Of E J / L2: what turns the tip by 85 degrees (a dead load never reaches 90) and by 90.
DEAD, FOLLOWER = 14.7, 3.5
KINDS = ("dead", "dead, tapered", "follower", "follower, tapered", "pushed", "pushed on its axis")


@dataclass(frozen=True)
class Member:
    """A bar, which way it is loaded, and the load (along, across) [N]."""

    bar: Bar
    kind: str
    force: tuple[float, float]


def draw(rng: np.random.Generator) -> Member:
    """Pushes are 0.5 to 1.5 times Euler's load, some exactly on the axis."""
    kind = str(rng.choice(KINDS))
    tip = 0.01 * (rng.uniform(0.5, 1) if kind.endswith("tapered") else 1.0)
    bar = Bar(0.01, tip, float(rng.uniform(0.2, 0.4)))
    unit = float(bar.EJ(bar.length)) / bar.length**2
    if kind.startswith("pushed"):
        tilt = 0.0 if kind.endswith("axis") else log_uniform(rng, 1e-2, 0.3)
        push = rng.uniform(0.5, 1.5) * np.pi**2 / 4 * unit
        return Member(bar, kind, (-float(push * np.cos(tilt)), float(push * np.sin(tilt))))
    usual = DEAD if kind.startswith("dead") else FOLLOWER
    return Member(bar, kind, (0.0, log_uniform(rng, 0.1, 20) * usual * unit))


def check(member: Member) -> float:
    """Return the error of positions over L; a push beyond Euler's on the axis has to be refused."""
    bar, (along, across) = member.bar, member.force
    follows = member.kind.startswith("follower")
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
    gap = np.abs(shape.position(s)[:, :2] - _wanted(member, s).T)
    return float(gap.max()) / bar.length


def _wanted(member: Member, s: Array) -> Array:
    """Return (x, y) at s by closed forms where there are any, else by shooting."""
    bar, force = member.bar, np.array(member.force)
    if member.kind.startswith("follower"):
        return follower_elastica(bar, force[1], s).T
    alpha = force[1] * bar.length**2 / float(bar.EJ(bar.length))
    if member.kind == "dead" and alpha < 200:
        return dead_elastica(alpha, s, bar.length)
    return elastica(bar, lambda s: force, shares=max(16, int(2 * alpha)))(s)[:2]


FAMILY = Family("heavy loads", 1e-6, draw, check)
