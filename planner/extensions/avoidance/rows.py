"""Clearance rows: distances of places along the arm from convex bodies, or from other places.

A place lies between two stations, on the cubic through their positions and tangents. The error of
the cubic for the last shape of the arm is added as a parameter, and so is the length of the arm
between the stations. Places, bodies and distances are parameters as well, so that rows that follow
the nearest place of an arm do not change the structure of the program. Places are local minima of
the gap along the arm.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import casadi as ca
import numpy as np
from scipy.ndimage import minimum_filter

from octoplan.model.arm import Arm
from octoplan.model.centreline import Centreline
from octoplan.model.extensions.clearance.nearest import base_plane
from octoplan.model.extensions.obstacles.base import SIZE, Convex, distances_from, signed_distance
from octoplan.model.mesh import base_pose, graded
from octoplan.model.paths import Array
from octoplan.model.rod.equations import Equations, PlacedKernel
from octoplan.model.rod.kernels import Kernel
from octoplan.model.rotations import POSE, matrices, matrix
from octoplan.model.support.machine.functions import cached
from octoplan.planner.block import ACTIVE, Block, Parts, ProgramView, Rows
from octoplan.planner.extensions.avoidance.surroundings import spare
from octoplan.planner.planning_problem import Environment

# Kind of the rows of a program.
CLEAR = "clear"
# Number of bodies near an element by which the rows of the element grow. Every element has as many
# rows at least, so that most sets of bodies have the same program.
_SLOTS = 2
# Distance over L of the ball that a row without a body keeps clear of.
_FAR = 10.0
# Number of points at which gaps are evaluated. The parabola through three has an error of a few
# thousandths of a millimetre if an arm of half a metre passes a body of 5 mm. Rows of one body at
# less than the spacing of the points count as one row.
_POINTS = 257
# Gap beyond the clearance, over L, up to which a place gets a row.
_NEAR = 0.02
# The same for arms that touch nothing, so that such arms stay on their side of the bodies.
_WATCHED = 0.15
# A place [m], another place or the numbers of a body, and whether the body is part of a mesh.
Pair = tuple[float, float | tuple[float, ...], bool]


@dataclass(frozen=True)
class Place:
    """A point of the midline.

    Attributes
    ----------
    s : float
        Arc length [m].
    length : float
        Length of the deformed arm between the stations on both sides [m].
    shift : (3,)
        Position minus the cubic through these stations [m].
    """

    s: float
    length: float
    shift: tuple[float, ...]


@dataclass(frozen=True)
class ClearanceRow:
    """A place that keeps a distance from a convex body, or from another place.

    Attributes
    ----------
    place : Place
    other : Place or tuple of 17 floats
        Another place, or the numbers of a body; see octoplan.model.extensions.obstacles.
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
class ClearanceBlock(Block):
    """The clearance rows of a program.

    Attributes
    ----------
    base : (7,) or None
        Pose of the base; None for a base that moves, whose pose is that of a station.
    length : float
        Length of the arm [m].
    nodes : tuple of float
        Arc lengths of base and stations between which places are interpolated [m].
    slots : tuple of int
        The element of each row for a body.
    pairs : tuple of (int, int)
        The elements of each pair of places.
    numbers : (n,)
        Place, body and least distance of each slot, then both places and least distance of each
        pair.
    """

    base: tuple[float, ...] | None
    length: float
    nodes: tuple[float, ...]
    slots: tuple[int, ...]
    pairs: tuple[tuple[int, int], ...]
    numbers: Array = field(compare=False)

    @property
    def n_parameters(self) -> int:
        """See Block."""
        return self.numbers.size

    def parameters(self) -> Array:
        """Return places, bodies and least distances."""
        return self.numbers

    def stations(self) -> tuple[float, ...]:
        """Return the stations between which places are interpolated [m]."""
        return self.nodes if self.base is None else self.nodes[1:]

    def parts(self, view: ProgramView) -> Parts:
        """Return (distance - least distance) / L >= 0."""
        base = [] if self.base is None else [ca.DM(self.base)]
        poses = ca.vertcat(*base, *(view.poses[s] for s in self.stations()))
        gaps = self._gaps().value.function(poses, view.parameters)
        return Parts([Rows(CLEAR, gaps / self.length)])

    def active_limits(
        self, arm: Arm, multipliers: Callable[[str], Array]
    ) -> list[tuple[float, str]]:
        """Return the clearance, if some multiplier is not zero."""
        is_active = multipliers(CLEAR).min(initial=0.0) < -ACTIVE
        return [(0.0, "what the arm is to keep clear of")] if is_active else []

    def _gaps(self) -> Equations:
        """Return the distances minus the least distances [m], from poses of base and stations."""
        poses = POSE * np.arange(len(self.nodes))[:, None] + np.arange(POSE)
        both = np.hstack([poses[:-1], poses[1:]])
        slots = np.array(self.slots, dtype=np.int64)
        pairs = np.array(self.pairs, dtype=np.int64).reshape(-1, 2)
        rows = np.arange(slots.size + len(pairs))[None, :]
        terms = [
            PlacedKernel(cached(_from_body), both[slots].T, rows[:, : slots.size]),
            PlacedKernel(
                cached(_from_place), np.hstack(list(both[pairs.T])).T, rows[:, slots.size :]
            ),
        ]
        # CasADi cannot differentiate compiled kernels.
        return Equations(POSE * len(self.nodes), rows.size, terms, machine_code=False)


