"""Where the arm touches, the mesh that has these places as nodes, and the flags of its kernels.

A place is a point, where the gap is least; the tip, where it may fall on; or a part that lies on
its obstacle from start to end, where the gap's second derivative vanishes: the moment in the arm is
continuous, and the free arm leaves the obstacle with its curvature.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.mesh import Mesh, with_nodes
from model.paths import Array
from model.rotations import matrices
from model.transcription.system import System
from model.transcription.touch import BEFORE, FRICTION, FRICTION_TOLD, PRESSURE, TOLD, TOUCH

Mask = NDArray[np.bool_]
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


@dataclass(frozen=True, eq=False)
class Touches:
    """How nodes touch obstacles; where all is False the arm is free.

    Attributes
    ----------
    point : (N + 1, K)
        Nodes at which a force keeps the gap to each of K obstacles at 0.
    end : (N + 1, K)
        Nodes where a part that lies on an obstacle begins or ends: force and pressure.
    inside : (N + 1, K)
        Nodes inside of such a part: pressure alone.
    lies : (N, K)
        Elements that such parts consist of.
    curve : (N + 1, K)
        gap'' [1/m] of points that may move along the arm, above 0; 0 where nodes stay.
    """

    point: Mask
    end: Mask
    inside: Mask
    lies: Mask
    curve: Array

    @classmethod
    def none(cls, elements: int, obstacles: int) -> Touches:
        """Return those of a free arm."""
        nodes = elements + 1, obstacles
        point, end, inside = (np.zeros(nodes, dtype=bool) for _ in range(3))
        return cls(point, end, inside, np.zeros((elements, obstacles), dtype=bool), np.zeros(nodes))

    @classmethod
    def of(cls, system: System) -> Touches:
        """Return those that are set on a system."""
        of = system.of
        touches = cls.none(of.elements, of.form.contacts)
        rows = system.p[of.equations.numbers_of("touch")].reshape(of.elements, -1, TOUCH)
        held, inside, end, _, curve = np.moveaxis(rows[:, :, -TOLD:], 2, 0)
        touches.point[1:], touches.end[1:] = (held > 0) & (end == 0), end > 0
        touches.inside[1:], touches.curve[1:] = inside > 0, curve
        if of.form.pressed:
            elements = system.p[of.equations.numbers_of("pressure")]
            touches.lies[:] = elements.reshape(of.elements, -1, PRESSURE)[:, :, -1] > 0
        return touches

    @property
    def held(self) -> Mask:
        """Nodes with a force (N + 1, K)."""
        return self.point | self.end

    @property
    def moves(self) -> Mask:
        """Nodes that touch at points which may move along the arm (N + 1, K)."""
        return np.asarray(self.curve > 0)

    @property
    def pressing(self) -> Mask:
        """Nodes with a pressure (N + 1, K)."""
        return self.end | self.inside

    def on(self, system: System) -> System:
        """Return a system with these touches set."""
        changed, of = copy.copy(system), system.of
        changed.p = system.p.copy()
        rows = changed.p[of.equations.numbers_of("touch")].reshape(-1, TOUCH)
        flags = [self.held, self.inside, self.end, self.moves, self.curve]
        rows[:, -TOLD:] = np.stack(flags, axis=2)[1:].reshape(-1, TOLD)
        if of.form.pressed:
            elements = changed.p[of.equations.numbers_of("pressure")].reshape(-1, PRESSURE)
            elements[:, -1] = self.lies.ravel()
        if of.form.contact_friction:
            friction = changed.p[of.equations.numbers_of("contact_friction")].reshape(-1, FRICTION)
            first = self.end & np.vstack([self.lies, np.zeros_like(self.lies[:1])])
            flags = [self.held, self.inside, self.end & ~first, first, self.moves]
            friction[:, -BEFORE - FRICTION_TOLD : -BEFORE] = np.stack(flags, axis=2)[1:].reshape(
                -1, FRICTION_TOLD
            )
        return changed


def forces(system: System, states: Array) -> Array:
    """Return the contact force of each node on each obstacle (N + 1, K) [N]."""
    return np.asarray(states[system.of.touches[:, :, 0]])


def second(system: System, states: Array) -> Array:
    """Return the second unknown of each node and obstacle (N + 1, K): pressure [N/m], or a shift.

    The shift [m] is how far on along the arm a point touches.
    """
    return np.asarray(states[system.of.touches[:, :, 1]])


def resultants(system: System, states: Array, touches: Touches) -> Array:
    """Return the forces with which obstacles press at the nodes (N + 1, K) [N].

    Of a pressure that is linear between nodes what falls to each by the lever rule.
    """
    p = second(system, states) * touches.pressing
    before, here, beyond = pressure_shares(system, touches.lies)
    total = forces(system, states) * touches.held + here * p
    total[1:] += before[1:] * p[:-1]
    total[:-1] += beyond[:-1] * p[1:]
    return total


def pressure_shares(system: System, lies: Mask) -> tuple[Array, Array, Array]:
    """Return how much of the pressures before, at and beyond each node falls to it (N + 1, K) [m].

    By the lever rule, of elements that lie (N, K).
    """
    h, none = np.diff(system.mesh.s)[:, None] * lies, np.zeros((1, lies.shape[1]))
    before, beyond = np.vstack([none, h]) / 6, np.vstack([h, none]) / 6
    return before, 2 * (before + beyond), beyond


def frictions(system: System, states: Array, touches: Touches) -> Array:
    """Return the friction at each node from each obstacle (N + 1, K, 3) [N], 0 without any.

    Of the traction between nodes as much falls to each as of the pressure.
    """
    of = system.of
    if not of.form.contact_friction:
        return np.zeros((of.elements + 1, of.form.contacts, 3))
    p = second(system, states) * touches.pressing
    spread = resultants(system, states, touches) - forces(system, states) * touches.held
    length = np.divide(spread, p, out=np.zeros_like(p), where=p > 0)
    frames = matrices(system.poses(states)[:, :4])
    tau = np.einsum("nij,nkj->nki", frames, states[of.tractions])
    return np.asarray(states[of.friction_forces] + length[:, :, None] * tau)


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
    nodes_there = sorted(anchors)
    return with_nodes(base.arm, np.interp(order, nodes_there, [anchors[k] for k in nodes_there]))


def _anchors(nodes: Array, fixed: Array, places: Places) -> dict[int, float] | None:
    """Return where some of the nodes (N + 1,) go, the nearest in order; None if there are too few.

    A part has a node inside of it.
    """
    anchors = {int(np.argmin(np.abs(nodes - s))): float(s) for s in fixed}
    stay, near = sorted(anchors), _BESIDE * float(nodes[-1])
    ends = {(place.start, _LYING if place.lies else 1, 1) for place in places}
    ends |= {(place.end, 1, _LYING) for place in places if place.lies}
    for s, room, apart in sorted(ends):
        if min(abs(s - at) for at in anchors.values()) <= near:
            continue
        after = next(k for k in stay if anchors[k] > s) - room
        before = max(k for k, at in anchors.items() if at < s) + apart
        k = max(round(float(np.interp(s, nodes, np.arange(nodes.size)))), before)
        if min(k, after) < before:
            return None
        anchors[min(k, after)] = s
    return anchors


def touches_at(mesh: Mesh, places: Places, obstacles: int, sheared: bool) -> Touches:
    """Return how the nodes of a mesh touch at places.

    Parts of an arm that is `sheared` have no forces at their ends.
    """
    touches = Touches.none(mesh.steps, obstacles)
    for place in places:
        first, last, j = mesh.node(place.start), mesh.node(place.end), place.obstacle
        if not place.lies:
            touches.point[first, j] = True
            continue
        (touches.inside if sheared else touches.end)[[first, last], j] = True
        touches.inside[first + 1 : last, j] = touches.lies[first:last, j] = True
    return touches


def places_of(system: System) -> Places:
    """Return the places that are set on a system."""
    s, touches, places = system.mesh.s, Touches.of(system), list[Place]()
    for j in range(touches.point.shape[1]):
        places += [point(j, at) for at in s[touches.point[:, j]].tolist()]
        edges = np.diff(touches.lies[:, j].astype(int), prepend=0, append=0)
        pairs = zip(s[edges > 0].tolist(), s[edges < 0].tolist(), strict=True)
        places += [Place(j, a, b) for a, b in pairs]
    return tuple(sorted(places))
