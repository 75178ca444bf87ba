"""How the pose across a Magnus step answers to the twists at its nodes.

A step is exp(Omega). A change delta of Omega moves it by exp(z) with z = dexp delta, (turn, shift)
in the frame of its start, where dexp, the left derivative of the exponential, has the blocks
J = I + a W + b W^2 and its directional derivative; a, b are power series in the angle squared.
Source: Iserles, Munthe-Kaas, Norsett, Zanna, "Lie-group methods", Acta Numerica 9 (2000),
section 2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import casadi as ca

from model.integrators.magnus import Magnus
from model.rotations import compose, exponential, matrix

_SMALL, _TERMS = 0.01, 6


def dexp(omega: ca.SX) -> ca.SX:
    """Return the left derivative (6, 6) of the exponential at omega = (rotation, displacement)."""
    w, v = omega[:3], omega[3:]
    a, b, a_slope, b_slope = _coefficients(ca.sumsqr(w))
    W, V = ca.skew(w), ca.skew(v)
    WW, along = W @ W, 2 * ca.dot(w, v)
    J = ca.SX.eye(3) + a * W + b * WW
    bent = a * V + b * (W @ V + V @ W) + along * (a_slope * W + b_slope * WW)
    return ca.blockcat([[J, ca.SX(3, 3)], [bent, J]])


def _coefficients(x: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return a = (1 - cos t) / t^2, b = (t - sin t) / t^3 and their slopes, x = t^2."""
    small = x < _SMALL
    t = ca.sqrt(ca.if_else(small, _SMALL, x))
    sin, cos = ca.sin(t), ca.cos(t)
    closed = (
        (1 - cos) / t**2,
        (t - sin) / t**3,
        (t * sin - 2 * (1 - cos)) / (2 * t**4),
        ((1 - cos) * t - 3 * (t - sin)) / (2 * t**5),
    )
    terms: tuple[Callable[[int], float], ...] = (
        lambda k: (-1.0) ** k / math.factorial(2 * k + 2),
        lambda k: (-1.0) ** k / math.factorial(2 * k + 3),
        lambda k: -((-1.0) ** k) * (k + 1) / math.factorial(2 * k + 4),
        lambda k: -((-1.0) ** k) * (k + 1) / math.factorial(2 * k + 5),
    )
    pairs = zip(terms, closed, strict=True)
    a, b, a_slope, b_slope = (ca.if_else(small, _series(x, term), far) for term, far in pairs)
    return a, b, a_slope, b_slope


def _series(x: ca.SX, term: Callable[[int], float]) -> ca.SX:
    total = ca.SX(0)
    for k in reversed(range(_TERMS)):
        total = term(k) + x * total
    return total


def step_slopes(scheme: Magnus, twists: list[ca.SX], h: ca.SX, e: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the pose (7,) of a step, and the slopes (6, n) of its z against e (n,).

    `twists` (6,) at the scheme's nodes are expressions of e.
    """
    omega = scheme.expansion(twists, h)
    return exponential(omega[:3], omega[3:]), ca.densify(dexp(omega) @ ca.jacobian(omega, e))


@lru_cache(maxsize=8)
def adjoint_function() -> ca.Function:
    """Return pose -> (6, 6), the map of local twists to spatial ones."""
    g = ca.SX.sym("g", 7)
    R = matrix(g[:4])
    return ca.Function(
        "adjoint", [g], [ca.densify(ca.blockcat([[R, ca.SX(3, 3)], [ca.skew(g[4:]) @ R, R]]))]
    )


@lru_cache(maxsize=1)
def chain_function() -> ca.Function:
    """Return (pose, relative pose) -> the pose after it."""
    g, h = ca.SX.sym("g", 7), ca.SX.sym("h", 7)
    return ca.Function("chain", [g, h], [compose(g, h)])
