"""Lower bounds of how near pieces of a moving arm come to bodies, and to each other.

A body's distance from a piece is bounded by that from its middle and how it changes from there to
the convex hull of its points (model.obstacles.bodies); two pieces are apart by what parts their
hulls along the direction between them. As for arms at rest (model.clearance.nearest), a piece can
come behind the base plane only where the arm has turned by a right angle, and two pieces meet only
where it has turned by half a turn between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.centreline import Counts
from model.clearance.parts import Parts, Pieces
from model.clearance.smooth import INSTANTS, SHARES
from model.obstacles.bodies import Bodies
from model.paths import Array

_MIDDLE = INSTANTS // 2


@dataclass(frozen=True, eq=False)
class Surrounding:
    """Bodies that move steadily during each part.

    Attributes
    ----------
    bodies : Bodies
    moved : (P, 2, B, 3)
        How far each has moved where a part begins and where it ends [m].
    turns : (B,)
        How far the arm has to have turned to come there [rad]: a right angle for the base plane.
    """

    bodies: Bodies
    moved: Array
    turns: Array

    @property
    def travel(self) -> Array:
        """How far bodies move during each part at the most (P,) [m]."""
        way = np.linalg.norm(self.moved[:, 1] - self.moved[:, 0], axis=2)
        return np.asarray(way.max(axis=1, initial=0.0))

    def lower(self, pieces: Pieces) -> Array:
        """Return lower bounds of the distances (K,) [m] of pieces from all bodies."""
        moved = self._moved(pieces, SHARES)
        rest = moved[:, _MIDDLE]
        d, g = self.bodies.at(pieces.middle[:, None] - rest)
        change = np.full(d.shape, np.inf)
        for i, point in enumerate(np.swapaxes(pieces.hull, 0, 1)):
            offset = (point - pieces.middle)[:, None] - (moved[:, i // 2] - rest)
            change = np.minimum(change, self.bodies.change(g, offset))
        lower = d + change - pieces.wide[:, None]
        most, least = pieces.turned.max(axis=(1, 2)), pieces.turned[:, :, 1].min(axis=1)
        reach = ((2 * most - least)[:, None] >= self.turns) | ~pieces.known[:, None]
        return np.asarray(np.where(reach, lower, np.inf).min(axis=1, initial=np.inf))

    def seen(self, pieces: Pieces) -> Array:
        """Return the distances (K, 5) [m] that the ends of pieces have at the instants."""
        moved = self._moved(pieces, SHARES)
        found, _ = self.bodies.at(pieces.ends[:, :, :, None] - moved[:, :, None])
        found = np.where(pieces.turned[..., None] >= self.turns, found, np.inf)
        return np.asarray((found - pieces.radii[:, :, ::2, None]).min(axis=(2, 3), initial=np.inf))

    def _moved(self, pieces: Pieces, shares: Array) -> Array:
        """Return how far bodies have moved (K, n, B, 3) at shares (n,) of the pieces' parts."""
        first, last = self.moved[pieces.part, 0], self.moved[pieces.part, 1]
        return np.asarray(first[:, None] + shares[:, None, None] * (last - first)[:, None])


def apart(one: Pieces, other: Pieces) -> Array:
    """Return lower bounds of the distances (K,) [m] of pairs of pieces, infinite if none meet."""
    way = one.middle - other.middle
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-300)
    near = np.einsum("ki,kti->kt", way, one.hull).min(axis=1)
    far = np.einsum("ki,kti->kt", way, other.hull).max(axis=1)
    turn = other.turned[:, :, 1] - one.turned[:, :, 0]
    reach = (2 * turn.max(axis=1) - turn.min(axis=1) >= np.pi) | ~one.known
    return np.where(reach, near - far - one.wide - other.wide, np.inf)


def seen_apart(one: Pieces, other: Pieces) -> Array:
    """Return the distances (K, 5) [m] that the ends of pairs of pieces have at the instants."""
    d = np.linalg.norm(one.ends[:, :, :, None] - other.ends[:, :, None], axis=4)
    d -= one.radii[:, :, ::2, None] + other.radii[:, :, None, ::2]
    turn = other.turned[:, :, None] - one.turned[:, :, :, None]
    return np.asarray(np.where(turn >= np.pi, d, np.inf).min(axis=(2, 3)))


def pairs(parts: Parts) -> tuple[Counts, Counts]:
    """Return the parts (K,) and pairs of elements (K, 2) that may meet."""
    first, last = parts.turned[:, :, :-1], parts.turned[:, :, 1:]
    turn = last[:, :, None, :] - first[:, :, :, None]
    reach = 2 * turn.max(axis=1) - turn.min(axis=1) >= np.pi
    reach |= ~parts.known[:, None, None]
    part, one, other = np.nonzero(np.triu(reach, 1))
    return part, np.column_stack([one, other])
