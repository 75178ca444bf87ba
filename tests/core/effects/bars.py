"""References for tests of loads: bars without tension, and loaded bars in a plane by SciPy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq, newton
from scipy.spatial.transform import Rotation
from scipy.special import ellipeinc, ellipj, ellipkinc

from octoplan.model import Anchorage, Arm, Linear, Material
from tests.core.effects.cases import Array


@dataclass(frozen=True)
class Bar:
    """A conical bar: radii at base and tip, length, material."""

    base: float = 0.01
    tip: float = 0.01
    length: float = 0.3
    E: float = 110e3
    nu: float = 0.5
    density: float = 1080.0

    @cached_property
    def arm(self) -> Arm:
        """The bar with one tendon on its axis, in the base frame of the paper."""
        return self.turned()

    def turned(self, **others: Any) -> Arm:
        """The same with other fields of Arm, such as the base's frame."""
        L, axis = self.length, Linear(0.0, 0.0)
        material = Material(self.E, self.nu, self.density)
        sections = (Anchorage(L, axis, (0.0,)),)
        return Arm(L, Linear(self.base, self.tip), sections, material, **others)

    def R(self, s: Any) -> Any:
        return self.base + (self.tip - self.base) * s / self.length

    def A(self, s: Any) -> Any:
        return np.pi * self.R(s) ** 2

    def EJ(self, s: Any) -> Any:
        return self.E * np.pi * self.R(s) ** 4 / 4

    def GI(self, s: Any) -> Any:
        return self.EJ(s) / (1 + self.nu)

    def volume(self, s: Any) -> Any:
        """The volume of the frustum beyond s."""
        near, far = self.R(s), self.tip
        return np.pi * (self.length - s) / 3 * (near**2 + near * far + far**2)

    def deflection(self, load: Callable[[float], float]) -> float:
        """Return the tip deflection under a transverse line load, by the unit load theorem."""
        L = self.length

        def part(s: float) -> float:
            return quad(lambda x: load(x) * (x - s), s, L)[0] * (L - s) / self.EJ(s)

        return float(quad(part, 0, L, epsrel=1e-12)[0])


def helix(rate: Array, t: Array, s: float) -> Array:
    """Return the end of a curve that starts along t and turns at a constant rate (3,) [1/m]."""
    size = np.linalg.norm(rate)
    axis = rate / size
    along = axis * (axis @ t)
    across = (t - along) * np.sin(size * s) / size
    return np.asarray(along * s + across + np.cross(axis, t) * (1 - np.cos(size * s)) / size)


NO_PULL = [0.0]


def elastica(
    bar: Bar,
    force: Callable[[float], Array],
    moment: float = 0.0,
    spread: Callable[[float, Array], Array] | None = None,
    extension: bool = False,
    breaks: tuple[float, ...] = (),
    shares: int = 4,
) -> Callable[[Array], Array]:
    """Return s -> (x, y, angle) (3, N) of a bar clamped along x, by shooting from the tip.

    `force(s)` is the dead force (2,) beyond s, which jumps at `breaks`, `moment` the moment at the
    tip, `spread(s, t)` further loads per unit deformed length. Loads are applied in equal steps.
    """
    stops = [bar.length, *sorted(breaks, reverse=True), 0.0]

    def run(angle: float, share: float) -> list[Any]:
        def rate(s: float, state: Array, beyond: Array) -> Array:
            t = np.array([np.cos(state[2]), np.sin(state[2])])
            F = share * (force(s) if not breaks else beyond) + state[4:]
            stretch = 1 + extension * (t @ F) / (bar.E * bar.A(s))
            more = share * spread(s, t) if spread else np.zeros(2)
            rows = [*t, state[3] / bar.EJ(s), t[1] * F[0] - t[0] * F[1], *-more]
            return stretch * np.array(rows)

        state = np.array([0.0, 0.0, angle, share * moment, 0.0, 0.0])
        pieces = []
        for high, low in pairwise(stops):
            beyond = force((low + high) / 2)
            args = {"rtol": 1e-11, "atol": 1e-13, "dense_output": True, "args": (beyond,)}
            pieces.append(solve_ivp(rate, (high, low), state, "DOP853", **args))
            state = pieces[-1].y[:, -1]
        return pieces

    angle = 0.0
    for share in np.linspace(0, 1, shares + 1)[1:]:
        angle = newton(
            lambda a, share=share: run(a, share)[-1].y[2, -1], angle, x1=angle + 1e-3, tol=1e-11
        )
    pieces = run(angle, 1.0)
    base = np.array([*pieces[-1].y[:2, -1], 0.0])

    def at(s: Array) -> Array:
        piece = np.clip(np.searchsorted(-np.array(stops), -s, side="left") - 1, 0, len(pieces) - 1)
        return np.array([pieces[i].sol(x)[:3] - base for i, x in zip(piece, s, strict=True)]).T

    return at


