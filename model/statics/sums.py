"""The sums over tendons that the reference tangent needs."""

from __future__ import annotations

import numpy as np

from model.arm import Arm
from model.paths import Array
from model.stations import Stations, crossing, sides


def tendon_sums(arm: Arm, at: Stations) -> tuple[Array, Array]:
    """Return the six sums over tendons that the reference tangent needs, as linear maps of tension.

    With phi the tendon's angle and S the sum over the tendons that cross the section, the rows are
    S[T], S[T y cos], S[T y sin], S[T y2 cos2], S[T y2 sin cos], S[T y2 sin2]. For the paper's four
    tendons these are S[T1+T2+T3+T4], S[y (T1-T3)], S[y (T2-T4)], S[y2 (T1+T3)], 0, S[y2 (T2+T4)].

    Returns
    -------
    map, map_rate : (N, 6, n_tendons)
        The sums per newton of each tendon, and their derivatives along s.
    """
    section = [i for i, _ in arm.tendons]
    cos, sin = sides(arm)
    crosses = crossing(arm, at)
    y, y_rate = at.y[section].T, at.y_rate[section].T
    lever, lever_rate = y**2, 2 * y * y_rate
    rows = [crosses, y * cos, y * sin, lever * cos**2, lever * sin * cos, lever * sin**2]
    rates = [
        np.zeros_like(crosses),
        y_rate * cos,
        y_rate * sin,
        lever_rate * cos**2,
        lever_rate * sin * cos,
        lever_rate * sin**2,
    ]
    return np.stack(rows, axis=1), np.stack(rates, axis=1)
