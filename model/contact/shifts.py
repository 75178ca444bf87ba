"""How places move along the arm, as an equilibrium with them says.

Points move to where the gap is least, ends of parts that lie to where the gap's second derivative
vanishes.
"""

from __future__ import annotations

from model.contact.changes import joined
from model.contact.ends import longest, where_it_ends
from model.contact.newton import Held
from model.contact.places import Place
from model.contact.root import Root
from model.contact.touches import second

# How far off points may be, over the arm's length.
_FOUND = 1e-8


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
            f, shift, most = (where_it_ends if place.lies else _point)(held, place, node, 2 * k - 1)
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
    return tuple(joined(found, held.here.system.mesh))


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
    most = 0.5 * longest(system.mesh)
    return -float(curve[node, j]) * shift, shift * (abs(shift) > _FOUND * held.length), most
