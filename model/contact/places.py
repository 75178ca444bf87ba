"""Places where the arm touches, and the mesh that has them as nodes.

A place is a point, where the gap is least; the tip, where it may fall on; or a part that lies on
its obstacle from start to end, where the gap's second derivative vanishes: the moment in the arm is
continuous, and the free arm leaves the obstacle with its curvature.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.contact.touches import Touches
from model.mesh import Mesh, with_nodes
from model.paths import Array
from model.transcription.system import System

# Arc lengths over the arm's that are the same, and those of points that share a node.
SAME, _BESIDE = 1e-9, 1e-6
# The least elements of a part that lies: one node inside of it.
_LYING = 2


@dataclass(frozen=True, order=True)
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


Places = tuple[Place, ...]


def point(obstacle: int, s: float) -> Place:
    """Return the place of a point."""
    return Place(obstacle, s, s)


def mesh_with(base: System, fixed: Array, places: Places) -> Mesh | None:
    """Return the mesh of equations with its nodes moved so that some are at places.

    Nodes at `fixed` arc lengths (n,) stay; points that are very near to each other share one.
    Elements are halved where there are too few. None where a place is no arc length.
    """
    at = np.array([s for place in places for s in (place.start, place.end)])
    if not (np.isfinite(at) & (at > 0) & (at <= base.arm.length)).all():
        return None
    nodes, anchors = base.mesh.s, None
    while anchors is None:
        anchors = _anchors(nodes, fixed, places)
        order = np.arange(nodes.size)
        if anchors is None:
            nodes = np.interp(np.arange(2 * nodes.size - 1) / 2, order, nodes)
    known = sorted(anchors)
    return with_nodes(base.arm, np.interp(order, known, [anchors[k] for k in known]))


def _anchors(nodes: Array, fixed: Array, places: Places) -> dict[int, float] | None:
    """Return where some of the nodes (N + 1,) go, the nearest in order; None if there are too few.

    A part has a node inside of it.
    """
    found = {int(np.argmin(np.abs(nodes - s))): float(s) for s in fixed}
    stay, near = sorted(found), _BESIDE * float(nodes[-1])
    ends = {(place.start, _LYING if place.lies else 1, 1) for place in places}
    ends |= {(place.end, 1, _LYING) for place in places if place.lies}
    for s, room, apart in sorted(ends):
        if min(abs(s - own) for own in found.values()) <= near:
            continue
        after = next(k for k in stay if found[k] > s) - room
        before = max(k for k, own in found.items() if own < s) + apart
        k = max(round(float(np.interp(s, nodes, np.arange(nodes.size)))), before)
        if min(k, after) < before:
            return None
        found[min(k, after)] = s
    return found


def touches_at(mesh: Mesh, places: Places, obstacles: int, sheared: bool) -> Touches:
    """Return how the nodes of a mesh touch at places.

    Parts of an arm that is `sheared` have no forces at their ends.
    """
    found = Touches.none(mesh.steps, obstacles)
    for place in places:
        first, last, j = mesh.node(place.start), mesh.node(place.end), place.obstacle
        if not place.lies:
            found.point[first, j] = True
            continue
        (found.inside if sheared else found.end)[[first, last], j] = True
        found.inside[first + 1 : last, j] = found.lies[first:last, j] = True
    return found


def places_of(system: System) -> Places:
    """Return the places that equations of equilibrium are told of."""
    s, touches, found = system.mesh.s, Touches.of(system), list[Place]()
    for j in range(touches.point.shape[1]):
        found += [point(j, at) for at in s[touches.point[:, j]].tolist()]
        edges = np.diff(touches.lies[:, j].astype(int), prepend=0, append=0)
        pairs = zip(s[edges > 0].tolist(), s[edges < 0].tolist(), strict=True)
        found += [Place(j, a, b) for a, b in pairs]
    return tuple(sorted(found))
