"""Closed forms and reference integrations in NumPy and SciPy, as references for tests.

No reference imports the project. Source: the paper's equations (1), (3), (5) to (11), with the
moment balance of a cross-section solved as a full 3x3 system and poses integrated by DOP853.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline, PPoly

Array = NDArray[np.float64]
T_AXIS = np.array([1.0, 0.0, 0.0])
PAPER_BASE = np.diag([1.0, -1.0, -1.0])
QUARTER_TURNS = (0.0, np.pi / 2, np.pi, 3 * np.pi / 2)


def linear(start: float, end: float, span: float) -> PPoly:
    """Return the profile from start at s = 0 to end at s = span."""
    return PPoly([[(end - start) / span], [start]], [0.0, span])


def sampled(s: Sequence[float], values: Sequence[float]) -> PPoly:
    """Return the not-a-knot cubic spline through samples."""
    return CubicSpline(s, values, bc_type="not-a-knot")


@dataclass(frozen=True, eq=False)
class RodSection:
    """Tendons that end at one cross-section: (cos phi) n + (sin phi) b is the side of each."""

    at: float
    offset: PPoly
    angles: tuple[float, ...] = QUARTER_TURNS

    @cached_property
    def slope(self) -> PPoly:
        """The derivative of the offset along s."""
        return self.offset.derivative()


@dataclass(frozen=True, eq=False)
class Rod:
    """A tapered rod with tendons, sections from tip to base."""

    length: float
    radius: PPoly
    sections: tuple[RodSection, ...]
    E: float = 110e3
    nu: float = 0.5
    frame: Array = field(default_factory=PAPER_BASE.copy)
    position: Array = field(default_factory=lambda: np.zeros(3))

    def active(self, s: float) -> int:
        """Return the number of sections with tendons at s; an anchorage counts on its base side."""
        return sum(section.at >= s for section in self.sections)

    def breaks(self) -> Array:
        """Return places at which strains are not smooth, and both ends."""
        paths = [self.radius, *(section.offset for section in self.sections)]
        places = [0.0, self.length, *(section.at for section in self.sections)]
        places += [x for path in paths for x in path.x if 0 < x < self.length]
        return np.unique(places)


def paper_rod(name: str) -> Rod:
    """Return the arm of table 2 or 4 of the paper."""
    mm = 1e-3
    L, tip, ends = {
        "table-2": (310 * mm, 6.5 * mm, (217 * mm, 93 * mm)),
        "table-4": (450 * mm, 2.0 * mm, (315 * mm, 135 * mm)),
    }[name]
    rows = [(L, 7.5 * mm, 1.0 * mm), (ends[0], 3.5 * mm, 3.5 * mm), (ends[1], 6 * mm, 6 * mm)]
    sections = tuple(RodSection(at, linear(a, b, at)) for at, a, b in rows)
    return Rod(L, linear(15 * mm, tip, L), sections)


def crossing(rod: Rod, T: Array, s: float, active: int) -> Iterator[tuple[float, float, Array]]:
    """Yield tension, offset and side of each tendon of the first `active` sections."""
    tension = iter(T)
    for section in rod.sections[:active]:
        y = float(section.offset(s))
        for phi in section.angles:
            yield float(next(tension)), y, np.array([0.0, np.cos(phi), np.sin(phi)])


def body_stiffness(rod: Rod, s: float) -> Array:
    """Return G I, E J, E J of eq. (7)."""
    R = float(rod.radius(s))
    J = np.pi * R**4 / 4
    return np.array([rod.E / (2 * (1 + rod.nu)) * 2 * J, rod.E * J, rod.E * J])


def balance(rod: Rod, T: Array, s: float, active: int) -> tuple[Array, Array]:
    """Return D and m of D omega = m, moment balance with the tangent t + y' d + y omega x d."""
    D, m = np.diag(body_stiffness(rod, s)), np.zeros(3)
    for pull, y, d in crossing(rod, T, s, active):
        D += pull * y**2 * (np.eye(3) - np.outer(d, d))
        m += pull * y * np.array([0.0, -d[2], d[1]])
    return D, m


def strain(rod: Rod, T: Array, s: float, extension: bool, active: int | None = None) -> Array:
    """Return (tau, xi, k, q) at s."""
    active = rod.active(s) if active is None else active
    omega = np.linalg.solve(*balance(rod, T, s, active))
    return np.append(omega, axial(rod, T, s, omega, active) if extension else 0.0)


def axial(rod: Rod, T: Array, s: float, omega: Array, active: int) -> float:
    """Return q of E A q = - sum of T t . c, eq. (3b)."""
    pull = 0.0
    for tension, y, d in crossing(rod, T, s, active):
        pull += tension * (1 + y * (omega[1] * d[2] - omega[2] * d[1]))
    return -pull / (rod.E * np.pi * float(rod.radius(s)) ** 2)


def least_stretch(rod: Rod, T: Array) -> float:
    """Return the least 1 + q on a grid that has both sides of every anchorage."""
    stretches = []
    for left, right in pairwise(np.unique([0.0, rod.length, *(x.at for x in rod.sections)])):
        active = rod.active(right)
        grid = np.linspace(left, right, 8)
        stretches += [1 + strain(rod, T, s, True, active)[3] for s in grid]
    return min(stretches)


