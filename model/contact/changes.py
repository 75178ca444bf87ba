"""How places move along the arm, come and go, part and join, as an equilibrium with them says.

Points move to where the gap is least, ends of parts that lie to where the gap's second derivative
vanishes. Places where the obstacle would have to pull are given up, and those where the arm would
pass through it between the places become new ones.
"""

from __future__ import annotations

import numpy as np

from model.contact.along import along
from model.contact.newton import Held
from model.contact.passing import deep, passing
from model.contact.places import SAME, Place
from model.contact.root import Root
from model.contact.sheared import sheared, tangent_end
from model.contact.touches import forces, resultants, second
from model.effects import Shear
from model.loads import contacts
from model.mesh import Mesh
from model.paths import Array

# How far off points, and ends of parts that lie, may be, over the arm's length.
_FOUND, _FOUND_END = 1e-8, 1e-10
# How near a point belongs to a part that lies, over an element.
_NEXT = 0.1
# gap' at a corner that counts as 0.
_LEVEL = 1e-9
# Half the length of a part that was a point, over an element; how often it may be halved.
_BORN, _HALVES = 0.5, 10
# Of the largest force, what pulls hard, and what is rounding.
_PULLED, _ROUNDING = 1e-2, 1e-9
# How far from an end derivatives are taken, over an element; among how many places, and how often,
# the one is looked for where gap'' jumps, and by how much, over 1 / L.
_ASIDE, _LOOKS, _NARROWED, _JUMP = 0.05, 33, 4, 1e-2


def moved(
    held: Held,
    places: tuple[Place, ...],
    nodes: tuple[tuple[int, ...], ...],
    roots: dict[tuple[int, int], Root],
) -> tuple[Place, ...]:
    """Return the places where the equilibrium says that they are; the same where they are found.

    `roots` remember where they were before, by place and end.
    """
    found = list[Place]()
    for i, (place, own) in enumerate(zip(places, nodes, strict=True)):
        ends = list(place.ends)
        for k, node in enumerate(own):
            f, shift, most = (_end if place.lies else _point)(held, place, node, 2 * k - 1)
            root = roots.setdefault((i, k), Root())
            if shift and not root.is_jump(ends[k], f, _FOUND * held.length):
                after = root.next(ends[k], f, ends[k] + shift, most)
                ends[k] = after if place.lies else _up_to_corner(held, ends[k], after)
                ends[k] = min(ends[k], held.length)
        if place.lies and ends[0] >= ends[1]:
            ends = [sum(ends) / 2] * 2
        found.append(
            place if ends == list(place.ends) else Place(place.obstacle, ends[0], ends[-1])
        )
    return tuple(_joined(found, held.here.system.mesh))


def _up_to_corner(held: Held, s: float, after: float) -> float:
    """Return where a point goes that passes no corner."""
    for corner in held.corners:
        if min(s, after) < corner < max(s, after):
            return corner
    return after


def _point(held: Held, place: Place, node: int, _: int) -> tuple[float, float, float]:
    """Return gap' at a point, how far on it touches, 0 if it is found, and how far it may move."""
    system, j = held.here.system, place.obstacle
    curve = held.touches.curve
    if place.start in held.corners or curve is None:
        return 0.0, 0.0, 0.0
    shift = float(system.mesh.s[node] + second(system, held.states)[node, j]) - place.start
    most = 0.5 * float(np.diff(system.mesh.s)[max(node - 1, 0)])
    return -float(curve[node, j]) * shift, shift * (abs(shift) > _FOUND * held.length), most


def _end(held: Held, place: Place, node: int, side: int) -> tuple[float, float, float]:
    """Return gap'' beyond the end of a part that lies, how far on it vanishes, and the farthest.

    With friction gap'' inside of it.
    """
    system, beyond = held.here.system, node + side
    s, at = system.mesh.s, float(system.mesh.s[node])
    if at >= held.length * (1 - SAME) or not 0 <= beyond < s.size:
        return 0.0, 0.0, 0.0
    h = abs(s[beyond] - at)
    if system.scene.has(Shear):
        return tangent_end(held, place, node, side, h)
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
        shift = side * max(abs(edge - at), _FOUND * held.length / 2)
    most = min(0.8 * h, 0.35 * (place.end - place.start))
    return float(here), shift * (abs(shift) > _FOUND_END * held.length), most


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
) -> tuple[Place, ...]:
    """Return the places after some of them came, went, parted or joined; the same if none did.

    `left` remembers the corners that points left.
    """
    kept = list[Place]()
    for place, own in zip(places, nodes, strict=True):
        kept += _lying(held, place, own) if place.lies else _touching(held, place, own, left)
    kept = _joined(kept, held.here.system.mesh)
    if tuple(kept) != places:
        return tuple(kept)
    return _sorted([*places, *passing(held, places)])


def _joined(places: list[Place], mesh: Mesh) -> list[Place]:
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


def _touching(held: Held, place: Place, nodes: tuple[int, ...], left: set[Place]) -> list[Place]:
    """Return what becomes of a point.

    One that comes back to a corner it left stays, beside another one before it.
    """
    system, j = held.here.system, place.obstacle
    if forces(system, held.states)[nodes[0], j] < 0:
        return []
    _, slope, curve = along(system, held.here.x, np.array([place.start]), np.array([j]))[0]
    h = float(np.diff(system.mesh.s)[nodes[0] - 1])
    if place.start in held.corners:
        if slope <= _LEVEL:
            return [place]
        s = place.start - 0.3 * h
        before, again = Place(j, s, s), place in left
        left.add(place)
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
