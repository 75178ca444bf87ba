"""Where the arm touches: places that move along it, and the mesh that has its nodes there.

A place is a point, where the gap is least; the tip, where it may fall on; or a part that lies on
its obstacle from start to end, where the gap's second derivative vanishes: the moment in the arm is
continuous, and the free arm leaves the obstacle with its curvature.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.contact.touches import Touches
from model.mesh import Mesh
from model.paths import Array

# Arc lengths over the arm's that are the same.
SAME = 1e-9


@dataclass(frozen=True)
class Place:
    """Where the arm touches an obstacle, by its number among the contacts of the scene.

    Attributes
    ----------
    obstacle : int
    start, end : float
        Arc lengths [m]; the same for a point.
    """

    obstacle: int
    start: float
    end: float

    @property
    def lies(self) -> bool:
        """Whether this is a part of some length."""
        return self.end > self.start

    @property
    def ends(self) -> tuple[float, ...]:
        """The arc lengths that are nodes."""
        return (self.start, self.end) if self.lies else (self.start,)


@dataclass(frozen=True, eq=False)
class Placed:
    """A mesh with places as nodes.

    Attributes
    ----------
    mesh : Mesh
    nodes : tuple
        Of each place those of its ends.
    touches : Touches
    """

    mesh: Mesh
    nodes: tuple[tuple[int, ...], ...]
    touches: Touches


def placed(base: Mesh, fixed: Array, places: tuple[Place, ...], obstacles: int) -> Placed | None:
    """Return a mesh whose nodes are moved to places; None where it has too few between two.

    The nodes at `fixed` arc lengths stay.
    """
    L, nodes = base.s[-1], np.arange(base.s.size)
    stay = {base.node(s): float(s) for s in fixed}
    wanted = sorted((s, i, k) for i, place in enumerate(places) for k, s in enumerate(place.ends))
    anchors, found = dict(stay), dict[tuple[int, int], int]()
    last = 0
    for s, i, k in wanted:
        near = [n for n, at in anchors.items() if n > 0 and abs(at - s) <= SAME * L]
        if near:
            found[i, k] = near[0]
            last = max(last, near[0])
            continue
        low = max([n for n, at in anchors.items() if at < s])
        high = min([n for n, at in stay.items() if at > s], default=low)
        first = max(low, last) + 1 + (1 if k and places[i].lies and last == found[i, 0] else 0)
        if first >= high:
            return None
        last = int(np.clip(np.rint(np.interp(s, base.s, nodes)), first, high - 1))
        anchors[last], found[i, k] = s, last
    at = np.array(sorted(anchors))
    s = np.interp(base.s, base.s[at], np.array([anchors[n] for n in at]))
    if np.diff(s).min() <= 0:
        return None
    own = tuple(tuple(found[i, k] for k in range(len(p.ends))) for i, p in enumerate(places))
    return Placed(Mesh(s, base.active), own, _touches(own, places, base.steps, obstacles))


def _touches(
    own: tuple[tuple[int, ...], ...], places: tuple[Place, ...], elements: int, obstacles: int
) -> Touches:
    point, end, inside, lies = (
        np.zeros((elements + n, obstacles), dtype=bool) for n in (1, 1, 1, 0)
    )
    for nodes, place in zip(own, places, strict=True):
        j = place.obstacle
        if place.lies:
            first, final = nodes
            end[[first, final], j] = True
            inside[first + 1 : final, j] = lies[first:final, j] = True
            lies[first, j] = True
        else:
            point[nodes[0], j] = True
    return Touches(point, end, inside, lies)
