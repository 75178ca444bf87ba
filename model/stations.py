"""Numbers at given arc lengths of an arm: what the equations need of body and tendons there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.arm import Arm
from model.paths import Array
from model.rotations import from_matrix

Counts = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Stations:
    """Geometry of N cross-sections.

    Attributes
    ----------
    s : (N,)
        Arc lengths from the base [m].
    active : (N,)
        How many anchorage sections' tendons cross each, counted from the tip: an anchorage is a
        place with two sides, and this number says which is meant.
    body, body_rate : (3, N)
        E A [N], E J [N m2], G I [N m2], and their derivatives along s; eq. (7).
    y, y_rate, y_curve : (n_offsets, N)
        Offset y_i(s) of each section's tendons, or of each tendon where these differ, and its first
        two derivatives; eq. (5). Zero where the tendons do not cross.
    rest, rest_rate : (2, N) or (0, N)
        Curvature about n and b at rest [1/m] and its derivative; none of a straight arm.
    """

    s: Array
    active: Counts
    body: Array
    body_rate: Array
    y: Array
    y_rate: Array
    y_curve: Array
    rest: Array
    rest_rate: Array


def stations(arm: Arm, s: Array, active: Counts) -> Stations:
    """Return the numbers of the cross-sections at s (N,), crossed by `active` sections each."""
    R, slope, _ = arm.radius.evaluate(s, arm.length)
    E, G = arm.material.E, arm.material.G
    area, area_rate = np.pi * R**2, 2 * np.pi * R * slope
    J, J_rate = np.pi * R**4 / 4, np.pi * R**3 * slope
    y = np.zeros((3, len(arm.offset_paths), s.size))
    for row, (i, path) in enumerate(arm.offset_paths):
        inside, end = active > i, arm.sections[i].at
        if inside.any():
            y[:, row, inside] = path.evaluate(np.minimum(s[inside], end), end)
    rest = arm.rest_curvature
    curved = [path.evaluate(s, arm.length)[:2] for path in (rest.n, rest.b)] if rest else []
    bends = np.array(curved).reshape(len(curved), 2, s.size)
    return Stations(
        s,
        active,
        np.array([E * area, E * J, 2 * G * J]),
        np.array([E * area_rate, E * J_rate, 2 * G * J_rate]),
        *(y[0], y[1], y[2]),
        *(bends[:, 0], bends[:, 1]),
    )


def sides(arm: Arm) -> tuple[Array, Array]:
    """Return cosine and sine of the angle of each tendon."""
    phi = np.array([angle for _, angle in arm.tendons])
    return _quarter_exact(np.cos(phi)), _quarter_exact(np.sin(phi))


def crossing(arm: Arm, at: Stations) -> Array:
    """Return 1 where a tendon crosses a station, else 0: (N, n_tendons)."""
    section = np.array([i for i, _ in arm.tendons])
    return (at.active[:, None] > section).astype(float)


def tendon_paths(arm: Arm, at: Stations, place: Counts, tendon: Counts) -> Array:
    """Return the offset Y = y d along n and b, and its derivative (4, P), of tendons at stations.

    `place` (P,) are numbers of stations, `tendon` (P,) those of the tendons there.
    """
    return _offsets(arm, at, place, tendon)[:2].reshape(4, -1)


def tendon_path_rates(arm: Arm, at: Stations, place: Counts, tendon: Counts) -> Array:
    """Return the derivatives along s (4, P) of what tendon_paths returns."""
    return _offsets(arm, at, place, tendon)[1:].reshape(4, -1)


def _offsets(arm: Arm, at: Stations, place: Counts, tendon: Counts) -> Array:
    """Return Y = y d and its first two derivatives (3, 2, P); d' = phi' d_perp where d turns."""
    row = np.array(arm.offset_of)[tendon]
    y, rate, curve = (each[row, place] for each in (at.y, at.y_rate, at.y_curve))
    d = np.stack(sides(arm))[:, tendon]
    if not any(arm.turns):
        return np.stack([y * d, rate * d, curve * d])
    phi, phi_rate, phi_curve = _turned(arm, at, place, tendon)
    d = np.stack([d[0] * np.cos(phi) - d[1] * np.sin(phi), d[0] * np.sin(phi) + d[1] * np.cos(phi)])
    across = np.stack([-d[1], d[0]])
    twice = 2 * rate * phi_rate + y * phi_curve
    return np.stack(
        [y * d, rate * d + y * phi_rate * across, (curve - y * phi_rate**2) * d + twice * across]
    )


def _turned(arm: Arm, at: Stations, place: Counts, tendon: Counts) -> Array:
    """Return by how much tendons (P,) have turned at stations (3, P) [rad]."""
    values = np.zeros((3, place.size))
    for j, turn in enumerate(arm.turns):
        if turn is not None:
            mine, end = tendon == j, arm.sections[arm.tendons[j][0]].at
            values[:, mine] = turn.evaluate(np.minimum(at.s[place[mine]], end), end)
    return values


def tendon_offset(arm: Arm, tendon: int, s: Array) -> Array:
    """Return the offset Y = y d of a tendon along n and b (N, 2) [m] at arc lengths s (N,)."""
    crossed = np.full(s.size, arm.tendons[tendon][0] + 1)
    along = np.arange(s.size), np.full(s.size, tendon)
    return tendon_paths(arm, stations(arm, s, crossed), *along)[:2].T


def base_pose(arm: Arm) -> Array:
    """Return the clamped pose (7,) of the arm's base."""
    return np.append(from_matrix(np.array(arm.base_frame)), arm.base_position)


def _quarter_exact(values: Array) -> Array:
    """Round the sines and cosines of right angles to 0 and 1, so that planar pulls stay planar."""
    nearest = np.round(values)
    return np.where(np.abs(values - nearest) < 1e-15, nearest, values)
