"""Rotations and poses, for symbols (CasADi) and for numbers (NumPy).

A rotation is a quaternion (w, x, y, z); a pose is (7,): the quaternion that turns local components
(t, n, b) into the base frame's, then the position u [m].
"""

from __future__ import annotations

import math
from functools import lru_cache

import casadi as ca
import numpy as np

from model.paths import Array

IDENTITY = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_SERIES = 5
_SMALL = 0.01
_DOUBLINGS, _TERMS = 3, 7


def multiply(p: ca.SX, q: ca.SX) -> ca.SX:
    """Return the product of two quaternions."""
    v, w = p[1:], q[1:]
    return ca.vertcat(p[0] * q[0] - ca.dot(v, w), p[0] * w + q[0] * v + ca.cross(v, w))


def conjugate(q: ca.SX) -> ca.SX:
    """Return the quaternion (4,) that turns the other way, as long as q."""
    return ca.vertcat(q[0], -q[1:])


@lru_cache(maxsize=1)
def turning() -> ca.Function:
    """Return q -> the changes of q (4, 3) by small turns about the base frame's axes.

    q' = (0, turn) q / 2, per radian.
    """
    q = ca.SX.sym("q", 4)
    columns = [multiply(ca.SX([0, *axis]), q) / 2 for axis in np.eye(3)]
    return ca.Function("turning", [q], [ca.densify(ca.horzcat(*columns))])


@lru_cache(maxsize=1)
def small_turns() -> ca.Function:
    """Return q -> the small turns (3, 4) [rad] that changes of q are; undoes turning."""
    q = ca.SX.sym("q", 4)
    return ca.Function("small_turns", [q], [4 * turning()(q).T / ca.sumsqr(q)])


def rotate(q: ca.SX, v: ca.SX) -> ca.SX:
    """Return v turned by q; q need not be of unit length."""
    twice = 2 * ca.cross(q[1:], v) / ca.sumsqr(q)
    return v + q[0] * twice + ca.cross(q[1:], twice)


def compose(g: ca.SX, h: ca.SX) -> ca.SX:
    """Return the pose g followed, in its own frame, by h."""
    return ca.vertcat(multiply(g[:4], h[:4]), g[4:] + rotate(g[:4], h[4:]))


def inverse(g: ca.SX) -> ca.SX:
    """Return the pose that undoes g."""
    back = conjugate(g[:4])
    return ca.vertcat(back / ca.sumsqr(back), -rotate(back, g[4:]))


def matrix(q: ca.SX) -> ca.SX:
    """Return the rotation matrix of q: columns t, n, b."""
    return ca.horzcat(*(rotate(q, ca.SX.eye(3)[:, i]) for i in range(3)))


def half_turn(w: ca.SX) -> ca.SX:
    """Return the unit quaternion (4,) of a rotation vector (3,) [rad]; see half_angle."""
    half = half_angle(ca.sumsqr(w))
    return ca.vertcat(half[0], half[1] * w)


def half_angle(x: ca.SX) -> ca.SX:
    """Return cos(angle / 2) and sin(angle / 2) / angle (2,) of the square x of an angle [rad2].

    Power series at an eighth of the angle, doubled three times: smooth everywhere without a
    branch, and right to rounding up to two turns.
    """
    share = 0.5**_DOUBLINGS
    sinc, cos = (_series(x * share**2 / 4, order, _TERMS) for order in (1, 0))
    sinc = share / 2 * sinc
    for _ in range(_DOUBLINGS):
        sinc, cos = 2 * sinc * cos, 1 - 2 * sinc**2 * x
    return ca.vertcat(cos, sinc)


def unit_matrix(q: ca.SX) -> ca.SX:
    """Return the rotation matrix (3, 3) of a unit quaternion: columns t, n, b."""
    w, x, y, z = ca.vertsplit(q)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return ca.blockcat(rows)


def exponential(w: ca.SX, v: ca.SX) -> ca.SX:
    """Return the pose reached by a constant local twist: rotation vector w, displacement v.

    Smooth at w = 0: below an angle of 0.1 the coefficients are power series in the angle squared,
    above it closed forms whose argument is kept off 0, so that no derivative is NaN.
    """
    x = ca.sumsqr(w)
    small = x < _SMALL
    angle = ca.sqrt(ca.if_else(small, _SMALL, x))
    sin, cos = ca.sin(angle / 2), ca.cos(angle / 2)
    half_cos = ca.if_else(small, _series(x / 4, 0), cos)
    half_sinc = ca.if_else(small, _series(x / 4, 1), 2 * sin / angle)
    cubic = ca.if_else(small, _series(x, 3), (angle - 2 * sin * cos) / angle**3)
    turn = ca.cross(w, v)
    shift = v + half_sinc**2 / 2 * turn + cubic * ca.cross(w, turn)
    return ca.vertcat(half_cos, half_sinc / 2 * w, shift)


def _series(x: ca.SX, order: int, terms: int = _SERIES) -> ca.SX:
    """Return sum over k of (-x)^k / (2 k + order)! by Horner's rule, exact for x < 0.01."""
    total = ca.SX(0)
    for k in reversed(range(terms + 1)):
        total = (-1.0) ** k / math.factorial(2 * k + order) + x * total
    return total


def from_matrix(frame: Array) -> Array:
    """Return the unit quaternion (4,) of a rotation matrix (3, 3)."""
    K = np.array(
        [
            [np.trace(frame), *(_axis(frame))],
            *np.column_stack([_axis(frame), frame + frame.T - np.trace(frame) * np.eye(3)]),
        ]
    )
    q = np.linalg.eigh((K + K.T) / 2)[1][:, -1]
    return np.asarray(q * (1.0 if q[0] >= 0 else -1.0))


def _axis(frame: Array) -> Array:
    return np.array(
        [frame[2, 1] - frame[1, 2], frame[0, 2] - frame[2, 0], frame[1, 0] - frame[0, 1]]
    )


def cross(a: Array, b: Array) -> Array:
    """Return the cross products (..., 3) of vectors (..., 3), several times sooner than NumPy's."""
    (x, y, z), (u, v, w) = ((part[..., 0], part[..., 1], part[..., 2]) for part in (a, b))
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def matrices(q: Array) -> Array:
    """Return the rotation matrices (..., 3, 3) of quaternions (..., 4) of any length."""
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))
