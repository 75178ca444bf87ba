"""How places come and go, part and join, as an equilibrium with them says.

Places where the obstacle would have to pull are given up, and those where the arm would pass
through it between the places become new ones.
"""

from __future__ import annotations

import numpy as np

from model.contact.along import along
from model.contact.newton import Held
from model.contact.passing import deep, passing
from model.contact.places import Place
from model.contact.root import Root
from model.contact.sheared import sheared
from model.contact.touches import forces, resultants
from model.effects import Shear
from model.mesh import Mesh
from model.paths import Array

# How near a point belongs to a part that lies, over an element.
_NEXT = 0.1
# gap' at a corner that counts as 0.
_LEVEL = 1e-9
# Half the length of a part that was a point, over an element; how often it may be halved.
_BORN, _HALVES = 0.5, 10
# Of the largest force, what pulls hard, and what is rounding.
_PULLED, _ROUNDING = 1e-2, 1e-9


def exchanged(
    held: Held, places: tuple[Place, ...], nodes: tuple[tuple[int, ...], ...]
) -> tuple[Place, ...]:
    """Return the places without the point that is pulled hardest, and with those it passes deep by.

    That is for places that are still moving: the same if nothing is far off.
    """
    force = forces(held.here.system, held.states)
    own = [force[at[0], p.obstacle] for at, p in zip(nodes, places, strict=True)]
    points = [i for i, place in enumerate(places) if not place.lies]
    worst = min(points, key=lambda i: own[i], default=None)
    if worst is not None and own[worst] < -_PULLED * max(own):
        return (*places[:worst], *places[worst + 1 :])
    return _sorted([*places, *deep(held, places)])


def split(places: tuple[Place, ...], parts: tuple[Place, ...]) -> tuple[Place, ...]:
    """Return the places with points at the ends of some parts in their stead."""
    kept = [place for place in places if place not in parts]
    return _sorted([*kept, *(Place(p.obstacle, s, s) for p in parts for s in p.ends)])


def narrowed(held: Held, places: tuple[Place, ...], parts: tuple[Place, ...]) -> tuple[Place, ...]:
    """Return the places with parts that points became only as long as the arm bends in about them.

    As on a face up to its edge, over which the arm does not lie.
    """
    found = list[Place]()
    for place in places:
        middle, half = (place.start + place.end) / 2, (place.end - place.start) / 2
        ends = (-half, half) if place in parts else ()
        bent = [_bent_in(held, place.obstacle, middle, end) for end in ends]
        found.append(Place(place.obstacle, *bent) if bent else place)
    return tuple(found)


def _bent_in(held: Held, j: int, middle: float, reach: float) -> float:
    """Return how far gap'' is below 0 from a point on [m], up to a reach that is halved."""
    looks = middle + reach * np.power(0.5, np.arange(_HALVES, dtype=np.float64))
    curve = along(held.here.system, held.here.x, looks, np.full(_HALVES, j))[:, 2]
    out = np.flatnonzero(curve >= 0)
    return float(looks[min(out[-1] + 1 if out.size else 0, _HALVES - 1)])


def _sorted(places: list[Place]) -> tuple[Place, ...]:
    return tuple(sorted(places, key=lambda own: (own.obstacle, own.start)))


def changed(
    held: Held,
    places: tuple[Place, ...],
    nodes: tuple[tuple[int, ...], ...],
    left: set[Place],
    roots: dict[tuple[int, int], Root],
) -> tuple[Place, ...]:
    """Return the places after some of them came, went, parted or joined; the same if none did.

    `left` remembers the corners that points left, `roots` what the gap does there.
    """
    kept, looks = list[Place](), _at_points(held, places, nodes)
    for i, (place, own, rates) in enumerate(zip(places, nodes, looks, strict=True)):
        if place.lies:
            kept += _lying(held, place, own)
        else:
            root = roots.setdefault((i, 0), Root())
            kept += _touching(held, place, own[0], rates.tolist(), left, root)
    kept = joined(kept, held.here.system.mesh)
    if tuple(kept) != places:
        return tuple(kept)
    return _sorted([*places, *passing(held, places)])


def joined(places: list[Place], mesh: Mesh) -> list[Place]:
    """Return places where points next to a part that lies on the same obstacle belong to it."""
    found = list[Place]()
    for place in _sorted(places):
        last = found[-1] if found else None
        if last is not None and last.obstacle == place.obstacle and (last.lies or place.lies):
            k = mesh.node(last.end)
            if place.start - last.end <= _NEXT * (mesh.s[min(k + 1, mesh.steps)] - mesh.s[k]):
                found[-1] = Place(place.obstacle, last.start, place.end)
                continue
        found.append(place)
    return found


def _at_points(held: Held, places: tuple[Place, ...], nodes: tuple[tuple[int, ...], ...]) -> Array:
    """Return gap' and gap'' (n, 2) at the points among places, nan at others."""
    system, found = held.here.system, np.full((len(places), 2), np.nan)
    points = [i for i, place in enumerate(places) if not place.lies]
    if points:
        s = system.mesh.s[[nodes[i][0] for i in points]]
        j = np.array([places[i].obstacle for i in points])
        found[points] = along(system, held.here.x, s, j)[:, 1:]
    return found


def _touching(
    held: Held,
    place: Place,
    node: int,
    rates: list[float],
    left: set[Place],
    root: Root,
) -> list[Place]:
    """Return what becomes of a point with gap' and gap'' there.

    One that comes back to a corner it left stays, beside another one before it.
    """
    system, j, (slope, curve) = held.here.system, place.obstacle, rates
    if forces(system, held.states)[node, j] < 0:
        return []
    h = float(np.diff(system.mesh.s)[node - 1])
    if place.start in held.corners:
        if slope <= _LEVEL:
            return [place]
        s = place.start - 0.3 * h
        before, again = Place(j, s, s), place in left
        left.add(place)
        root.values.append((place.start, slope))
        return [before, place] if again else [before]
    if system.scene.has(Shear):
        return [sheared(held, place) or place]
    if curve >= 0:
        return [place]
    half = _BORN * h
    return [Place(j, place.start - half, min(place.start + half, held.length))]


def _lying(held: Held, place: Place, nodes: tuple[int, ...]) -> list[Place]:
    """Return what becomes of a part that lies."""
    system, j = held.here.system, place.obstacle
    first, last = nodes
    ends = forces(system, held.states)[[first, last], j]
    pressed = resultants(system, held.states, held.touches)[first : last + 1, j]
    none = -_ROUNDING * pressed.max()
    if ends.min() >= none and pressed.min() >= none:
        return [place]
    points = [Place(j, s, s) for s in place.ends]
    if ends.min() >= none or ends.max() < 0:
        return points
    return [points[int(np.argmax(ends))]]
