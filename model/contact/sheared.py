"""Where an arm that shears touches: along parts, whose ends carry no force.

A force at a point changes the shear there, and so bends the midline by an angle: towards the
obstacle on both sides, which it would pass through. So the arm lies on it over a length, however
short, whose curvature against that of the obstacle makes up for the angle: what presses is spread,
without forces at the ends, and the arm leaves along its tangent. A point stays where the obstacle
has an edge that takes the angle, and at the tip.
"""

from __future__ import annotations

import numpy as np

from model.contact.along import along
from model.contact.newton import Held
from model.contact.places import SAME, Place

# How far off ends may be, over the arm's length.
_FOUND = 1e-10


def sheared(held: Held, place: Place) -> Place | None:
    """Return the part that a point becomes; None where it stays one."""
    system, (s, j) = held.here.system, (place.start, place.obstacle)
    beyond = s + SAME * held.length
    if beyond >= held.length:
        return None
    looks = along(system, held.here.x, np.array([s, beyond]), np.array([j, j]))
    before, after = looks[:, 1]
    curve = float(looks[:, 2].max())
    if after >= before or curve <= 0:
        return None
    length = float(before - after) / curve
    if length <= 2 * SAME * held.length:
        return None
    return Place(j, s, min(s + length, held.length))


def tangent_end(
    held: Held, place: Place, node: int, side: int, h: float
) -> tuple[float, float, float]:
    """Return gap' outside of the end of a part, how far on it vanishes, and the farthest.

    `h` is how long the element beyond is [m].
    """
    s = float(held.here.system.mesh.s[node]) + (side > 0) * SAME * held.length
    own = np.array([s]), np.array([place.obstacle])
    _, slope, curve = along(held.here.system, held.here.x, *own)[0]
    shift = -slope / curve if curve > 0 else side * h * float(np.sign(slope))
    found = abs(shift) <= _FOUND * held.length
    return float(slope), float(shift) * (not found), min(0.8 * h, 0.35 * (place.end - place.start))