def euler(bar: Bar) -> float:
    """The least load along a cantilever at which EJ w'' + F w = 0 has a solution [N]."""

    def clamp(load: float) -> float:
        def rate(s: float, y: Array) -> Array:
            return np.array([y[1], -load * y[0] / bar.EJ(s)])

        run = solve_ivp(rate, (bar.length, 0), [0.0, -1.0], "DOP853", rtol=1e-11, atol=1e-14)
        return float(run.y[1, -1])

    unit = bar.EJ(0.0) / bar.length**2
    low, high = 0.05 * unit, 3 * unit
    loads = np.linspace(low, high, 60)
    first = next(b for b in loads if clamp(b) > 0)
    return float(brentq(clamp, low, first, xtol=1e-14))


def dead_elastica(alpha: float, s: Array, length: float) -> Array:
    """Return (x, y) of a bar under a dead transverse force alpha EJ / L2 (Bisshopp 1945)."""

    def first(m: float) -> float:
        return float(np.arcsin(1 / np.sqrt(2 * m)))

    def gap(turned: float) -> float:
        m = (1 + np.sin(turned)) / 2
        return float(ellipkinc(np.pi / 2, m) - ellipkinc(first(m), m) - np.sqrt(alpha))

    m = (1 + np.sin(brentq(gap, 1e-12, np.pi / 2 - 1e-12, xtol=1e-16, rtol=1e-15))) / 2
    start, root = first(m), np.sqrt(alpha)
    u = ellipkinc(start, m) + root * s / length
    phi = ellipj(u, m)[3]
    x = 2 * np.sqrt(m) * (np.cos(start) - np.cos(phi))
    y = root * s / length - 2 * (ellipeinc(phi, m) - ellipeinc(start, m))
    return length / root * np.array([x, y])


def follower_elastica(bar: Bar, force: float, s: Array) -> Array:
    """Return (x, y) under a transverse follower force on the tip, in the tip frame."""

    def rate(s: float, state: Array) -> Array:
        angle, bend = state[2:]
        return np.array([np.cos(angle), np.sin(angle), bend / bar.EJ(s), -np.cos(angle) * force])

    run = solve_ivp(
        rate, (bar.length, 0), np.zeros(4), "DOP853", rtol=1e-12, atol=1e-15, dense_output=True
    )
    turn = Rotation.from_euler("z", -run.y[2, -1]).as_matrix()[:2, :2]
    return (turn @ (run.sol(s)[:2] - run.y[:2, -1:])).T


def one_tendon(
    radii: tuple[float, float], offsets: tuple[float, float], length: float = 0.3
) -> Arm:
    """Return an arm with one tendon in a plane; radii and offsets are given at both ends."""
    return Arm(length, Linear(*radii), (Anchorage(length, Linear(*offsets), (0.0,)),))


def capstan(
    radii: tuple[float, float],
    offsets: tuple[float, float],
    length: float,
    T: float,
    mu: float,
    way: int,
    extension: bool = True,
) -> Array:
    """Return (x, y, angle, T) at the tip of an arm with one tendon, from base to tip.

    With c = (1 - y k) t + y' n the tendon is at the angle psi = atan2(y', 1 - y k) to t and turns
    at the rate (1 + q) k + psi'. The derivative k' depends on T', and T' = -way mu T |turning|.
    """
    E = Bar.E
    (R0, R1), (a, b) = radii, offsets
    taper, slope = (R1 - R0) / length, (b - a) / length

    def rate(s: float, state: Array) -> Array:
        _, _, angle, pull = state
        R, y = R0 + taper * s, a + slope * s
        EJ, EJ_rate = E * np.pi * R**4 / 4, E * np.pi * R**3 * taper
        D = EJ + y**2 * pull
        k = pull * y / D
        q = -pull * (1 - y * k) / (E * np.pi * R**2) if extension else 0.0
        k_pull = y * EJ / D**2
        k_s = (pull * slope - k * (EJ_rate + 2 * y * slope * pull)) / D
        # psi' = y' (y k)' / ((1 - y k)^2 + y'^2), as y'' = 0.
        size = (1 - y * k) ** 2 + slope**2
        psi_pull, psi_s = slope * y * k_pull / size, slope * (slope * k + y * k_s) / size
        still = (1 + q) * k + psi_s
        rub = way * mu * pull * np.sign(still)
        pull_rate = -rub * still / (1 + rub * psi_pull)
        assert (still + psi_pull * pull_rate) * still >= 0
        return np.array([*(1 + q) * np.array([np.cos(angle), np.sin(angle), k]), pull_rate])

    stops, state = [0.0, length], np.array([0.0, 0.0, 0.0, T])
    if a * b < 0:
        stops.insert(1, length * a / (a - b))
    for ends in pairwise(stops):
        state = solve_ivp(rate, ends, state, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    return np.asarray(state)
