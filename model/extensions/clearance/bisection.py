"""Bounds of the clearance of an arm during a motion, by bisection.

A motion consists of stretches on which tensions are linear in time; an arm at rest is a stretch
without duration. Each stretch is divided into parts that are short enough to bound the deviation of
strains from linear interpolation, and the arm is divided into pieces. Lower bounds of the distance
use the convex hull of each piece. For convex bodies, tangent planes bound the distance from below.
For other bodies, the distance is Lipschitz continuous with constant 1. For two pieces, a separating
direction bounds the distance of their hulls. Parts or pieces with weak
bounds are halved, whichever is longer.

Only pieces whose tangent has turned by a right angle from the base can be behind the base plane.
Two pieces can only meet if the arm turns by half a turn in between. Otherwise the distance of the
midlines is at least 2 / pi times the arc length in between (Schur's comparison theorem): the pieces
are apart, or are neighbours along the arm, closer than the thickness of the arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol

import numpy as np

from octoplan.model.centreline import Centreline, Counts
from octoplan.model.extensions.clearance.pieces import DeviationBound, Parts, Pieces
from octoplan.model.extensions.obstacles.base import Obstacle, distances_from
from octoplan.model.paths import Array, Mask
from octoplan.model.support.progress import check_time

# Tolerance of bounds, over the arm's length.
_CLOSE = 2e-5
# Tolerance of bounds, over the distance.
_RELATIVE = 1e-2
# Largest number of halvings of a part or piece.
_LEVELS = 30
# Largest number of rows in one step.
_MOST = 40_000


class Motion(Protocol):
    """A motion of an arm whose tensions are linear in time on each stretch."""

    def lines(self, stretch: Counts, share: Array) -> list[Centreline | None]:
        """Return the midlines at shares (K,) of stretches (K,), with None for failed ones."""

    def deviation_bound(self, stretch: Counts, start: Array, end: Array) -> DeviationBound:
        """Bound the deviation of strains from linear interpolation between shares (P,)."""


@dataclass(frozen=True, eq=False)
class ClearanceQuery:
    """Bodies, or the arm itself, from which the clearance is bounded.

    Attributes
    ----------
    bodies : sequence of Obstacle
        None for the clearance of the arm from itself.
    keep : float
        Required distance [m].
    turns : (B,)
        Smallest rotation of the tangent from the base at which a body can be close [rad]: a right
        angle for the base plane.
    moved : (S, 2, B, 3)
        Displacement of each body at the start and the end of each stretch [m], linear in between;
        or (1, 2, B, 3) for all stretches.
    uneven : (S,)
        Largest difference between the shares of tensions and of time on each stretch;
        or (1,) for all stretches.
    """

    bodies: Sequence[Obstacle] | None
    keep: float
    turns: Array
    moved: Array
    uneven: Array = field(default_factory=lambda: np.zeros(1))


@dataclass(frozen=True, eq=False)
class ClearanceBound:
    """Bounds of the clearance of an arm on each of S stretches.

    Attributes
    ----------
    bound : (S,)
        Lower bound of the distance minus the required distance [m], refined to `enough` or close
        to the smallest evaluated clearance; -inf without equilibrium.
    seen : (S,)
        Smallest evaluated clearance [m]; inf if no piece is close enough to be evaluated.
    share : (S,)
        Share of the stretch at which the smallest clearance was evaluated.
    body : (S,)
        Index of the nearest body.
    s : (S, 2)
        Arc length of the nearest point, or of both nearest points of the arm [m].
    step : (S,)
        Bound of the displacement of points of the arm during the first half of a part [m].
    """

    bound: Array
    seen: Array
    share: Array
    body: Counts
    s: Array
    step: Array


class _Rows(NamedTuple):
    """Pieces, or pairs of pieces, during parts of stretches.

    Attributes
    ----------
    stretch : (K,)
        Index of the stretch.
    start, end : (K,)
        Shares of the stretch that delimit the part.
    element : (K, 1 or 2)
        Index of the element of each piece.
    low, high : (K, 1 or 2)
        Shares of the element that delimit each piece.
    """

    stretch: Counts
    start: Array
    end: Array
    element: Counts
    low: Array
    high: Array

    def some(self, which: Mask | Counts) -> _Rows:
        """Return a selection of the rows."""
        return _Rows._make(each[which] for each in self)


def closest(
    motion: Centreline | Motion, count: int, query: ClearanceQuery, enough: float = 0.0
) -> ClearanceBound:
    """Bound the clearance of an arm on `count` stretches; a Centreline is one stretch at rest.

    Refine bounds up to `enough` [m], or close to the exact value.
    """
    infinite = np.full(count, np.inf)
    none = np.zeros(count)
    result = ClearanceBound(
        bound=infinite.copy(),
        seen=infinite,
        share=none.copy(),
        body=none.astype(int),
        s=np.zeros((count, 2)),
        step=none.copy(),
    )
    search = _Search(motion, query, enough, result)
    pieces = np.zeros((count, 1 + (query.bodies is None)))
    rows = _Rows(np.arange(count), none, none + 1, pieces.astype(int), pieces, pieces + 1)
    for level in range(_LEVELS + 1):
        check_time()
        rows, part, parts = search.parts(rows)
        if parts is None:
            break
        rows = (
            search.step(rows, part, parts, level == _LEVELS) if level else search.whole(rows, parts)
        )
    return replace(result, bound=np.minimum(result.bound, result.seen))


@dataclass(frozen=True, eq=False)
class _Search:
    """Bisection of parts and pieces. `result` contains the present bounds."""

    motion: Centreline | Motion
    query: ClearanceQuery
    enough: float
    result: ClearanceBound

    def parts(self, rows: _Rows) -> tuple[_Rows, Counts, Parts | None]:
        """Return rows, the index of the part of each row, and the parts, with each arm once.

        Rows of stretches without equilibrium are removed. The parts are None if no rows are left.
        """
        rows = rows.some(~np.isneginf(self.result.bound[rows.stretch]))
        if not rows.stretch.size:
            return rows, rows.stretch, None
        if isinstance(self.motion, Centreline):
            return rows, 0 * rows.stretch, Parts.of(self.motion, np.zeros((1, 1), dtype=int), None)
        time, part = np.unique(np.column_stack(rows[:3]), axis=0, return_inverse=True)
        stretch = time[:, 0].astype(int)
        start = time[:, 1]
        end = time[:, 2]
        keys = np.column_stack([stretch.repeat(2), time[:, 1:].ravel()])
        arms, at = np.unique(keys, axis=0, return_inverse=True)
        which = arms[:, 0].astype(int)
        lines = self.motion.lines(which, arms[:, 1])
        settled = [line for line in lines if line is not None]
        if len(settled) < len(lines):
            failed = np.array([line is None for line in lines])
            self.result.bound[which[failed]] = -np.inf
            self.result.share[which[failed]] = arms[failed, 1]
            return self.parts(rows)
        bound = self.motion.deviation_bound(stretch, start, end)
        return rows, part.ravel(), Parts.of(Centreline.joined(settled), at.reshape(-1, 2), bound)

    def whole(self, rows: _Rows, parts: Parts) -> _Rows:
        """Return the elements of arms in each part, or the pairs of elements that may meet."""
        N = parts.turned.shape[2] - 1
        if self.query.bodies is not None:
            part, element = np.divmod(np.arange(len(parts.rows) * N), N)
            return rows.some(part)._replace(element=element[:, None])
        turn = parts.turned[:, :, None, 1:] - parts.turned[:, :, :-1, None]
        reach = turn.max(axis=1) + parts.turns_off[:, None] >= np.pi
        part, *pair = np.nonzero(np.triu(reach | ~parts.known[:, None, None], 1))
        return rows.some(part)._replace(element=np.column_stack(pair))

    def step(self, rows: _Rows, part: Counts, parts: Parts, is_last: bool) -> _Rows:
        """Bound the clearance of rows; return the next rows, with parts or pieces halved."""
        columns = zip(rows.element.T, rows.low.T, rows.high.T, strict=True)
        pieces = [parts.pieces(part, *column) for column in columns]
        result = self.result
        stretch = rows.stretch
        keep = self.query.keep
        # Displacements of bodies at the start and end of the parts (K, I, B, 3).
        shares = np.column_stack([rows.start, rows.end])[:, : parts.rows.shape[1], None, None]
        first, last = np.swapaxes(self.query.moved[stretch % len(self.query.moved)], 0, 1)
        moved = first[:, None] + shares * (last - first)[:, None]
        known = parts.known[part]
        lower = self._lower_bounds(stretch, moved, pieces) - keep
        near = (lower < np.minimum(self.enough, result.seen[stretch])) | ~known
        if near.any():
            self._record_ends(rows.some(near), moved[near], [each.some(near) for each in pieces])
        seen = result.seen[stretch]
        least = np.where(seen < np.inf, seen, 0.0)
        slack = np.maximum(_CLOSE * parts.lines.arm.length, _RELATIVE * np.abs(least + keep))
        enough = np.minimum(self.enough, np.where(seen < np.inf, least - slack, np.inf))
        # Infinite bounds belong to pieces that cannot meet: no refinement is needed.
        open_ = ((lower < enough) & (lower < np.inf)) | ~known
        done = ~open_ | is_last | (stretch.size > _MOST)
        np.minimum.at(result.bound, stretch[done], np.where(known, lower, -np.inf)[done])
        sizes = np.column_stack([each.size for each in pieces])
        travel = np.max([each.travel for each in pieces], axis=0)
        np.maximum.at(result.step, stretch[done], travel[done] / 2)
        passing = np.linalg.norm(moved[:, -1] - moved[:, 0], axis=2).max(axis=1, initial=0.0)
        by_time = (travel + passing > sizes.max(axis=1)) | ~known
        late = rows.some(~done & by_time)
        cut = rows.some(~done & ~by_time)
        longest = np.eye(sizes.shape[1], dtype=bool)[sizes[~done & ~by_time].argmax(axis=1)]
        half = (cut.low + cut.high) / 2
        middle = (late.start + late.end) / 2
        halves = (
            cut._replace(high=np.where(longest, half, cut.high)),
            cut._replace(low=np.where(longest, half, cut.low)),
            late._replace(end=middle),
            late._replace(start=middle),
        )
        return _Rows._make(map(np.concatenate, zip(*halves, strict=True)))

    def _lower_bounds(self, stretch: Counts, moved: Array, pieces: list[Pieces]) -> Array:
        """Return lower bounds of the distances (K,) [m] of pieces from bodies, or of pairs."""
        bodies = self.query.bodies
        one = pieces[0]
        if bodies is None:
            return apart(*pieces)
        rest = moved.mean(axis=1)
        middle = one.hull.mean(axis=1)[:, None]
        d, g = distances_from(bodies, middle - rest)
        convex = np.array([body.is_convex for body in bodies], dtype=bool)
        change = np.full(d.shape, np.inf)
        for i, point in enumerate(np.swapaxes(one.hull, 0, 1)):
            offset = point[:, None] - middle - (moved[:, i // 2] - rest)
            # For other bodies, the distance is Lipschitz continuous with constant 1.
            along = np.einsum("kbi,kbi->kb", g, offset)
            off = np.where(convex, along, -np.linalg.norm(offset, axis=2))
            change = np.minimum(change, off)
        path = np.linalg.norm(moved[:, -1] - moved[:, 0], axis=2)
        uneven = self.query.uneven[stretch % len(self.query.uneven), None] * path
        turned = one.turned[:, :, 1].max(axis=1) + one.turns_off
        reach = turned[:, None] >= self.query.turns
        lower = np.where(reach, d + change - one.wide[:, None] - uneven, np.inf)
        return np.asarray(lower.min(axis=1, initial=np.inf))

    def _record_ends(self, rows: _Rows, moved: Array, pieces: list[Pieces]) -> None:
        """Evaluate the clearance at the ends of pieces and parts, and update the smallest ones."""
        result = self.result
        bodies = self.query.bodies
        one = pieces[0]
        other = pieces[-1]
        if bodies is not None:
            d = distances_from(bodies, one.ends[:, :, :, None] - moved[:, :, None])[0]
            d = np.where(one.turned[..., None] >= self.query.turns, d, np.inf)
            gaps = d - one.radii[:, :, ::2, None]
        else:
            d = np.linalg.norm(one.ends[:, :, :, None] - other.ends[:, :, None], axis=4)
            d -= one.radii[:, :, ::2, None] + other.radii[:, :, None, ::2]
            turn = other.turned[:, :, None] - one.turned[:, :, :, None]
            gaps = np.where(turn >= np.pi, d, np.inf)
        flat = gaps.reshape(len(gaps), -1)
        at = flat.argmin(axis=1)
        least = flat[np.arange(at.size), at] - self.query.keep
        instant, end, which = np.unravel_index(at, gaps.shape[1:])
        order = np.argsort(-least, kind="stable")
        k = order[least[order] < result.seen[rows.stretch[order]]]
        # The last of several assignments to an index remains: the smallest value.
        to = rows.stretch[k]
        result.seen[to] = least[k]
        result.body[to] = which[k]
        result.share[to] = np.column_stack([rows.start, rows.end])[k, instant[k]]
        result.s[to, 0] = one.s[k, end[k]]
        result.s[to, 1] = other.s[k, which[k] if bodies is None else end[k]]


def apart(one: Pieces, other: Pieces) -> Array:
    """Return lower bounds of the distances (K,) [m] of pairs of pieces, inf if pieces cannot meet.

    The bound is the distance of the hulls along the direction between the middles. Two pieces can
    only meet if the arm may turn by half a turn in between.
    """
    way = one.hull.mean(axis=1) - other.hull.mean(axis=1)
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-300)
    near = np.einsum("ki,kti->kt", way, one.hull).min(axis=1)
    far = np.einsum("ki,kti->kt", way, other.hull).max(axis=1)
    turn = (other.turned[:, :, 1] - one.turned[:, :, 0]).max(axis=1) + other.turns_off
    return np.where(turn >= np.pi, near - far - one.wide - other.wide, np.inf)
