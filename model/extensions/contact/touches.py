"""Contact places: the mesh with these places as nodes, flags of kernels, contact points of a shape.

A place is a point of least gap, the tip, or a part that lies on an obstacle from start to end. At
both ends of a part the second derivative of the gap vanishes: the moment in the arm is continuous,
and the free arm leaves the obstacle with the curvature of the obstacle.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from octoplan.model.centreline import outer_radii
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.extensions.contact.effects import bodies_of, contacts
from octoplan.model.extensions.contact.kernels import FLAGS
from octoplan.model.extensions.contact.term import contact_places
from octoplan.model.extensions.obstacles.base import Convex, pair_distances
from octoplan.model.mesh import Mesh, with_nodes
from octoplan.model.paths import Array, Mask
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rotations import matrices
from octoplan.model.support.checks import SMALLEST

# Arc lengths of points that share a node, over the arm's.
BESIDE = 1e-6


class Place(NamedTuple):
    """A point or a part of the arm in contact, with the index of the contact in the scene.

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
        """Whether the place is a part of the arm, not a point."""
        return self.end > self.start


Places = tuple[Place, ...]


class ContactFlags:
    """Flags of the kernels for the contact of nodes with obstacles; all flags of a free arm are 0.

    Attributes
    ----------
    flags : (N + 1, K, 4)
        All flags by node and obstacle; 0 at the base, which is clamped.
    held, pressing : (N + 1, K)
        1 for nodes with a force, and for nodes with a pressure. Points have a force that keeps the
        gap at 0, nodes inside parts have a pressure, and ends of parts have both.
    moves : (N + 1, K)
        1 for points that may move along the arm.
    lies : (N + 1, K)
        1 for nodes on whose tip side the element lies on the obstacle.
    """

    def __init__(self, flags: Array) -> None:
        self.flags = flags
        self.held, self.pressing, self.moves, self.lies = np.moveaxis(flags, 2, 0)

    @classmethod
    def of(cls, system: DiscreteRod) -> ContactFlags:
        """Return the flags of a system."""
        return cls(np.pad(kernel_numbers(system, "touch")[..., FLAGS], ((1, 0), (0, 0), (0, 0))))

    @property
    def points(self) -> Mask:
        """Whether nodes touch at points (N + 1, K)."""
        return np.asarray(self.held > self.pressing)

    @property
    def touching(self) -> Mask:
        """Whether nodes touch (N + 1, K)."""
        return np.asarray(self.held + self.pressing > 0)

    def on(self, system: DiscreteRod) -> DiscreteRod:
        """Return a system with these flags."""
        changed = copy.copy(system)
        kernel_numbers(changed, "touch")[..., FLAGS] = self.flags[1:]
        if "pressure" in changed.parameters:
            kernel_numbers(changed, "pressure")[:, :, -1] = self.lies[:-1]
        return changed


def kernel_numbers(system: DiscreteRod, kernel: str) -> Array:
    """Return the parameters (N, K, n) of a contact kernel, as a view of the system's parameters."""
    values = system.parameters[kernel]["values"].T
    return values.reshape(system.layout.elements, len(contacts(system.scene)), -1)


def forces(system: DiscreteRod, states: Array) -> Array:
    """Return the contact force of each node on each obstacle (..., N + 1, K) [N].

    `states` are (..., n_states).
    """
    return np.asarray(states[..., contact_places(system.layout).touches[:, :, 0]])


def second(system: DiscreteRod, states: Array) -> Array:
    """Return the second unknown of each node and obstacle (..., N + 1, K).

    The second unknown is the pressure [N/m], or the distance along the arm from the node to the
    contact point [m]. `states` are (..., n_states).
    """
    return np.asarray(states[..., contact_places(system.layout).touches[:, :, 1]])


def resultants(system: DiscreteRod, states: Array) -> Array:
    """Return the normal forces of the obstacles at the nodes (..., N + 1, K) [N].

    The lever rule distributes a pressure that is linear between two nodes to both nodes. `states`
    are (..., n_states).
    """
    touches = ContactFlags.of(system)
    p, thirds = second(system, states) * touches.pressing, np.diff(system.mesh.s)[:, None] / 3
    total = forces(system, states) * touches.held
    before, beyond = p[..., :-1, :], p[..., 1:, :]
    total[..., :-1, :] += thirds * touches.lies[:-1] * (before + beyond / 2)
    total[..., 1:, :] += thirds * touches.lies[:-1] * (before / 2 + beyond)
    return np.asarray(total)


def frictions(system: DiscreteRod, states: Array) -> Array:
    """Return the friction at each node from each obstacle (N + 1, K, 3) [N]; 0 without friction.

    The traction between two nodes is distributed to both nodes like the pressure.
    """
    places = contact_places(system.layout)
    touches = ContactFlags.of(system)
    if not places.friction_forces.size:
        return np.zeros((*places.touches.shape[:2], 3))
    if not places.tractions.size:
        return np.asarray(states[places.friction_forces])
    p = second(system, states) * touches.pressing
    spread = resultants(system, states) - forces(system, states) * touches.held
    length = np.divide(spread, p, out=np.zeros_like(p), where=p > 0)
    frames = matrices(system.poses(states)[:, :4])
    tau = np.einsum("nij,nkj->nki", frames, states[places.tractions])
    return np.asarray(states[places.friction_forces] + length[:, :, None] * tau)


