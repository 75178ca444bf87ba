"""Where a part that lies on an obstacle ends: where the gap's second derivative vanishes beyond."""

from __future__ import annotations

import numpy as np

from model.contact.along import along
from model.contact.newton import Held
from model.contact.places import SAME, Place
from model.contact.sheared import tangent_end
from model.effects import Shear
from model.loads import contacts
from model.mesh import Mesh
from model.paths import Array

# How far off ends may be, over the arm's length, and places where gap'' jumps.
_FOUND, _NEAR = 1e-10, 1e-8
# How far from an end derivatives are taken, over an element; among how many places, and how often,
# the one is looked for where gap'' jumps, and by how much, over 1 / L.
_ASIDE, _LOOKS, _NARROWED, _JUMP = 0.05, 33, 4, 1e-2


def where_it_ends(held: Held, place: Place, node: int, side: int) -> tuple[float, float, float]:
    """Return gap'' beyond the end of a part that lies, how far on it vanishes, and the farthest.

    With friction gap'' inside of it.
    """
    system, beyond = held.here.system, node + side
    s, at = system.mesh.s, float(system.mesh.s[node])
    if at >= held.length * (1 - SAME) or not 0 <= beyond < s.size:
        return 0.0, 0.0, 0.0
    if system.scene.has(Shear):
        return tangent_end(held, place, node, side, abs(s[beyond] - at))
    breaks = [abs(own - at) for own in system.arm.anchorages if (own - at) * side > 0]
    h = max(abs(s[beyond] - at), min([longest(system.mesh), *breaks]))
    # What is known at a node is on its base side.
    look = side * _ASIDE * h * np.arange(5.0)
    look[0] = (side > 0) * SAME * held.length
    curve = along(system, held.here.x, at + look, np.full(5, place.obstacle))[:, 2]
    slope = np.polynomial.polynomial.polyfit(look / h, curve, 4)[1] / h
    jumps = _jumps(curve, held.length)
    here = curve[0] if jumps else curve[0] - slope * look[0]
    if contacts(system.scene)[place.obstacle].friction:
        # Friction changes the stretch there, and so what curvature lies on the obstacle; inside
        # of the part it has to be that of the free arm. What the arm is beyond then passes by
        # less than what the friction of the end's force does in the depth of a layer.
        within = at + (side < 0) * SAME * held.length
        here = along(system, held.here.x, np.array([within]), np.array([place.obstacle]))[0, 2]
    # A part is too long where the free arm leaves with gap'' > 0, as if it were pulled there.
    shift = -side * float(np.sign(here)) * abs(float(here / slope) if slope else h)
    if jumps and here < 0:
        k = int(np.argmax(curve > 0))
        edge = _edge(held, place.obstacle, at + look[k - 1], at + look[k])
        shift = side * max(abs(edge - at), _NEAR * held.length / 2)
    most = min(0.8 * h, 0.35 * (place.end - place.start))
    return float(here), shift * (abs(shift) > _FOUND * held.length), most


def longest(mesh: Mesh) -> float:
    """Return the longest element [m]: what places may move by in a step is a share of it.

    The next one may be as short as that between a node that moves and one that stays.
    """
    return float(np.diff(mesh.s).max())


def _jumps(curve: Array, length: float) -> bool:
    """Return whether gap'' (5,) goes through 0 in a jump: as at an edge, or a capsule's seam."""
    size, bent = np.ptp(curve), np.abs(np.diff(curve, 2)).max()
    return bool(curve.min() < 0 < curve.max() and size * length > _JUMP and bent > 0.3 * size)


def _edge(held: Held, j: int, inner: float, outer: float) -> float:
    """Return where gap'' jumps above 0 between two arc lengths [m].

    It stays about where it is on the arm as a part grows up to it.
    """
    for _ in range(_NARROWED):
        looks = np.linspace(inner, outer, _LOOKS)
        out = along(held.here.system, held.here.x, looks, np.full(_LOOKS, j))[:, 2] > 0
        k = max(int(np.argmax(out)), 1) if out.any() else _LOOKS - 1
        inner, outer = float(looks[k - 1]), float(looks[k])
    return inner
