"""Gauss collocation: tableaus, and Magnus expansions of rotations and poses along an element.

The curvature kappa(x) is the polynomial through the stages, x = (s - s_k) / h in [0, 1]. The
rotation is the exponential of a truncated Magnus expansion, so that frames remain rotations by
construction. Elements integrate positions by quadrature; the explicit map without loads integrates
whole poses by exponentials of rigid motions. Because R' = R kappa and
g' = g A(s) multiply on the right, brackets have the opposite sign of the brackets for Y' = A Y in
textbooks.
Sources: Hairer, Lubich, Wanner, "Geometric Numerical Integration" (2006), II.1.3 (Gauss methods);
Blanes, Casas, Oteo, Ros, "The Magnus expansion and some of its applications", Physics Reports 470
(2009), section 5 (sixth order from three Gauss nodes).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import casadi as ca
import numpy as np

from octoplan.model.paths import Array
from octoplan.model.rod.kernels import Name
from octoplan.model.rotations import exponential

Bracket = Callable[[ca.SX, ca.SX], ca.SX]


@dataclass(frozen=True, eq=False)
class Tableau:
    """A Gauss method of m stages, of order 2 m for poses and moments at the nodes.

    Attributes
    ----------
    c, b : (m,)
        Nodes on [0, 1] and weights.
    a : (m, m)
        Integrals of the stages' Lagrange polynomials from 0 to c_i.
    powers : (m, m)
        Coefficient of x^p of the polynomial that is 1 at stage j and 0 at the others.
    at_ends : (2, m)
        Lagrange weights at 0 and 1.
    """

    c: Array
    b: Array
    a: Array
    powers: Array
    at_ends: Array

    def at(self, x: Array | float) -> Array:
        """Return the Lagrange weights (..., m) of stage values, at x (...) on [0, 1]."""
        return np.asarray(np.asarray(x)[..., None] ** np.arange(self.c.size) @ self.powers)


@lru_cache(maxsize=8)
def gauss(m: int) -> Tableau:
    """Return the Gauss method of m stages."""
    nodes, weights = np.polynomial.legendre.leggauss(m)
    c = (nodes + 1) / 2
    b = weights / 2
    p = np.arange(m)
    powers = np.linalg.inv(np.vander(c, m, increasing=True))
    a = c[:, None] ** (p + 1) / (p + 1) @ powers
    at_ends = np.array([[0.0], [1.0]]) ** p @ powers
    return Tableau(c, b, a, np.asarray(powers, dtype=float), at_ends)


def rotation_vectors(kappa: list[ca.SX], h: ca.SX, name: Name = ca.densify) -> list[ca.SX]:
    """Return the rotation vectors (3,) from the first node of an element to each stage and its end.

    For the stages, the integral and its first brackets, with the coefficients k_p of kappa(x),

        h sum_j a_ij kappa_j + h^2 sum_{p<q} c_i^(p+q+2) (p-q) / (2 (p+1)(q+1)(p+q+2)) [k_p, k_q],

    and for three stages all other terms of fifth order in h, which keep the order at the nodes:

        c_i^5 (h^3 [k_0, [k_0, k_2]] / 360 - h^3 [k_1, [k_0, k_1]] / 240
               + h^4 [k_0, [k_0, [k_0, k_1]]] / 720);

    For the last node, the expansion of order 2 m. With four stages, all rotations use the power
    series of the expansion, of order 8. `name` defines intermediates.
    """
    m = len(kappa)
    method = gauss(m)

    def bracket(a: ca.SX, b: ca.SX) -> ca.SX:
        # The bracket for R' = R kappa.
        return name(ca.cross(b, a))

    k = ca.vertsplit(name(ca.vertcat(*(weighted_sum(row, kappa) for row in method.powers))), 3)
    if m > 3:
        omega = [name(each) for each in series(k, h, bracket, 2 * m)]
        at = [*method.c.tolist(), 1.0]
        return [weighted_sum(x ** np.arange(1, 2 * m + 1), omega) for x in at]
    pairs = [(p, q) for p in range(m) for q in range(p + 1, m)]
    crossed = ca.vertsplit(name(ca.vertcat(*(ca.cross(k[q], k[p]) for p, q in pairs))), 3)
    brackets = dict(zip(pairs, crossed, strict=True))
    fifth = name(_fifth(k, brackets, h, bracket)) if m > 2 else ca.SX.zeros(3)
    results = []
    for c, row in zip(method.c, method.a, strict=True):
        turn = h * weighted_sum(row, kappa)
        for (p, q), single in brackets.items():
            share = (p - q) / (2 * (p + 1) * (q + 1) * (p + q + 2))
            turn += h**2 * float(c ** (p + q + 2)) * share * single
        results.append(turn + float(c**5) * fifth)
    return [*results, expansion(kappa, h, bracket)]


def _fifth(
    k: list[ca.SX], brackets: dict[tuple[int, int], ca.SX], h: ca.SX, bracket: Bracket
) -> ca.SX:
    """Return the terms of fifth order in h with nested brackets, at x = 1."""
    twice = bracket(k[0], brackets[0, 1])
    third = (1 / 360) * bracket(k[0], brackets[0, 2]) - (1 / 240) * bracket(k[1], brackets[0, 1])
    fifth: ca.SX = h**3 * (third + h * (1 / 720) * bracket(k[0], twice))
    return fifth


def weighted_sum(weights: Array, values: list[ca.SX]) -> ca.SX:
    """Return the weighted sum of values."""
    total = ca.SX.zeros(values[0].numel())
    for weight, value in zip(weights.tolist(), values, strict=True):
        total += weight * value
    return total


# Magnus expansions of poses


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