def mesh_with(base: DiscreteRod, fixed: Array, places: Places) -> Mesh | None:
    """Return the mesh of a system with nodes moved to the contact places.

    Nodes at `fixed` arc lengths (n,) stay; points that nearly coincide share a node. Parts have a
    node in the middle, and elements are halved if there are too few. Return None if the arc length
    of a place is not on the arm beyond the base.
    """
    L, wanted = base.arm.length, fixed
    ends = np.array([s for _, *part in places for s in (*part, sum(part) / 2)])
    if not (np.isfinite(ends) & (ends > BESIDE * L) & (ends <= L)).all():
        return None
    for s in ends:
        wanted = wanted if np.abs(wanted - s).min() <= BESIDE * L else np.append(wanted, s)
    wanted, nodes = np.sort(wanted), base.mesh.s
    stay, apart = np.isin(wanted, fixed), np.arange(wanted.size)
    while True:
        # The nearest nodes in order: shifted to the tip, then back from nodes that stay.
        nearest = np.round(np.interp(wanted, nodes, np.arange(nodes.size))).astype(int)
        k = np.where(stay, nearest, apart + np.maximum.accumulate(nearest - apart))
        k = apart + np.minimum.accumulate((k - apart)[::-1])[::-1]
        if (np.diff(k) > 0).all() and (k == nearest)[stay].all():
            return with_nodes(base.arm, np.interp(np.arange(nodes.size), k, wanted))
        nodes = np.interp(np.arange(2 * nodes.size - 1) / 2, np.arange(nodes.size), nodes)


def places_of(system: DiscreteRod) -> Places:
    """Return the contact places of a system."""
    touches = ContactFlags.of(system)
    return read_off(system, touches.touching, touches.lies > 0, touches.held)


def read_off(system: DiscreteRod, touching: Mask, joined: Mask, force: Array) -> Places:
    """Return the places of touching nodes (N + 1, K) in order, weighted by the forces.

    Three or more consecutive nodes whose elements lie on the obstacle form a part.
    """
    s, places, last = system.mesh.s, list[Place](), system.mesh.elements
    for j in range(touching.shape[1]):
        nodes = np.flatnonzero(touching[:, j])
        linked = (np.diff(nodes) == 1) & joined[nodes[:-1], j]
        for run in np.split(nodes, np.flatnonzero(~linked) + 1) if nodes.size else ():
            start, end = s[run[0]], s[run[-1]]
            if run.size < 3 and run[-1] < last:
                start = end = np.average(s[run], weights=force[run, j] + SMALLEST)
            places.append(Place(j, float(start if run.size > 2 else end), float(end)))
    return tuple(places)


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """A contact point of an arm with an obstacle.

    A part of the arm that lies on an obstacle has a contact point at each node: end forces, and the
    share of the pressure that the lever rule gives to the node. These forces have the resultant and
    the moment of the pressure, up to an error that falls with the square of the element length.

    Attributes
    ----------
    obstacle : Convex
    s : float
        Arc length from the base [m].
    force : (3,)
        Force on the arm, in the base frame [N].
    gap : float
        Distance between the arm's surface and the obstacle [m].
    point : (3,)
        Contact point on the obstacle's surface [m].
    normal : (3,)
        Unit vector out of the obstacle, towards the arm's midline, along which the normal force
        acts, also at edges and corners of the obstacle.
    pressure : float
        Force per reference length [N/m]; 0 for a contact at a point.
    friction : (3,)
        Component of the force along the obstacle's surface [N].
    slip : (3,)
        Displacement of the midline along the surface in the last step [m]; friction opposes the
        slip. 0 for points that stick, and without friction.
    """

    obstacle: Convex
    s: float
    force: Array
    gap: float
    point: Array
    normal: Array
    pressure: float = 0.0
    friction: Array = field(default_factory=lambda: np.zeros(3))
    slip: Array = field(default_factory=lambda: np.zeros(3))


def equilibrium_contacts(
    point: Equilibrium, before: Equilibrium | None = None
) -> tuple[ContactPoint, ...]:
    """Return the contact points of an equilibrium from base to tip.

    With friction, slip is measured from the equilibrium `before` the last step.
    """
    system, states = point.system, point.states
    touches, bodies = ContactFlags.of(system), contacts(system.scene)
    nodes, numbers = np.nonzero(touches.touching)
    if not nodes.size:
        return ()
    s, places = system.mesh.s[nodes], system.poses(states)[nodes, 4:]
    distance, normals = pair_distances(bodies_of(system.scene)[numbers], places)
    gaps = distance - outer_radii(system, states[system.layout.stages])[nodes - 1]
    slipped = 0 * places if before is None else places - before.at(s)[0][:, 4:]
    slipped -= (slipped * normals).sum(axis=1, keepdims=True) * normals
    rubbed = frictions(system, states)[nodes, numbers]
    force = resultants(system, states)[nodes, numbers, None] * normals + rubbed
    pressure = (second(system, states) * touches.pressing)[nodes, numbers]
    return tuple(
        ContactPoint(
            bodies[j].obstacle,
            float(s[i]),
            force[i],
            float(gaps[i]),
            places[i] - distance[i] * normals[i],
            normals[i],
            float(pressure[i]),
            rubbed[i],
            slipped[i] * (bodies[j].friction > 0),
        )
        for i, j in enumerate(numbers)
    )
