"""Magnus expansions: the pose across one step of a twist that varies along it.

The twist is local, g' = g A(s), so brackets have the opposite sign of the textbook's Y' = A Y.
Source: Blanes, Casas, Oteo, Ros, "The Magnus expansion and some of its applications", Physics
Reports 470 (2009), section 5, with Gauss-Legendre nodes. Frames stay rotations by construction.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from model.rotations import exponential

Bracket = Callable[[ca.SX, ca.SX], ca.SX]


@dataclass(frozen=True)
class Magnus:
    """A scheme of order 2, 4 or 6.

    Attributes
    ----------
    name : str
    order : int
    nodes : (order / 2,)
        Gauss-Legendre nodes on [0, 1].
    weights : (order / 2,)
        Of the nodes in an integral over [0, 1].
    """

    name: str
    order: int
    nodes: tuple[float, ...]
    weights: tuple[float, ...]

    def step(self, twists: list[ca.SX], h: ca.SX) -> ca.SX:
        """Return the pose (7,) across a step of length h [m].

        `twists` are (kappa, nu) (6,) per unit reference length at the nodes of the step.
        """
        omega = self.expansion(twists, h)
        return exponential(omega[:3], omega[3:])

    def expansion(self, twists: list[ca.SX], h: ca.SX) -> ca.SX:
        """Return (rotation vector, displacement) (6,) whose exponential is the step."""
        return expansion(twists, h, _bracket)


def expansion(values: list[ca.SX], h: ca.SX, bracket: Bracket) -> ca.SX:
    """Return the truncated expansion across a step, from values at 1, 2 or 3 Gauss nodes.

    In the Lie algebra of the bracket, of order twice the number of nodes.
    """
    return _EXPANSIONS[len(values)](values, h, bracket)


def series(coefficients: list[ca.SX], h: ca.SX, bracket: Bracket, order: int) -> list[ca.SX]:
    """Return the coefficients of x, x^2, .. x^order in the expansion from 0 to x of a polynomial.

    `coefficients` are those of 1, x, .. in the polynomial, with x in [0, 1] over a step h. By the
    equation of the expansion, Omega' = sum_j B_j / j! ad_Omega^j A with Bernoulli's numbers B_j,
    degree by degree: what is left out is of order h^(order + 1).
    """
    rate = [h * own for own in coefficients]
    powers, omega = [[_sum(rate[d : d + 1]) for d in range(order)]], [ca.SX()]
    powers += [[] for _ in _BERNOULLI[1:]]
    for d in range(order):
        for lower, own in pairwise(powers):
            # The first coefficient of Omega is that of A, and commutes with it.
            inner = range(1, d + 1) if lower is not powers[0] or d > 1 else range(0)
            terms = [bracket(omega[i], lower[d - i]) for i in inner if lower[d - i].numel()]
            own.append(_sum(terms))
        parts = zip(_BERNOULLI, powers, strict=True)
        omega.append(_sum([b * own[d] for b, own in parts if b and own[d].numel()]) / (d + 1))
    return omega[1:]


def _sum(terms: list[ca.SX]) -> ca.SX:
    """Return the sum of terms, empty if there are none."""
    total = ca.SX()
    for term in terms:
        total = total + term if total.numel() else term
    return total


def _second(values: list[ca.SX], h: ca.SX, bracket: Bracket) -> ca.SX:
    omega: ca.SX = h * values[0]
    return omega


def _fourth(values: list[ca.SX], h: ca.SX, bracket: Bracket) -> ca.SX:
    first, last = values
    omega: ca.SX = h / 2 * (first + last) - h**2 * np.sqrt(3) / 12 * bracket(first, last)
    return omega


def _sixth(values: list[ca.SX], h: ca.SX, bracket: Bracket) -> ca.SX:
    first, middle, last = values
    a = h * middle
    b = h * np.sqrt(15) / 3 * (last - first)
    c = h * 10 / 3 * (first - 2 * middle + last)
    ab = bracket(a, b)
    inner = -20 * a - c + ab
    outer = b - bracket(a, 2 * c + ab) / 60
    return a + c / 12 + bracket(inner, outer) / 240


def _bracket(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the Lie bracket of se(3) with the sign that local twists call for."""
    turn = ca.cross(b[:3], a[:3])
    shift = ca.cross(b[:3], a[3:]) - ca.cross(a[:3], b[3:])
    return ca.vertcat(turn, shift)


_EXPANSIONS = {1: _second, 2: _fourth, 3: _sixth}
# Bernoulli's numbers over factorials, of what orders up to eight take.
_BERNOULLI = (1.0, -1 / 2, 1 / 12, 0.0, -1 / 720, 0.0, 1 / 30240)


def _scheme(order: int) -> Magnus:
    nodes, weights = np.polynomial.legendre.leggauss(order // 2)
    both = tuple(((nodes + 1) / 2).tolist()), tuple((weights / 2).tolist())
    return Magnus(f"magnus{order}", order, *both)


MAGNUS2, MAGNUS4, MAGNUS6 = (_scheme(order) for order in (2, 4, 6))
