"""What a settled arm leans on, as it is read off: forces and where they act."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from model.centreline import Centreline
from model.contact.touches import Touches, frictions, resultants, second
from model.equilibrium.linearised import Linearised
from model.loads import contacts
from model.obstacles import numbers_of
from model.obstacles.base import Convex, pair_distances
from model.paths import Array


@dataclass(frozen=True, eq=False)
class Touch:
    """A place where an arm leans on an obstacle.

    Where a part of the arm lies on one there is a touch at each node of it: forces at its ends, and
    of the pressure what falls to the node, the same resultant and moment as it.

    Attributes
    ----------
    obstacle : Convex
    s : float
        Arc length from the base [m].
    force : (3,)
        On the arm, in the base frame [N].
    gap : float
        Between the arm's surface and the obstacle [m].
    point : (3,)
        Of the obstacle's surface, where they touch [m].
    normal : (3,)
        Out of the obstacle, towards the arm's midline; a unit vector. At an edge or a corner, where
        the surface has no normal, it is this alone that tells along what the arm presses.
    pressure : float
        Force per unit reference length there [N/m]; 0 where the arm touches at a point.
    friction : (3,)
        The part of the force that is along the obstacle's surface [N].
    slip : (3,)
        How far the midline there has slipped along the surface in the last step [m], against which
        friction acts; 0 where it sticks, and where there is no friction.
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


def touches_of(point: Linearised, before: Linearised | None = None) -> tuple[Touch, ...]:
    """Return what an arm leans on in an equilibrium, from base to tip.

    With friction of contacts it slipped since the equilibrium before.
    """
    system, states = point.system, point.states
    touches, bodies = Touches.of(system), contacts(system.scene)
    nodes, numbers = np.nonzero(touches.touching)
    if not nodes.size:
        return ()
    s, places = system.mesh.s[nodes], system.poses(states)[nodes, 4:]
    distance, normals = pair_distances(numbers_of([bodies[j].obstacle for j in numbers]), places)
    # Strains may jump at a node, and with them the radius of a body that swells.
    line = Centreline.at_states(system, states)
    sides = np.clip([nodes - 1, nodes], 0, system.mesh.steps - 1)
    gaps = distance - np.max([line.radius(k, (nodes > k).astype(float)) for k in sides], axis=0)
    slipped = 0 * places if before is None else places - before.at(s)[0][:, 4:]
    slipped -= (slipped * normals).sum(axis=1, keepdims=True) * normals
    rubbed = frictions(system, states)[nodes, numbers]
    force = resultants(system, states)[nodes, numbers, None] * normals + rubbed
    pressure = (second(system, states) * touches.pressing)[nodes, numbers]
    return tuple(
        Touch(
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
