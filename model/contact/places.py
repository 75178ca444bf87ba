"""Where the arm touches: places that move along it, and the mesh that has its nodes there.

A place is a point, where the gap is least; the tip, where it may fall on; or a part that lies on
its obstacle from start to end, where the gap's second derivative vanishes: the moment in the arm is
continuous, and the free arm leaves the obstacle with its curvature.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from model.contact.touches import Touches
from model.mesh import Mesh
from model.paths import Array

# Arc lengths over the arm's that are the same, and those of points that share a node.
SAME, _BESIDE = 1e-9, 1e-6


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


def placed(
    base: Mesh, fixed: Array, places: tuple[Place, ...], obstacles: int, sheared: bool = False
) -> Placed | None:
    """Return a mesh whose nodes are moved to places; None where two are one, or one is no number.

    Parts of an arm that is `sheared` have no forces at their ends, see model.contact.sheared.

    The nodes at `fixed` arc lengths stay. Where there are too few between two of these, elements
    are halved.
    """
    ends = sorted((s, i, k) for i, place in enumerate(places) for k, s in enumerate(place.ends))
    at, same = np.array([end[0] for end in ends]), SAME * base.s[-1]
    if not np.isfinite(at).all():
        return None
    if ends and (np.abs(at[:, None] - fixed).min(axis=1) > same).any():
        base = _roomy(base, fixed, at)
    anchors, found = {base.node(s): float(s) for s in fixed}, dict[tuple[int, int], int]()
    stay = np.array(sorted(anchors))
    for low, high in pairwise(stay.tolist()):
        own = [end for end in ends if base.s[low] + same < end[0] < base.s[high] - same]
        shared = _shared(own, places, _BESIDE * base.s[-1])
        first = [group[0] for group in shared]
        for n, group in zip(_chosen(base, first, low, high), shared, strict=True):
            anchors[n] = sum(end[0] for end in group) / len(group)
            found.update((end[1:], n) for end in group)
    found.update((end[1:], base.node(end[0])) for end in ends if end[1:] not in found)
    order = np.array(sorted(anchors))
    s = np.interp(base.s, base.s[order], np.array([anchors[n] for n in order]))
    if np.diff(s).min() <= same:
        return None
    nodes = tuple(tuple(found[i, k] for k in range(len(p.ends))) for i, p in enumerate(places))
    return Placed(
        Mesh(s, base.active), nodes, _touches(nodes, places, base.steps, obstacles, sheared)
    )


def _shared(
    ends: list[tuple[float, int, int]], places: tuple[Place, ...], near: float
) -> list[list[tuple[float, int, int]]]:
    """Return ends in order, points of different obstacles that are as near together.

    As where an arm lies in the groove between two of them: what they are off their node is told
    with how far points touch from there.
    """
    found = list[list[tuple[float, int, int]]]()
    for end in ends:
        own, others = places[end[1]], [places[other[1]] for other in found[-1]] if found else []
        alike = bool(others) and not any(p.lies for p in (own, *others))
        if (
            alike
            and end[0] - found[-1][0][0] < near
            and own.obstacle not in {p.obstacle for p in others}
        ):
            found[-1].append(end)
        else:
            found.append([end])
    return found


def _roomy(base: Mesh, fixed: Array, ends: Array) -> Mesh:
    """Return a mesh with two nodes for each of the ends (n,) between fixed nodes, and one more."""
    nodes, active = base.s, base.active
    for low, high in pairwise(np.unique(np.append(fixed, [0.0, base.s[-1]])).tolist()):
        need = 1 + 2 * int(((ends > low) & (ends < high)).sum())
        while need > 1 and ((nodes > low) & (nodes < high)).sum() < need:
            inside = (nodes[:-1] >= low) & (nodes[1:] <= high)
            middle = (nodes[:-1] + nodes[1:])[inside] / 2
            active = np.repeat(active, 1 + inside)
            nodes = np.sort(np.append(nodes, middle))
    return base if nodes is base.s else Mesh(nodes, active)


def _chosen(base: Mesh, ends: list[tuple[float, int, int]], low: int, high: int) -> list[int]:
    """Return nodes between two that stay, the nearest that are in order, for ends in order.

    A part has a node inside of it.
    """
    apart = [1 + (k == 1 and ends[n - 1][1] == i) for n, (_, i, k) in enumerate(ends)]
    room = [sum(apart[n + 1 :]) + 1 for n in range(len(ends))]
    found, last = list[int](), low
    for (s, *_), gap, left in zip(ends, apart, room, strict=True):
        near = int(np.rint(np.interp(s, base.s, np.arange(base.s.size))))
        last = min(max(near, last + gap), high - left)
        found.append(last)
    return found


def _touches(
    own: tuple[tuple[int, ...], ...],
    places: tuple[Place, ...],
    elements: int,
    obstacles: int,
    sheared: bool,
) -> Touches:
    point, end, inside, lies = (
        np.zeros((elements + n, obstacles), dtype=bool) for n in (1, 1, 1, 0)
    )
    for nodes, place in zip(own, places, strict=True):
        j = place.obstacle
        if place.lies:
            first, final = nodes
            (inside if sheared else end)[[first, final], j] = True
            inside[first + 1 : final, j] = lies[first:final, j] = True
            lies[first, j] = True
        else:
            point[nodes[0], j] = True
    return Touches(point, end, inside, lies)
