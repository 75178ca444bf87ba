"""What a settled arm leans on, as it is read off: forces and where they act."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from model.contact.friction import History
from model.contact.gaps import along
from model.contact.touches import SAME, Touches, frictions, resultants, second
from model.equilibrium.linearised import Linearised
from model.loads import contacts
from model.obstacles import distances, numbers_of
from model.obstacles.base import Convex
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


def touches_of(here: Linearised, history: History | None = None) -> tuple[Touch, ...]:
    """Return what an arm leans on in an equilibrium, from base to tip."""
    system, states = here.system, here.states
    touches, s, length = Touches.of(system), system.mesh.s, system.arm.length
    nodes, numbers = np.nonzero(touches.held | touches.inside)
    if not nodes.size:
        return ()
    p = second(system, states) * touches.pressing
    size = resultants(system, states, touches)
    bodies, places = contacts(system.scene), system.poses(states)[:, 4:]
    tangential = frictions(system, states, touches)
    slipped = 0 * places if history is None else places - history.positions(s)
    distance, normals = distances(numbers_of([body.obstacle for body in bodies]), places)
    # Strains may jump at a node, and with them the radius of a body that swells.
    sides = [np.minimum(s[nodes] + side * length, length) for side in (0.0, SAME)]
    gaps = np.min([along(system, here.x, side, numbers)[:, 0] for side in sides], axis=0)
    read_off = []
    for k, j, gap in zip(nodes, numbers, gaps.tolist(), strict=True):
        obstacle, normal = bodies[j].obstacle, normals[k, j]
        slip = (slipped[k] - normal * float(normal @ slipped[k])) * (bodies[j].friction > 0)
        force = size[k, j] * normal + tangential[k, j]
        point = places[k] - distance[k, j] * normal
        where = (obstacle, float(s[k]), force, gap, point, normal, float(p[k, j]))
        read_off.append(Touch(*where, tangential[k, j], slip))
    return tuple(read_off)
