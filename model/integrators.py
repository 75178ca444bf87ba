"""Integrators along the arm: Magnus expansions for poses, explicit Runge-Kutta methods for rates.

A Magnus expansion gives the pose after one step with a twist that varies along the step. The twist
is local, g' = g A(s): brackets have the opposite sign of the textbook's Y' = A Y. Source: Blanes,
Casas, Oteo, Ros, "The Magnus expansion and some of its applications", Physics Reports 470 (2009),
section 5, with Gauss-Legendre nodes. Frames remain rotations by construction.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from octoplan.model.paths import Array
from octoplan.model.rotations import exponential

Bracket = Callable[[ca.SX, ca.SX], ca.SX]
X = TypeVar("X", ca.SX, Array)


@dataclass(frozen=True)
class Magnus:
    """A Magnus expansion of order 4 or 6.

    Attributes
    ----------
    name : str
    order : int
    nodes : (order / 2,)
        Gauss-Legendre nodes on [0, 1].
    """

    name: str
    order: int
    nodes: tuple[float, ...]

    def step(self, twists: list[ca.SX], h: ca.SX) -> ca.SX:
        """Return the pose (7,) across a step of length h [m].

        `twists` (6,) are (kappa, nu) per unit reference length at the nodes of the step.
        """
        omega = self.expansion(twists, h)
        return exponential(omega[:3], omega[3:])

    def expansion(self, twists: list[ca.SX], h: ca.SX) -> ca.SX:
        """Return (rotation vector, displacement) (6,) whose exponential is the step."""
        return expansion(twists, h, _bracket)


def expansion(values: list[ca.SX], h: ca.SX, bracket: Bracket) -> ca.SX:
    """Return the truncated expansion after a step, from values at 1, 2 or 3 Gauss nodes.

    The values are in the Lie algebra of the bracket. The order is twice the number of nodes.
    """
    first = values[0]
    last = values[-1]
    if len(values) == 1:
        return h * first
    if len(values) == 2:
        omega: ca.SX = h / 2 * (first + last) - h**2 * (np.sqrt(3) / 12) * bracket(first, last)
        return omega
    # Products are several times faster than quotients.
    a = h * values[1]
    b = h * (np.sqrt(15) / 3) * (last - first)
    c = h * (10 / 3) * (first - 2 * values[1] + last)
    ab = bracket(a, b)
    inner = -20 * a - c + ab
    outer = b - (1 / 60) * bracket(a, 2 * c + ab)
    return a + (1 / 12) * c + (1 / 240) * bracket(inner, outer)


def series(coefficients: list[ca.SX], h: ca.SX, bracket: Bracket, order: int) -> list[ca.SX]:
    """Return the coefficients of x, x^2, .. x^order in the expansion from 0 to x of a polynomial.

    `coefficients` are those of 1, x, .. in the polynomial, with x in [0, 1] over a step h. The
    equation of the expansion, Omega' = sum_j B_j / j! ad_Omega^j A with Bernoulli's numbers B_j, is
    solved degree by degree. The remainder has order h^(order + 1).
    """
    zero = 0 * coefficients[0]
    rate = [h * coefficient for coefficient in coefficients][:order]
    powers = [rate + [zero] * (order - len(rate))]
    omega = [zero]
    powers += [[] for _ in _BERNOULLI[1:]]
    for d in range(order):
        for lower, each in pairwise(powers):
            # The first coefficient of Omega is that of A, and commutes with it.
            inner = range(1, d + 1) if lower is not powers[0] or d > 1 else range(0)
            each.append(sum((bracket(omega[i], lower[d - i]) for i in inner), zero))
        terms = (b * each[d] for b, each in zip(_BERNOULLI, powers, strict=True) if b)
        omega.append(sum(terms, zero) / (d + 1))
    return omega[1:]


def _bracket(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the Lie bracket of se(3) with the sign of local twists."""
    turn = ca.cross(b[:3], a[:3])
    shift = ca.cross(b[:3], a[3:]) - ca.cross(a[:3], b[3:])
    return ca.vertcat(turn, shift)


# Bernoulli's numbers B_j / j!, for orders up to eight.
_BERNOULLI = (1.0, -1 / 2, 1 / 12, 0.0, -1 / 720, 0.0, 1 / 30240)


