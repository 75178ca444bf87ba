"""Geometry and stiffness of an arm at given arc lengths: the numbers of the equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.rotations import from_matrix

Counts = NDArray[np.int64]

# Gauss points per interval: exact for the volume if R^2 is a polynomial of at most degree 11.
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(6)


@dataclass(frozen=True, eq=False)
class Stations:
    """Geometry of N cross-sections.

    Attributes
    ----------
    s : (N,)
        Arc lengths from the base [m].
    active : (N,)
        Number of anchorage sections whose tendons cross, counted from the tip. At an anchorage the
        number selects one of the two sides.
    radius : (N,)
        Radius of the body [m].
    y, y_rate, y_curve : (n_offsets, N)
        Offset y_i(s) of eq. (5) for each section, or for each tendon if offsets differ, and the
        first two derivatives. Zero beyond the end of the tendons.
    rest, rest_rate : (2, N) or (0, N)
        Curvature at rest about n and b [1/m], and the derivative; empty for a straight arm.
    """

    s: Array
    active: Counts
    radius: Array
    y: Array
    y_rate: Array
    y_curve: Array
    rest: Array
    rest_rate: Array


def stations(arm: Arm, s: Array, active: Counts) -> Stations:
    """Return the cross-sections at s (N,), each crossed by `active` anchorage sections."""
    R = arm.radius.evaluate(s, arm.length)[0]
    y = np.empty((3, len(arm.offset_paths), s.size))
    for row, (i, path) in enumerate(arm.offset_paths):
        end = arm.sections[i].at
        y[:, row] = path.evaluate(np.minimum(s, end), end) * (active > i)
    rest = arm.rest_curvature
    curved = [path.evaluate(s, arm.length)[:2] for path in (rest.n, rest.b)] if rest else []
    bends = np.array(curved).reshape(len(curved), 2, s.size)
    parts = (y[0], y[1], y[2], bends[:, 0], bends[:, 1])
    return Stations(s, active, R, *parts)


def tendon_directions(arm: Arm) -> tuple[Array, Array]:
    """Return cosine and sine of the angle of each tendon, exact for multiples of 90 degrees.

    Tensions in a plane then bend the arm in this plane exactly.
    """
    phi = np.array([angle for _, angle in arm.tendons])
    values = np.array([np.cos(phi), np.sin(phi)])
    nearest = np.round(values)
    cos, sin = np.where(np.abs(values - nearest) < 1e-15, nearest, values)
    return cos, sin


def crossing(arm: Arm, at: Stations) -> Array:
    """Return 1 if a tendon crosses a station, otherwise 0 (N, n_tendons)."""
    section = np.array([i for i, _ in arm.tendons])
    return (at.active[:, None] > section).astype(float)


def tendon_offsets(arm: Arm, at: Stations) -> Array:
    """Return Y = y d along n and b, 0 beyond the end of a tendon, and two derivatives (3, 2, N, n).

    The direction of a tendon that turns has the derivative d' = phi' d_perp.
    """
    offset = np.array([at.y, at.y_rate, at.y_curve])[:, list(arm.offset_of)].transpose(0, 2, 1)
    d = np.stack(tendon_directions(arm))[:, None]
    y = offset[:, None]
    if not any(arm.angle_paths):
        return np.asarray(y * d)
    turned = np.zeros(offset.shape)
    for j, turn in enumerate(arm.angle_paths):
        if turn is not None:
            end = arm.sections[arm.tendons[j][0]].at
            turned[..., j] = turn.evaluate(np.minimum(at.s, end), end)
    phi, phi_rate, phi_curve = turned
    d = np.stack([d[0] * np.cos(phi) - d[1] * np.sin(phi), d[0] * np.sin(phi) + d[1] * np.cos(phi)])
    across = np.stack([-d[1], d[0]])
    y, rate, curve = y
    twice = 2 * rate * phi_rate + y * phi_curve
    return np.stack(
        [y * d, rate * d + y * phi_rate * across, (curve - y * phi_rate**2) * d + twice * across]
    )


def tendon_paths(
    arm: Arm, at: Stations, place: Counts, tendon: Counts, derivative: int = 0
) -> Array:
    """Return the offset Y = y d along n and b, and its derivative (4, P), of tendons at stations.

    With `derivative=1` return the derivatives along s of these numbers. `place` (P,) and `tendon`
    (P,) are indices of stations and tendons.
    """
    rows = slice(derivative, derivative + 2)
    return tendon_offsets(arm, at)[rows, :, place, tendon].reshape(4, -1)


def volume(arm: Arm, s: Array) -> Array:
    """Return the volume of the body between arc lengths s (N,) and the tip [m3].

    By Gauss quadrature between the arc lengths and the knots of the body's paths, which is exact
    for paths that are polynomials up to the fifth degree in between.
    """
    knots = [at for path in (arm.radius, *arm.profile.paths) for at in path.knots()]
    ends = np.unique(np.concatenate([[0.0, arm.length], s, knots]))
    ends = ends[(ends >= 0) & (ends <= arm.length)]
    h = np.diff(ends)
    nodes = (ends[:-1] + h / 2)[:, None] + h[:, None] / 2 * _GAUSS
    area = arm.area(nodes.ravel()).reshape(nodes.shape)
    parts = h / 2 * (area @ _WEIGHTS)
    rest = np.concatenate([np.cumsum(parts[::-1])[::-1], [0.0]])
    return np.asarray(rest[np.searchsorted(ends, np.clip(s, 0.0, arm.length))])


def base_pose(arm: Arm) -> Array:
    """Return the clamped pose (7,) of the arm's base."""
    return np.append(from_matrix(np.array(arm.base_frame)), arm.base_position)
