"""Where an arm passes through an obstacle: gaps along it, between the nodes too."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from model.centreline import Centreline
from model.contact.along import along
from model.contact.newton import Held
from model.contact.places import SAME, Place
from model.equilibrium.linearised import Index
from model.loads import contacts
from model.obstacles import distances, numbers_of
from model.paths import Array
from model.transcription.system import System

# What a gap may be below 0, over the arm's length: at the end, and while places are looked for.
THROUGH, _DEEP = 1e-9, 1e-4
# Gaps are looked at this often in each element.
_LOOKS = 6
# Steps to where a gap is least, how close to it or how much above over the arm's length, and how
# near to the base it is looked for, over an element.
_SOUGHT, _CLOSE, _LEFT, _FIRST = 20, 1e-8, THROUGH / 10, 1e-3


def passing(held: Held, places: tuple[Place, ...]) -> list[Place]:
    """Return points where the arm passes through an obstacle: where gaps are least, below 0."""
    j, s, reach = _candidates(held, places)
    if not s.size:
        return []
    at, gap = _least(held, j, s, reach)
    low = gap < -THROUGH * held.length
    found = zip(j[low].tolist(), at[low].tolist(), strict=True)
    return [Place(*own) for own in sorted({(i, where, where) for i, where in found})]


def _candidates(held: Held, places: tuple[Place, ...]) -> tuple[Index, Array, Array]:
    """Return obstacles (n,), arc lengths (n,) near which gaps are least, and how near (n,) [m].

    Where they may be below 0 between the looks too, as by an edge: gaps fall at most twice as fast
    as arc length grows, so that next to a look they are above its gap less its distance to the
    next. But for parts that lie on the obstacle, and points that touch.
    """
    s, gaps = _looks(held)
    apart, same = np.diff(s, prepend=0.0), SAME * held.length
    reach = np.maximum(apart, np.append(apart[1:], 0.0))
    near = gaps < reach[:, None]
    near[1:] &= gaps[1:] <= gaps[:-1]
    near[:-1] &= gaps[:-1] <= gaps[1:]
    for place in places:
        near[(s >= place.start - same) & (s <= place.end + same), place.obstacle] = False
    k, j = np.nonzero(near)
    return j, s[k], reach[k]


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
    s, gap = _looks(held)
    found = list[Array]()
    for j, own in enumerate(gap.T.copy()):
        for place in places:
            if place.obstacle == j and place.lies:
                own[(s >= place.start) & (s <= place.end)] = 0.0
        low = own < -through * held.length
        least = low & (own <= np.append(own[1:], np.inf)) & (own <= np.append(np.inf, own[:-1]))
        found.append(s[least])
    return found


def _least(held: Held, j: Index, near: Array, reach: Array) -> tuple[Array, Array]:
    """Return where gaps to obstacles (n,) are least (n,) no farther from arc lengths, and the gaps.

    As accurately between nodes as at them: what is known of an element by its polynomial alone may
    be below 0 next to where the arm touches. By Newton's method between slopes of either sign.
    """
    system, s = held.here.system, near.copy()
    ends = np.array([_FIRST * np.diff(system.mesh.s).max(), *sorted(held.corners)])
    k = np.searchsorted(ends, near).clip(1, ends.size - 1)
    low, high = np.maximum(near - reach, ends[k - 1]), np.minimum(near + reach, ends[k])
    best, least = near.copy(), np.full(s.size, np.inf)
    for _ in range(_SOUGHT):
        gap, slope, curve = along(system, held.here.x, s, j).T
        best, least = np.where(gap < least, s, best), np.minimum(gap, least)
        low, high = np.where(slope < 0, s, low), np.where(slope < 0, high, s)
        on = s - slope / np.where(curve > 0, curve, np.inf)
        inside = (curve > 0) & (on > low) & (on < high)
        # By the parabola there the least is half as much below.
        falls = np.where(inside, slope * (s - on), np.inf)
        s = np.where(inside, on, (low + high) / 2)
        is_found = (np.abs(s - best) < _CLOSE * held.length) | (falls < _LEFT * held.length)
        if is_found.all():
            break
    return best, least


@lru_cache(maxsize=4)
def _looks(held: Held) -> tuple[Array, Array]:
    """Return gaps_along of an equilibrium, infinite in elements that are farther than their length.

    Gaps fall at most twice as fast as arc length grows.
    """
    system, line = held.here.system, Centreline.at_states(held.here.system, held.states)
    s, h = system.mesh.s, np.diff(system.mesh.s)
    last = np.arange(h.size)
    radius = np.append(line.radius(last[:1], np.zeros(1)), line.radius(last, np.ones(h.size)))
    at_nodes = (_distances(system, line.poses[:, 4:]) - radius[:, None]).min(axis=1)
    near = np.flatnonzero(np.minimum(at_nodes[:-1], at_nodes[1:]) < 2 * h)
    places, found = (
        _places(s, last),
        np.full((h.size * _LOOKS, len(contacts(system.scene))), np.inf),
    )
    own = (near[:, None] * _LOOKS + np.arange(_LOOKS)).ravel()
    found[own] = _gaps(system, line, near)
    return places, found


def gaps_along(system: System, states: Array) -> tuple[Array, Array]:
    """Return arc lengths (n,) beyond the base, and the gaps there (n, K) [m]."""
    elements = np.arange(system.mesh.steps)
    found = _gaps(system, Centreline.at_states(system, states), elements)
    return _places(system.mesh.s, elements), found


def _places(s: Array, elements: Index) -> Array:
    """Return the arc lengths (n,) in elements between nodes s that gaps are looked at."""
    shares = np.arange(1, _LOOKS) / _LOOKS
    inside = s[elements, None] + shares * np.diff(s)[elements, None]
    return np.hstack([inside, s[elements + 1, None]]).ravel()


def _gaps(system: System, line: Centreline, elements: Index) -> Array:
    """Return the gaps (n, K) [m] in elements, where they are looked at."""
    share = np.tile(np.arange(1, _LOOKS + 1) / _LOOKS, elements.size)
    element = np.repeat(elements, _LOOKS)
    points = line.moved(element, np.zeros(element.size), share)[0]
    return _distances(system, points) - line.radius(element, share)[:, None]


def _distances(system: System, points: Array) -> Array:
    """Return the signed distances (n, K) [m] of points (n, 3) to the obstacles."""
    bodies = numbers_of([contact.obstacle for contact in contacts(system.scene)])
    return distances(bodies, points)[0]
