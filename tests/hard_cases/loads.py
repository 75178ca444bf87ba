"""Heavy loads against elastica, and stiff friction against an initial value problem."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from model import Anchorage, Arm, Linear, Scene, SnapError, settle
from model.effects import Extension, Friction, TipLoad
from tests.effects.bars import NO_PULL, Bar, dead_elastica, elastica, follower_elastica
from tests.hard_cases.family import Array, Family, WrongAnswerError
from tests.random_arms import log_uniform

# Of E J / L2: what turns the tip by 85 degrees (a dead load never reaches 90) and by 90.
DEAD, FOLLOWER = 14.7, 3.5
KINDS = ("dead", "dead, tapered", "follower", "follower, tapered", "pushed", "pushed on its axis")


@dataclass(frozen=True)
class Loaded:
    """A bar, which way it is loaded, and the load (along, across) [N]."""

    bar: Bar
    kind: str
    force: tuple[float, float]


def loaded(rng: np.random.Generator) -> Loaded:
    """Pushes are 0.5 to 1.5 times Euler's load, some exactly on the axis."""
    kind = str(rng.choice(KINDS))
    tip = 0.01 * (rng.uniform(0.5, 1) if kind.endswith("tapered") else 1.0)
    bar = Bar(0.01, tip, float(rng.uniform(0.2, 0.4)))
    unit = float(bar.EJ(bar.length)) / bar.length**2
    if kind.startswith("pushed"):
        tilt = 0.0 if kind.endswith("axis") else log_uniform(rng, 1e-2, 0.3)
        push = rng.uniform(0.5, 1.5) * np.pi**2 / 4 * unit
        return Loaded(bar, kind, (-float(push * np.cos(tilt)), float(push * np.sin(tilt))))
    usual = DEAD if kind.startswith("dead") else FOLLOWER
    return Loaded(bar, kind, (0.0, log_uniform(rng, 0.1, 20) * usual * unit))


def check_loaded(member: Loaded) -> float:
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


def _wanted(member: Loaded, s: Array) -> Array:
    """Return (x, y) at s by closed forms where there are any, else by shooting."""
    bar, force = member.bar, np.array(member.force)
    if member.kind.startswith("follower"):
        return follower_elastica(bar, force[1], s).T
    alpha = force[1] * bar.length**2 / float(bar.EJ(bar.length))
    if member.kind == "dead" and alpha < 200:
        return dead_elastica(alpha, s, bar.length)
    return elastica(bar, lambda s: force, shares=max(16, int(2 * alpha)))(s)[:2]


HEAVY_LOADS = Family("heavy loads", 1e-6, loaded, check_loaded)


E = 110e3


@dataclass(frozen=True)
class Rubbed:
    """Radii, offsets at base and tip [m], length [m], pull [N], mu, the way it slides."""

    radii: tuple[float, float]
    offsets: tuple[float, float]
    length: float
    T: float
    mu: float
    way: int


def rubbed(rng: np.random.Generator) -> Rubbed:
    """A third of the offsets are constant, a third change sign; a quarter has no friction."""
    L, base = rng.uniform(0.2, 0.4), 0.012
    tip = base * rng.uniform(0.4, 1.0)
    a = base * rng.uniform(0.2, 0.7)
    b = [min(a, 0.7 * tip), -tip * rng.uniform(0.1, 0.6), tip * rng.uniform(0.1, 0.6)]
    most = E * np.pi * tip**2 * 0.25
    mu, way = rng.uniform(0, 2) * (rng.uniform() < 0.75), int(rng.choice([1, -1]))
    # What pays out grows towards the tip: it must not crush it.
    pull = most * rng.uniform(0.01, 1) * (1 if way == 1 else 0.2)
    end = b[int(rng.integers(3))]
    return Rubbed((base, tip), (a, end), float(L), float(pull), float(mu), way)


def planar(member: Rubbed) -> Array:
    """(x, y, angle of the tip, T there), from base to tip: the capstan law along the tendon.

    With c = (1 - y k) t + y' n the tendon is at the angle psi = atan2(y', 1 - y k) to t and turns
    at the rate (1 + q) k + psi', where k' has a part in T', and T' = -way mu T |turning|. Which way
    the tendon turns is found by trying both.
    """
    (R0, R1), (a, b), L = member.radii, member.offsets, member.length
    taper, slope, mu = (R1 - R0) / L, (b - a) / L, member.way * member.mu

    def rate(s: float, state: Array) -> Array:
        _, _, angle, T = state
        R, y = R0 + taper * s, a + slope * s
        EJ, EJ_rate = E * np.pi * R**4 / 4, E * np.pi * R**3 * taper
        D = EJ + y**2 * T
        k = T * y / D
        stretch = 1 - T * (1 - y * k) / (E * np.pi * R**2)
        k_T = y * EJ / D**2
        k_s = (T * slope - k * (EJ_rate + 2 * y * slope * T)) / D
        # psi' = y' (y k)' / ((1 - y k)^2 + y'^2), as y'' = 0.
        lever = slope / ((1 - y * k) ** 2 + slope**2)
        turn_s, turn_T = stretch * k + lever * (slope * k + y * k_s), lever * y * k_T
        # turn = turn_s + turn_T T', T' = -mu T |turn|.
        sign = np.sign(turn_s)
        turn = turn_s / (1 + mu * T * sign * turn_T)
        along = np.array([np.cos(angle), np.sin(angle)])
        return np.array([*(stretch * along), stretch * k, -mu * T * abs(turn)])

    stops, state = [0.0, L], np.array([0.0, 0.0, 0.0, member.T])
    if a * b < 0:
        stops.insert(1, L * a / (a - b))
    for low, high in pairwise(stops):
        args = {"rtol": 1e-10, "atol": 1e-13, "max_step": L / 200}
        state = solve_ivp(rate, (low, high), state, "DOP853", **args).y[:, -1]
    return np.asarray(state)


def check_rubbed(member: Rubbed) -> float:
    """Return the worst error of the tip over L and of the tension there, relative."""
    L = member.length
    arm = Arm(L, Linear(*member.radii), (Anchorage(L, Linear(*member.offsets), (0.0,)),))
    scene = Scene(Extension(), Friction(member.mu, member.way))
    shape = settle(arm, [member.T], scene, 1e-7)
    wanted = planar(member)
    # The paper's base: n is -y, so that a pull towards n bends towards -y.
    gap = np.linalg.norm(shape.tip - [wanted[0], -wanted[1], 0]) / L
    return max(float(gap), abs(shape.tension(shape.arm.length)[0] / wanted[3] - 1))


# Some that pay out round more than a turn end with a million times the tension of the motor.
STIFF_FRICTION = Family("stiff friction", 1e-6, rubbed, check_rubbed, refuses=True)