def poses(rod: Rod, T: Array, s: Sequence[float], extension: bool) -> tuple[Array, Array]:
    """Return positions (N, 3) and frames (N, 3, 3) at arc lengths s: eq. (1) by DOP853."""
    stops = np.unique([*rod.breaks(), *s])
    state = np.concatenate([rod.position, rod.frame.ravel()])
    found = {0.0: state}
    for left, right in pairwise(stops):
        active = rod.active(right)

        def rate(x: float, state: Array, active: int = active) -> Array:
            tau, xi, k, q = strain(rod, T, x, extension, active)
            F = state[3:].reshape(3, 3)
            spin = np.array([[0, -k, xi], [k, 0, -tau], [-xi, tau, 0]])
            return (1 + q) * np.concatenate([F[:, 0], (F @ spin).ravel()])

        run = solve_ivp(rate, (left, right), state, "DOP853", rtol=1e-12, atol=1e-14)
        state = run.y[:, -1]
        found[float(right)] = state
    rows = np.array([found[float(x)] for x in s])
    return rows[:, :3], rows[:, 3:].reshape(-1, 3, 3)


def tendon_length(rod: Rod, T: Array, section: int, phi: float, extension: bool) -> float:
    """Return the integral of |du_c/ds| along a tendon, u_c = u + y d of eq. (6), by quadrature."""
    cable = rod.sections[section]
    d = np.array([0.0, np.cos(phi), np.sin(phi)])
    places = rod.breaks()
    total = 0.0
    for left, right in pairwise(places[places <= cable.at]):
        active = rod.active(right)

        def speed(s: float, active: int = active) -> float:
            e = strain(rod, T, s, extension, active)
            along = (1 + e[3]) * (T_AXIS + cable.offset(s) * np.cross(e[:3], d))
            return float(np.linalg.norm(along + cable.slope(s) * d))

        total += quad(speed, left, right, epsabs=1e-13, epsrel=1e-11)[0]
    return total


def twist_matrix(w: Array, v: Array) -> Array:
    """Return the 4x4 matrix of a twist."""
    spin = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    return np.block([[spin, np.reshape(v, (3, 1))], [np.zeros((1, 4))]])


def paper_sums(rod: Rod, T: Array, s: float, active: int) -> tuple[Array, Array]:
    """Return S[y^p T_j], p = 0 to 2, and derivatives, (3, 4), of tendons on the paper's axes."""
    sums, jacobian = np.zeros((3, 4)), np.zeros((3, 4))
    for section, row in zip(rod.sections[:active], T.reshape(-1, 4), strict=False):
        y, slope = float(section.offset(s)), float(section.slope(s))
        sums += np.outer([1, y, y**2], row)
        jacobian += np.outer([0, slope, 2 * y * slope], row)
    return sums, jacobian


def printed_rate(rod: Rod, T: Array, s: float, omega: Array, active: int) -> Array:
    """Return (tau', xi', k') of eq. (10) as printed."""
    tau, xi, k = omega
    (_, (y1, y2, y3, y4), (z1, z2, z3, z4)), jacobian = paper_sums(rod, T, s, active)
    (_, (v1, v2, v3, v4), (w1, w2, w3, w4)) = jacobian
    GI, EJ, _ = body_stiffness(rod, s)
    relative = 4 * float(rod.radius.derivative()(s)) / float(rod.radius(s))
    twist = -tau * (GI * relative + w1 + w2 + w3 + w4) - k * xi * (z1 - z2 + z3 - z4)
    twist += k * (y2 - y4) + xi * (y1 - y3)
    about_n = -xi * (EJ * relative + w2 + w4) - tau * k * (z2 + z4) + tau * (y3 - y1) + v4 - v2
    about_b = -k * (EJ * relative + w1 + w3) + tau * xi * (z1 + z3) + tau * (y4 - y2) + v1 - v3
    D = [GI + z1 + z2 + z3 + z4, EJ + z2 + z4, EJ + z1 + z3]
    return np.array([twist, about_n, about_b]) / D


def printed_states(rod: Rod, T: Array, s: Array) -> tuple[Array, Array, Array]:
    """Return strains, positions, frames at s, which includes all breaks: eqs. (1), (10), (11).

    Strains are integrated from the tip to the base, together with the pose, which is then moved to
    the base.
    """
    state = np.concatenate([np.zeros(6), np.eye(3).ravel()])
    rows, stretch = [], []
    for right, left in pairwise([*s[::-1], None]):
        i = rod.active(right)
        if right in [section.at for section in rod.sections]:
            own = paper_sums(rod, T, right, i)[0] - paper_sums(rod, T, right, i - 1)[0]
            (_, (y1, y2, y3, y4), (z1, z2, z3, z4)), EJ = own, body_stiffness(rod, right)[1]
            state[1:3] += [(y4 - y2) / (z4 + z2 + EJ), (y1 - y3) / (z1 + z3 + EJ)]
        rows.append(state)
        stretch.append(axial(rod, T, right, state[:3], i))
        if left is None:
            break

        def rate(x: float, state: Array, i: int = i) -> Array:
            omega, F = state[:3], state[6:].reshape(3, 3)
            spin = F @ twist_matrix(omega, T_AXIS)[:3, :3]
            pose = (1 + axial(rod, T, x, omega, i)) * np.concatenate([F[:, 0], spin.ravel()])
            return np.concatenate([printed_rate(rod, T, x, omega, i), pose])

        run = solve_ivp(rate, (right, left), state, "DOP853", rtol=1e-12, atol=1e-14)
        state = run.y[:, -1]
    found = np.array(rows[::-1])
    frames = found[:, 6:].reshape(-1, 3, 3)
    turn = rod.frame @ frames[0].T
    position = rod.position + (found[:, 3:6] - found[0, 3:6]) @ turn.T
    return np.column_stack([found[:, :3], stretch[::-1]]), position, turn @ frames