@dataclass(frozen=True)
class ClearanceConstraints:
    """Clearance rows that a plan keeps; they never have slacks.

    Attributes
    ----------
    rows : tuple of ClearanceRow
    base_moves : bool
        Whether the base is moved by joints.
    """

    rows: tuple[ClearanceRow, ...]
    base_moves: bool = False

    def blocks(self, arm: Arm) -> tuple[ClearanceBlock, ...]:
        """Return the block of the rows, or none without rows."""
        if not self.rows:
            return ()
        pairs = [(element_of(arm, a.s), element_of(arm, b.s)) for a, b, _ in self.pairs]
        return (
            ClearanceBlock(
                None if self.base_moves else tuple(base_pose(arm).tolist()),
                arm.length,
                tuple(grid(arm).tolist()),
                tuple(self._slots(arm)),
                tuple(pairs),
                self._numbers(arm),
            ),
        )

    def _slots(self, arm: Arm) -> list[int]:
        """Return the element of each slot for a body; none if no bodies are near."""
        count = Counter(element_of(arm, place.s) for place, *_ in self.bodies)
        elements = range(grid(arm).size - 1) if count else ()
        return [k for k in elements for _ in range(-(-max(count[k], 1) // _SLOTS) * _SLOTS)]

    @property
    def bodies(self) -> list[tuple[Place, tuple[float, ...], float]]:
        """A place, the numbers of a body and the least distance, of each row with a body."""
        return [(r.place, r.other, r.keep) for r in self.rows if not isinstance(r.other, Place)]

    @property
    def pairs(self) -> list[tuple[Place, Place, float]]:
        """Two places and the least distance, of each row with two places."""
        return [(r.place, r.other, r.keep) for r in self.rows if isinstance(r.other, Place)]

    def _numbers(self, arm: Arm) -> Array:
        """Return the parameters of each slot, then of each pair."""
        base, slots, far = np.array(arm.base_position), self._slots(arm), _FAR * arm.length
        nothing = [*np.zeros(7), *base, *np.eye(3).ravel(), *np.zeros(3), far, 0.0, -3 * far]
        numbers = np.tile(nothing, (len(slots), 1))
        for near, body, keep in self.bodies:
            i = slots.index(element_of(arm, near.s))
            slots[i] = -1
            numbers[i] = [*_weights(arm, near), *body, keep]
        pairs = [[*_weights(arm, a), *_weights(arm, b), keep] for a, b, keep in self.pairs]
        return np.concatenate([numbers.ravel(), np.ravel(pairs)])


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
    return Kernel(
        "from_body", y, {"place": c}, signed_distance()(_point(y, c[:7]), c[7:-1])[0] - c[-1]
    )


def _from_place() -> Kernel:
    """Return the kernel of a place near another: poses of their stations (28,); their numbers."""
    y, c = ca.SX.sym("y", 4 * POSE), ca.SX.sym("c", 15)
    apart = _point(y[: 2 * POSE], c[:7]) - _point(y[2 * POSE :], c[7:14])
    return Kernel("from_place", y, {"places": c}, ca.sqrt(ca.sumsqr(apart)) - c[-1])


def _point(poses: ca.SX, numbers: ca.SX) -> ca.SX:
    """Return where a place with such numbers (7,) is (3,), between the poses of two stations."""
    w, ends = ca.vertsplit(numbers[:4]), ca.vertsplit(poses, POSE)
    near, far = ((pose[4:], matrix(pose[:4])[:, 0]) for pose in ends)
    return w[0] * near[0] + w[1] * near[1] + w[2] * far[0] + w[3] * far[1] + numbers[4:]


def avoiding(
    line: Centreline,
    surroundings: Environment,
    before: ClearanceConstraints | None,
    base_moves: bool = False,
) -> tuple[ClearanceConstraints, float]:
    """Return the clearance rows of an arm with those from before, and the smallest gap [m].

    The base itself has rows if it moves. Places that are near to a body get a row. The first rows
    of an arm that touches nothing include places farther away.
    """
    minima = list(_minima(line, surroundings, base_moves))
    least = min((gap for gap, _ in minima), default=np.inf)
    near = _NEAR if before or least < surroundings.clearance else _WATCHED
    most = surroundings.clearance + near * line.arm.length
    pairs = [pair for gap, pair in minima if gap < most]
    for row in before.rows if before else ():
        other = row.other.s if isinstance(row.other, Place) else row.other
        pair = row.place.s, other, row.is_part
        if not row.is_part and not any(_is_same(line, pair, another) for another in pairs):
            pairs.append(pair)
    rows = tuple(_row(line, surroundings, *pair) for pair in pairs)
    return ClearanceConstraints(rows, base_moves), least


def _minima(
    line: Centreline, surroundings: Environment, base_moves: bool
) -> Iterator[tuple[float, Pair]]:
    """Yield gaps [m] where an arm is nearest to something not far off, and what is there."""
    s, bodies = np.linspace(0.0, line.arm.length, _POINTS), list(surroundings.obstacles)
    (points, radius), turned = line.at(s), line.turned(s)
    bodies += [base_plane(line.arm)] * surroundings.of_itself
    gaps = distances_from(bodies, points[:, None])[0] - radius[:, None]
    if not base_moves:
        gaps[0] = np.inf
    gaps[turned < np.pi / 2, len(surroundings.obstacles) :] = np.inf
    most = surroundings.clearance + _WATCHED * line.arm.length
    for i, k in np.argwhere((gaps <= minimum_filter(gaps, (3, 1))) & (gaps < most)):
        at, gap = _parabola_minimum(s, gaps[:, k], i)
        numbers = bodies[k].nearest_part(line.at(np.array([at]))[0][0])
        yield gap, (at, tuple(numbers.tolist()), not isinstance(bodies[k], Convex))
    if surroundings.of_itself:
        gaps = np.linalg.norm(points[:, None] - points, axis=2) - radius[:, None] - radius
        gaps[turned - turned[:, None] < np.pi] = np.inf
        # Side by side even points of two parts of the arm are near to each other by turns.
        window = 1 + 2 * round(_NEAR * _POINTS)
        for i, k in np.argwhere((gaps <= minimum_filter(gaps, window)) & (gaps < most)):
            (one, gap), (other, _) = (
                _parabola_minimum(s, gaps[:, k], i),
                _parabola_minimum(s, gaps[i], k),
            )
            yield gap, (one, other, False)


def _parabola_minimum(s: Array, gaps: Array, i: int) -> tuple[float, float]:
    """Return where the parabola through three samples (K,) is least, about the i-th, and it."""
    if 0 < i < s.size - 1:
        before, at, after = gaps[i - 1 : i + 2]
        bend, slope = before - 2 * at + after, (after - before) / 2
        if 0 < bend < np.inf:
            return float(s[i] - s[1] * slope / bend), float(at - slope**2 / (2 * bend))
    return float(s[i]), float(gaps[i])


def _is_same(line: Centreline, one: Pair, two: Pair) -> bool:
    """Return whether two pairs are the same at about the same place."""
    near, (s, other, _), (at, another, _) = line.arm.length / _POINTS, one, two
    if isinstance(other, float) and isinstance(another, float):
        return max(abs(other - another), abs(s - at)) <= near
    return other == another and abs(s - at) <= near


def _row(
    line: Centreline,
    surroundings: Environment,
    s: float,
    other: float | tuple[float, ...],
    is_part: bool,
) -> ClearanceRow:
    """Return the inequality of a place and a body, or of two places."""
    place, radius = _place(line, s)
    keep = radius + surroundings.clearance + spare(surroundings, line.arm)
    if isinstance(other, tuple):
        return ClearanceRow(place, other, keep, is_part)
    second, other_radius = _place(line, other)
    return ClearanceRow(place, second, keep + other_radius)


def _place(line: Centreline, s: float) -> tuple[Place, float]:
    """Return a place of an arm, and its radius there [m]."""
    nodes, k = grid(line.arm), element_of(line.arm, s)
    ends = nodes[k : k + 2]
    poses = line.poses[np.abs(line.s - ends[:, None]).argmin(axis=1)]
    known = np.stack([poses[:, 4:], matrices(poses[:, :4])[:, :, 0]], axis=1).reshape(-1, 3)
    length, (point, radius) = line.length(*ends), line.at(np.array([s]))
    shift = point[0] - cubic(line.arm, s, length) @ known
    return Place(s, length, tuple(shift.tolist())), float(radius[0])
