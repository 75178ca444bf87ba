"""Rotations and poses, for symbols (CasADi) and for numbers (NumPy).

A rotation is a quaternion (w, x, y, z); a pose is (7,): the quaternion that turns local components
(t, n, b) into the base frame's, then the position u [m].
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from octoplan.model.paths import Array
from octoplan.model.support.checks import SMALLEST

# Size of a pose: quaternion and position.
POSE = 7
# Number of doublings of the angle in half_angle.
_DOUBLINGS = 3
# Degree of the power series in half_angle, in the squared angle.
_TERMS = 7


def norm(v: ca.SX) -> ca.SX:
    """Return the Euclidean norm of an expression, differentiable at 0."""
    return ca.sqrt(ca.sumsqr(v) + SMALLEST)


def multiply(p: ca.SX, q: ca.SX) -> ca.SX:
    """Return the product of two quaternions."""
    v = p[1:]
    w = q[1:]
    return ca.vertcat(p[0] * q[0] - ca.dot(v, w), p[0] * w + q[0] * v + ca.cross(v, w))


def conjugate(q: ca.SX) -> ca.SX:
    """Return the conjugate quaternion (4,)."""
    return ca.vertcat(q[0], -q[1:])


def rotate(q: ca.SX, v: ca.SX) -> ca.SX:
    """Return v turned by a unit quaternion."""
    twice = 2 * ca.cross(q[1:], v)
    return v + q[0] * twice + ca.cross(q[1:], twice)


def compose(g: ca.SX, h: ca.SX) -> ca.SX:
    """Return the pose g followed, in its own frame, by h; of unit quaternions."""
    return ca.vertcat(multiply(g[:4], h[:4]), g[4:] + rotate(g[:4], h[4:]))


def inverse(g: ca.SX) -> ca.SX:
    """Return the pose that undoes g, of a unit quaternion."""
    back = conjugate(g[:4])
    return ca.vertcat(back, -rotate(back, g[4:]))


def matrix(q: ca.SX) -> ca.SX:
    """Return the rotation matrix of a quaternion of any length: columns t, n, b."""
    return unit_matrix(q / ca.norm_2(q))


def half_turn(w: ca.SX) -> ca.SX:
    """Return the unit quaternion (4,) of a rotation vector (3,) [rad]; see half_angle."""
    half = half_angle(ca.sumsqr(w))
    return ca.vertcat(half[0], half[1] * w)


def half_angle(x: ca.SX) -> ca.SX:
    """Return cos(angle / 2) and sin(angle / 2) / angle (2,) of the square x of an angle [rad2].

    The power series at an eighth of the half angle is doubled three times. The result is smooth
    without a branch, and accurate to rounding up to two turns.
    """
    versine, sinc, _ = _of_half(x)
    return ca.vertcat(1 - 0.25 * x * versine, 0.5 * sinc)


def _of_half(x: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return (1 - cos b) / b^2, sin b / b and (b - sin b) / b^3 of half the angle, b = x^(1/2) / 2.

    See half_angle. The first and the last are sums over k of (-b^2)^k / (2 k + 2)! and (2 k + 3)!,
    by Horner's rule. Products are several times faster than quotients.
    """
    square = 0.25 ** (_DOUBLINGS + 1) * x
    versine = ca.SX(0)
    cubic = ca.SX(0)
    for k in reversed(range(_TERMS + 1)):
        versine = (-1.0) ** k / math.factorial(2 * k + 2) + square * versine
        cubic = (-1.0) ** k / math.factorial(2 * k + 3) + square * cubic
    sinc = 1 - square * cubic
    for _ in range(_DOUBLINGS):
        cubic = 0.25 * (cubic + sinc * versine)
        versine, sinc, square = 0.5 * sinc**2, sinc * (1 - square * versine), 4 * square
    return versine, sinc, cubic


def unit_matrix(q: ca.SX) -> ca.SX:
    """Return the rotation matrix (3, 3) of a unit quaternion: columns t, n, b."""
    return ca.SX(ca.blockcat(_rows(*ca.vertsplit(q))))


def _rows(w: Any, x: Any, y: Any, z: Any) -> list[list[Any]]:
    """Return the rows of the rotation matrix of a unit quaternion, of symbols or numbers."""
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def exponential(w: ca.SX, v: ca.SX) -> ca.SX:
    """Return the pose reached by a constant local twist: rotation vector w, displacement v.

    The smoothness and the accuracy are those of half_angle.
    """
    x = ca.sumsqr(w)
    turn = ca.cross(w, v)
    versine, sinc, cubic = _of_half(x)
    shift = v + 0.5 * sinc**2 * turn + 0.25 * (cubic + sinc * versine) * ca.cross(w, turn)
    return ca.vertcat(1 - 0.25 * x * versine, 0.5 * sinc * w, shift)


def cross(a: Array, b: Array) -> Array:
    """Return the cross products (..., 3) of vectors (..., 3), several times faster than NumPy."""
    (x, y, z), (u, v, w) = ((part[..., 0], part[..., 1], part[..., 2]) for part in (a, b))
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def from_matrix(frame: Array) -> Array:
    """Return the unit quaternion (4,) of a rotation matrix (3, 3)."""
    return np.asarray(Rotation.from_matrix(frame).as_quat(canonical=True, scalar_first=True))


def matrices(q: Array) -> Array:
    """Return the rotation matrices (..., 3, 3) of quaternions (..., 4) of any length."""
    unit = q / np.sqrt((q * q).sum(axis=-1, keepdims=True))
    return np.moveaxis(np.array(_rows(*np.moveaxis(unit, -1, 0))), (0, 1), (-2, -1))
