"""Inequalities that keep an arm clear: of places along it from convex bodies or other places.

A place is between two stations, where it is read off the cubic through their positions and
tangents. What the cubic is off by, of the arm as it last was, is added as a number; so is the
length of the arm between the stations. Places, bodies and distances are numbers as well, so that
constraints that follow the nearest place of an arm do not change the program's structure.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.machine.functions import built
from model.mesh import graded
from model.obstacles.base import SIZE, signed_distance
from model.paths import Array
from model.rotations import matrix
from model.transcription.equations import Equations, Term
from model.transcription.kernels import Kernel
from model.transcription.layout import POSE
from planner.targets.base import Target

# Slots of an element come so many at a time, and every element has some: that makes one program of
# nearly all that is to be kept clear of. Those that are empty keep clear of a ball far off.
_SLOTS = 2
_FAR = 10.0


@dataclass(frozen=True)
class Place:
    """A point of the midline.

    Attributes
    ----------
    s : float
        Arc length [m].
    length : float
        Of the arm between the stations on both sides, deformed [m].
    shift : (3,)
        What the cubic through these lacks [m].
    """

    s: float
    length: float
    shift: tuple[float, ...]


@dataclass(frozen=True)
class Apart:
    """A place that keeps a distance from a convex body, or from another place.

    Attributes
    ----------
    place : Place
    other : Place or tuple of 17 floats
        Another place, or the numbers of a body; see model.obstacles.
    keep : float
        The least distance of the midline there [m].
    is_part : bool
        Whether the body stands for a mesh near the place, behind a plane or in a box around it: it
        may keep off more than what is asked once the arm is elsewhere.
    """

    place: Place
    other: Place | tuple[float, ...]
    keep: float
    is_part: bool = False


@dataclass(frozen=True)
class Avoidance(Target):
    """The inequalities of a plan, stated as a target of inequalities that never yield."""

    rows: tuple[Apart, ...]

    def beside(self, targets: tuple[Target, ...]) -> tuple[Target, ...]:
        """Return targets and these inequalities, if there are any."""
        return (*targets, self) if self.rows else targets

    def slots(self, arm: Arm) -> list[int]:
        """Return the element of each slot for a body; none where no bodies are near."""
        count = Counter(element_of(arm, place.s) for place, *_ in self.bodies)
        elements = range(grid(arm).size - 1) if count else ()
        return [k for k in elements for _ in range(-(-max(count[k], 1) // _SLOTS) * _SLOTS)]

    @property
    def bodies(self) -> list[tuple[Place, tuple[float, ...], float]]:
        """A place, the numbers of a body and the distance to keep, of each row of these."""
        return [(r.place, r.other, r.keep) for r in self.rows if not isinstance(r.other, Place)]

    @property
    def pairs(self) -> list[tuple[Place, Place, float]]:
        """Two places and the distance to keep, of each row of two places."""
        return [(r.place, r.other, r.keep) for r in self.rows if isinstance(r.other, Place)]

    def structure(self, arm: Arm) -> tuple[Hashable, ...]:
        """See Target.structure."""
        return type(self).__name__, tuple(self.slots(arm)), tuple(self._elements(arm))

    def stations(self, arm: Arm) -> tuple[float, ...]:
        """See Target.stations: the nodes of the coarsest mesh."""
        return tuple(grid(arm)[1:].tolist())

    def parameters(self, arm: Arm) -> Array:
        """See Target.parameters: the places of each slot with their bodies, then of each pair."""
        base, slots, off = np.array(arm.base_position), self.slots(arm), _FAR * arm.length
        nothing = [*np.zeros(7), *base, *np.eye(3).ravel(), *np.zeros(3), off, 0.0, -3 * off]
        numbers = np.tile(nothing, (len(slots), 1))
        for near, body, keep in self.bodies:
            i = slots.index(element_of(arm, near.s))
            slots[i] = -1
            numbers[i] = [*_weights(arm, near), *body, keep]
        pairs = [[*_weights(arm, a), *_weights(arm, b), keep] for a, b, keep in self.pairs]
        return np.concatenate([numbers.ravel(), np.ravel(pairs)])

    def gaps(self, arm: Arm, stations: Sequence[float], machine_code: bool = False) -> Equations:
        """Return how much farther off than they have to be the places are [m], by the poses.

        Unknowns are the poses of the base and at the stations, (7,) each; numbers are those of
        `parameters`. Made of a few kernels, whatever there is to keep clear of: see Equations.
        """
        at = {0.0: 0} | {s: 1 + k for k, s in enumerate(stations)}
        poses = POSE * np.array([at[s] for s in grid(arm).tolist()])[:, None] + np.arange(POSE)
        both = np.hstack([poses[:-1], poses[1:]])
        slots = np.array(self.slots(arm), dtype=np.int64)
        pairs = np.array(self._elements(arm), dtype=np.int64).reshape(-1, 2)
        rows = np.arange(slots.size + len(pairs))[None, :]
        terms = [
            Term(built(_from_body), both[slots].T, rows[:, : slots.size]),
            Term(built(_from_place), np.hstack(list(both[pairs.T])).T, rows[:, slots.size :]),
        ]
        return Equations(POSE * (1 + len(stations)), rows.size, terms, machine_code)

    def _elements(self, arm: Arm) -> list[tuple[int, int]]:
        """Return the elements of each pair of places."""
        return [(element_of(arm, a.s), element_of(arm, b.s)) for a, b, _ in self.pairs]


@lru_cache(maxsize=64)
def grid(arm: Arm) -> Array:
    """Return the arc lengths (N + 1,) of base and stations."""
    return graded(arm, 1).s


def element_of(arm: Arm, s: float) -> int:
    """Return between which two stations an arc length is."""
    nodes = grid(arm)
    return int(np.clip(np.searchsorted(nodes, s, side="left") - 1, 0, nodes.size - 2))


def cubic(arm: Arm, s: float, length: float) -> Array:
    """Return the weights (4,) of position and tangent at both stations around s."""
    nodes, k = grid(arm), element_of(arm, s)
    x = (s - nodes[k]) / (nodes[k + 1] - nodes[k])
    rise = x * x * (3 - 2 * x)
    return np.array([1 - rise, length * x * (1 - x) ** 2, rise, -length * x * x * (1 - x)])


def _weights(arm: Arm, place: Place) -> Array:
    """Return the numbers (7,) of a place: weights of the cubic, then its shift."""
    return np.concatenate([cubic(arm, place.s, place.length), place.shift])


def _from_body() -> Kernel:
    """Return the kernel of a place near a body: poses of both stations (14,); its numbers."""
    y, c = ca.SX.sym("y", 2 * POSE), ca.SX.sym("c", 7 + SIZE + 1)
    return Kernel("from_body", y, c, signed_distance()(_point(y, c[:7]), c[7:-1])[0] - c[-1])


def _from_place() -> Kernel:
    """Return the kernel of a place near another: poses of their stations (28,); their numbers."""
    y, c = ca.SX.sym("y", 4 * POSE), ca.SX.sym("c", 15)
    apart = _point(y[: 2 * POSE], c[:7]) - _point(y[2 * POSE :], c[7:14])
    return Kernel("from_place", y, c, ca.sqrt(ca.sumsqr(apart)) - c[-1])


def _point(poses: ca.SX, numbers: ca.SX) -> ca.SX:
    """Return where a place with such numbers (7,) is (3,), between the poses of two stations."""
    w, ends = ca.vertsplit(numbers[:4]), ca.vertsplit(poses, POSE)
    near, far = ((pose[4:], matrix(pose[:4])[:, 0]) for pose in ends)
    return w[0] * near[0] + w[1] * near[1] + w[2] * far[0] + w[3] * far[1] + numbers[4:]
