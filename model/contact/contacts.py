"""What a settled arm leans on, as it is read off: forces and where they act."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from model.contact.gaps import Gaps
from model.contact.history import History
from model.contact.touches import Touches, frictions, resultants, second
from model.loads import contacts
from model.obstacles.base import Convex
from model.paths import Array
from model.transcription.system import System


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
    pressure: float = 0.0
    friction: Array = field(default_factory=lambda: np.zeros(3))
    slip: Array = field(default_factory=lambda: np.zeros(3))


def touches_of(system: System, states: Array, history: History | None = None) -> tuple[Touch, ...]:
    """Return what an arm leans on in an equilibrium, from base to tip."""
    touches, gaps = Touches.of(system), Gaps.of(system, states)
    s, own = system.mesh.s, touches.held | touches.inside
    p = second(system, states) * (touches.end | touches.inside)
    size = resultants(system, states, touches)
    bodies, places = contacts(system.scene), system.poses(states)[:, 4:]
    tangential = frictions(system, states, touches)
    moved = 0 * places if history is None else places - history.places(s)
    found = []
    for k, j in zip(*np.nonzero(own), strict=True):
        normal, gap = gaps.normal[k - 1, j], float(gaps.gap[k - 1, j])
        obstacle = bodies[j].obstacle
        point = places[k] - float(obstacle.distance(places[k])) * normal
        slip = (moved[k] - normal * float(normal @ moved[k])) * (bodies[j].friction > 0)
        own_force = size[k, j] * normal + tangential[k, j]
        where = (obstacle, float(s[k]), own_force, gap, point, float(p[k, j]))
        found.append(Touch(*where, tangential[k, j], slip))
    return tuple(found)
