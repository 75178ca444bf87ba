"""Magnus expansions: the pose across one step of a twist that varies along it.

The twist is local, g' = g A(s), so brackets have the opposite sign of the textbook's Y' = A Y.
Source: Blanes, Casas, Oteo, Ros, "The Magnus expansion and some of its applications", Physics
Reports 470 (2009), sections 5.3 and 5.4, with Gauss-Legendre nodes.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from model.rotations import exponential

_ROOT = np.sqrt(15.0)
GAUSS = np.array([0.5 - _ROOT / 10, 0.5, 0.5 + _ROOT / 10])
ORDER = 6


def step(twists: list[ca.SX], h: ca.SX) -> ca.SX:
    """Return the pose (7,) across a step of length h [m], to sixth order.

    Parameters
    ----------
    twists : three (6,)
        (kappa, nu) per unit reference length at the Gauss nodes of the step.
    """
    first, middle, last = twists
    a = h * middle
    b = h * _ROOT / 3 * (last - first)
    c = h * 10 / 3 * (first - 2 * middle + last)
    ab = _bracket(a, b)
    inner = -20 * a - c + ab
    outer = b - _bracket(a, 2 * c + ab) / 60
    omega = a + c / 12 + _bracket(inner, outer) / 240
    return exponential(omega[:3], omega[3:])


def _bracket(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the Lie bracket of se(3) with the sign that local twists call for."""
    turn = ca.cross(b[:3], a[:3])
    shift = ca.cross(b[:3], a[3:]) - ca.cross(a[:3], b[3:])
    return ca.vertcat(turn, shift)
