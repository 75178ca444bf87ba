"""Where an arm passes through an obstacle: gaps along it, between the nodes too."""

from __future__ import annotations

import numpy as np

from model.centreline import Centreline
from model.contact.along import along
from model.contact.newton import Held
from model.contact.places import Place
from model.loads import contacts
from model.obstacles import distances, numbers_of
from model.paths import Array
from model.transcription.system import System

# What a gap may be below 0, over the arm's length: at the end, and while places are looked for.
THROUGH, _DEEP = 1e-9, 1e-4
# Gaps are looked at this often in each element.
_LOOKS = 6
# Steps to where a gap is least, and how near to the base that may be, over an element.
_SOUGHT, _FIRST = 4, 1e-3


def passing(held: Held, places: tuple[Place, ...]) -> list[Place]:
    """Return points where the arm passes through an obstacle: where gaps are least, below 0."""
    found = list[Place]()
    for j, s in enumerate(_lowest(held, places, THROUGH)):
        found += _least(held, j, s)
    return found


def deep(held: Held, places: tuple[Place, ...]) -> list[Place]:
    """Return points far from all places where the arm passes deep through an obstacle."""
    h = float(np.diff(held.here.system.mesh.s).max())
    found = [Place(j, at, at) for j, s in enumerate(_lowest(held, places, _DEEP)) for at in s]

    def is_far(point: Place) -> bool:
        own = [place for place in places if place.obstacle == point.obstacle]
        return all(p.start - h > point.start or p.end + h < point.start for p in own)

    return [point for point in found if is_far(point)]


def _lowest(held: Held, places: tuple[Place, ...], through: float) -> list[Array]:
    """Return of each obstacle the arc lengths (n,) where gaps are least, below 0 by a share of L.

    But for parts that lie on it.
    """
    s, gap = gaps_along(held.here.system, held.states)
    found = list[Array]()
    for j, own in enumerate(gap.T.copy()):
        for place in places:
            if place.obstacle == j and place.lies:
                own[(s >= place.start) & (s <= place.end)] = 0.0
        low = own < -through * held.length
        least = low & (own <= np.append(own[1:], np.inf)) & (own <= np.append(np.inf, own[:-1]))
        found.append(s[least])
    return found


def _least(held: Held, j: int, near: Array) -> list[Place]:
    """Return points near arc lengths (n,) where the gap to an obstacle is least, and below 0.

    Between nodes as accurately as at them: what is known of an element by its polynomial alone may
    be below 0 next to where the arm touches.
    """
    system, L = held.here.system, held.here.system.arm.length
    h, first, s = np.diff(system.mesh.s).max(), near, near.copy()
    if not s.size:
        return []
    which, ends = np.full(s.size, j), np.array([_FIRST * h, *sorted(held.corners)])
    k = np.searchsorted(ends, first).clip(1, ends.size - 1)
    least, most = np.maximum(first - h / 2, ends[k - 1]), np.minimum(first + h / 2, ends[k])
    for _ in range(_SOUGHT):
        _, slope, curve = along(system, held.here.x, s, which).T
        step = np.where(curve > 0, -slope / np.maximum(curve, 1e-300), -h * np.sign(slope))
        s = np.clip(s + np.clip(step, -h / 4, h / 4), least, most)
    low = along(system, held.here.x, s, which)[:, 0] < -THROUGH * L
    return [Place(j, float(at), float(at)) for at in s[low]]


def gaps_along(system: System, states: Array) -> tuple[Array, Array]:
    """Return arc lengths (n,) beyond the base, and the gaps there (n, K) [m]."""
    line = Centreline.at_states(system, states)
    h = np.diff(system.mesh.s)
    share = np.tile(np.arange(1, _LOOKS + 1) / _LOOKS, h.size)
    element = np.repeat(np.arange(h.size), _LOOKS)
    s = system.mesh.s[element] + share * h[element]
    s[_LOOKS - 1 :: _LOOKS] = system.mesh.s[1:]
    points = line.moved(element, np.zeros(s.size), share)[0]
    bodies = numbers_of([contact.obstacle for contact in contacts(system.scene)])
    radius = line.radius(element, share)
    return s, distances(bodies, points)[0] - radius[:, None]