def _scheme(order: int) -> Magnus:
    """Return the Magnus expansion of an order with Gauss-Legendre nodes."""
    nodes = (np.polynomial.legendre.leggauss(order // 2)[0] + 1) / 2
    return Magnus(f"magnus{order}", order, tuple(nodes.tolist()))


MAGNUS4 = _scheme(4)
MAGNUS6 = _scheme(6)


@dataclass(frozen=True)
class RungeKutta:
    """An explicit Runge-Kutta method of s stages.

    Attributes
    ----------
    name : str
    order : int
    nodes : (s,)
        c_i; stages with the same node share the numbers of the cross-section.
    weights : (s,)
        b_i.
    rows : s tuples
        a_ij, j < i.
    """

    name: str
    order: int
    nodes: tuple[float, ...]
    weights: tuple[float, ...]
    rows: tuple[tuple[float, ...], ...]

    def step(self, rate: Callable[[int, X], X], x: X, h: Any) -> X:
        """Return x after a step h of x' = rate(stage number, x), in symbols or numbers."""
        slopes: list[X] = []
        for i, row in enumerate(self.rows):
            inner = x
            for a, slope in zip(row, slopes, strict=True):
                inner = inner + h * a * slope if a else inner
            slopes.append(rate(i, inner))
        for b, slope in zip(self.weights, slopes, strict=True):
            x = x + h * b * slope if b else x
        return x

    @property
    def samples(self) -> tuple[float, ...]:
        """The distinct nodes, in order."""
        return tuple(sorted(set(self.nodes)))


# J. C. Butcher, "On Runge-Kutta processes of high order", J. Austral. Math. Soc. 4 (1964): order 6
# in seven stages.
RK6 = RungeKutta(
    "rk6",
    6,
    (0, 1 / 3, 2 / 3, 1 / 3, 1 / 2, 1 / 2, 1),
    (11 / 120, 0, 27 / 40, 27 / 40, -4 / 15, -4 / 15, 11 / 120),
    (
        (),
        (1 / 3,),
        (0, 2 / 3),
        (1 / 12, 1 / 3, -1 / 12),
        (-1 / 16, 9 / 8, -3 / 16, -3 / 8),
        (0, 9 / 8, -3 / 8, -3 / 4, 1 / 2),
        (9 / 44, -9 / 11, 63 / 44, 18 / 11, 0, -16 / 11),
    ),
)

# G. J. Cooper, J. H. Verner, "Some explicit Runge-Kutta methods of high order", SIAM J. Numer.
# Anal. 9 (1972): order 8 in eleven stages.
_R = 21**0.5
RK8 = RungeKutta(
    "rk8",
    8,
    (
        0,
        1 / 2,
        1 / 2,
        (7 + _R) / 14,
        (7 + _R) / 14,
        1 / 2,
        (7 - _R) / 14,
        (7 - _R) / 14,
        1 / 2,
        (7 + _R) / 14,
        1,
    ),
    (1 / 20, 0, 0, 0, 0, 0, 0, 49 / 180, 16 / 45, 49 / 180, 1 / 20),
    (
        (),
        (1 / 2,),
        (1 / 4, 1 / 4),
        (1 / 7, (-7 - 3 * _R) / 98, (21 + 5 * _R) / 49),
        ((11 + _R) / 84, 0, (18 + 4 * _R) / 63, (21 - _R) / 252),
        ((5 + _R) / 48, 0, (9 + _R) / 36, (-231 + 14 * _R) / 360, (63 - 7 * _R) / 80),
        (
            (10 - _R) / 42,
            0,
            (-432 + 92 * _R) / 315,
            (633 - 145 * _R) / 90,
            (-504 + 115 * _R) / 70,
            (63 - 13 * _R) / 35,
        ),
        (1 / 14, 0, 0, 0, (14 - 3 * _R) / 126, (13 - 3 * _R) / 63, 1 / 9),
        (
            1 / 32,
            0,
            0,
            0,
            (91 - 21 * _R) / 576,
            11 / 72,
            (-385 - 75 * _R) / 1152,
            (63 + 13 * _R) / 128,
        ),
        (
            1 / 14,
            0,
            0,
            0,
            1 / 9,
            (-733 - 147 * _R) / 2205,
            (515 + 111 * _R) / 504,
            (-51 - 11 * _R) / 56,
            (132 + 28 * _R) / 245,
        ),
        (
            0,
            0,
            0,
            0,
            (-42 + 7 * _R) / 18,
            (-18 + 28 * _R) / 45,
            (-273 - 53 * _R) / 72,
            (301 + 53 * _R) / 72,
            (28 - 28 * _R) / 45,
            (49 - 7 * _R) / 18,
        ),
    ),
)
