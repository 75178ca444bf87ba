"""How clear an arm stays on its way: bounds that are halved until they verify it, or refute it.

The way comes in stretches along which tensions change steadily; a shape at rest is a stretch that
takes no time. Each stretch is cut into parts short enough to know how far strains are from straight
lines, and the arm into pieces. Distances of convex bodies are nowhere below tangent planes, others
fall no faster than a point goes, and two hulls are apart by what parts them along some direction:
where such a bound is not good enough, the part or the piece is halved, whichever is longer.

Behind the base plane only pieces can come whose tangent has turned by a right angle from the base.
Two pieces meet only if the arm has turned by half a turn between them: with less the distance of
their midlines is 2 / pi times the way along the arm, or more (Schur's comparison theorem), so that
they are nearer along the arm than their own thickness, or apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from model.centreline import Centreline, Counts
from model.clearance.pieces import Parts, Pieces
from model.clearance.strain_bounds import Mask
from model.clearance.way import Way
from model.obstacles.bodies import Bodies
from model.paths import Array
from model.time_limit import check_time

# How close bounds come, over L and over the gap; how often parts and pieces are halved, and how
# many rows there are at most.
_CLOSE, _RELATIVE, _LEVELS, _MOST = 2e-5, 1e-2, 30, 40_000


@dataclass(frozen=True, eq=False)
class Around:
    """What an arm is to keep clear of.

    Attributes
    ----------
    bodies : Bodies
        None where the arm is to keep clear of itself.
    keep : float
        The least distance [m].
    turns : (B,)
        How far the arm has to have turned to come near [rad]: a right angle for the base plane.
    moved : (S, 2, B, 3) or None
        How far each body has moved where a stretch begins and where it ends [m], steadily in
        between.
    uneven : (S,)
        How far the share of a stretch's tensions is at the most from the share of its time.
    """

    bodies: Bodies | None
    keep: float
    turns: Array
    moved: Array | None = None
    uneven: Array | None = None


@dataclass(frozen=True, eq=False)
class Found:
    """How clear an arm stays on each of S stretches.

    Attributes
    ----------
    bound : (S,)
        A lower bound of the distance less what is to be kept [m], refined until it is `enough` or
        close to the least that is seen; -infinite where there is none.
    seen, share : (S,)
        The least that is seen, infinite where nothing comes so near that it is looked for; where,
        as a share of the stretch.
    body, s : (S,), (S, 2)
        Which body is nearest, and the arc length of the nearest place [m], or of both.
    step : (S,)
        How far places of the arm go at the most from where a part begins to halfway [m].
    """

    bound: Array
    seen: Array
    share: Array
    body: Counts
    s: Array
    step: Array


class _Time(NamedTuple):
    """P parts of stretches, from shares of these to others (P,)."""

    stretch: Counts
    start: Array
    end: Array

    def some(self, which: Mask | Counts) -> _Time:
        """Return some of the parts."""
        return _Time._make(each[which] for each in self)

    def halved(self) -> _Time:
        """Return the first halves, then the second ones."""
        middle = (self.start + self.end) / 2
        ends = (self.start, middle), (middle, self.end)
        return _Time(np.tile(self.stretch, 2), *(np.concatenate(end) for end in ends))

    def joined(self, other: _Time) -> _Time:
        """Return these parts, then others."""
        return _Time._make(np.concatenate(each) for each in zip(self, other, strict=True))


class _Rows(NamedTuple):
    """Pieces, or pairs of them, in some part each (K,): shares (K, 1 or 2) of elements."""

    part: Counts
    element: Counts
    low: Array
    high: Array

    def some(self, which: Mask | Counts) -> _Rows:
        """Return some of the rows."""
        return _Rows._make(each[which] for each in self)

    def halved(self, column: Counts) -> _Rows:
        """Return both halves of rows, each of the piece in a column (K,)."""
        k, (part, element, low, high) = np.arange(column.size), self
        first, second = high.copy(), low.copy()
        first[k, column] = second[k, column] = (low[k, column] + high[k, column]) / 2
        both = _Rows(part, element, low, first), _Rows(part, element, second, high)
        return both[0].joined(both[1])

    def joined(self, other: _Rows) -> _Rows:
        """Return these rows, then others."""
        return _Rows._make(np.concatenate(each) for each in zip(self, other, strict=True))


def closest(way: Way, count: int, around: Around, enough: float = 0.0) -> Found:
    """Return how clear an arm stays on so many stretches.

    Bounds are refined until they are `enough` [m] beyond what is to be kept, or close to the truth.
    """
    return _Search(way, count, around, enough).run()


class _Search:
    """The search for the least distances; `found` is what it knows so far."""

    def __init__(self, way: Way, count: int, around: Around, enough: float) -> None:
        self.way, self.around, self.enough = way, around, enough
        far, none = np.full(count, np.inf), np.zeros(count)
        pair = np.zeros((count, 2))
        none_yet = np.zeros(count, dtype=int)
        self.found = Found(far.copy(), far, none, none_yet, pair, none.copy())

    def run(self) -> Found:
        """Look at elements, or pairs of them, until none is open."""
        result, count = self.found, self.found.bound.size
        time = self._there(_Time(np.arange(count), np.zeros(count), np.ones(count)))
        if time.stretch.size:
            self._refined(time, self._parts(time))
        return replace(result, bound=np.minimum(result.bound, result.seen))

    def _there(self, time: _Time) -> _Time:
        """Return parts without those of stretches of which some arm has no equilibrium."""
        for share in (time.start, time.end):
            lines = self.way.lines(time.stretch, share)
            lost = np.array([line is None for line in lines], dtype=bool)
            self.found.bound[time.stretch[lost]] = -np.inf
            self.found.share[time.stretch[lost]] = share[lost]
        return time.some(~np.isneginf(self.found.bound[time.stretch]))

    def _parts(self, time: _Time) -> Parts:
        """Return parts by their shapes; of each shape once."""
        ends = np.stack(time[1:], axis=1)[:, : 1 + self.way.moves]
        keys = np.column_stack([time.stretch.repeat(ends.shape[1]), ends.ravel()])
        unique, rows = np.unique(keys, axis=0, return_inverse=True)
        lines = self.way.lines(unique[:, 0].astype(int), unique[:, 1])
        joined = Centreline.joined([line for line in lines if line is not None])
        return Parts(joined, rows.reshape(ends.shape), self.way.spread(*time))

    def _refined(self, time: _Time, parts: Parts) -> None:
        """Halve parts, and what of the arm may meet something in them, until no bound is open."""
        rows = self._whole(parts)
        for level in range(_LEVELS):
            if not rows.part.size:
                return
            check_time()
            late, near = self._step(time, parts, rows, level == _LEVELS - 1)
            rows = near
            if late.part.size:
                # Pieces whose part is halved, and the others with the parts that they are in.
                cut, half = np.unique(late.part, return_inverse=True)
                kept, at = np.unique(near.part, return_inverse=True)
                time = time.some(kept).joined(time.some(cut).halved())
                later = kept.size + half
                rows = near._replace(part=at).joined(late._replace(part=later))
                rows = rows.joined(late._replace(part=later + cut.size))
                time, rows = self._without(time, rows)
                parts = self._parts(time) if rows.part.size else parts

    def _without(self, time: _Time, rows: _Rows) -> tuple[_Time, _Rows]:
        """Return parts and rows without those of stretches of which an arm has no equilibrium."""
        self._there(time)
        there = ~np.isneginf(self.found.bound[time.stretch])
        rows = rows.some(there[rows.part])
        return time.some(there), rows._replace(part=(np.cumsum(there) - 1)[rows.part])

    def _whole(self, parts: Parts) -> _Rows:
        """Return the elements of parts, or the pairs of them that may meet."""
        N = parts.elements
        if self.around.bodies is not None:
            part, element = np.divmod(np.arange(len(parts.rows) * N), N)
            columns = element[:, None]
        else:
            turn = parts.turned[:, :, None, 1:] - parts.turned[:, :, :-1, None]
            reach = turn.max(axis=1) + parts.off[0][:, None] >= np.pi
            reach |= ~parts.known[:, None, None]
            part, *pair = np.nonzero(np.triu(reach, 1))
            columns = np.column_stack(pair)
        none = np.zeros(columns.shape)
        return _Rows(part, columns, none, none + 1)

    def _step(self, time: _Time, parts: Parts, rows: _Rows, last: bool) -> tuple[_Rows, _Rows]:
        """Return rows whose part is to be halved, and the halves of pieces of others."""
        columns = zip(rows.element.T, rows.low.T, rows.high.T, strict=True)
        pieces = [parts.pieces(rows.part, *column) for column in columns]
        result, stretch, keep = self.found, time.stretch[rows.part], self.around.keep
        moved = self._displacement(time, pieces[0])
        lower = self._lower(stretch, moved, pieces) - keep
        known = parts.known[rows.part]
        near = (lower < np.minimum(self.enough, result.seen[stretch])) | ~known
        if near.any():
            self._saw(time, rows.some(near), moved[near], [each[near] for each in pieces])
        seen = result.seen[stretch]
        least = np.where(seen < np.inf, seen, 0.0)
        slack = np.maximum(_CLOSE * parts.lines.arm.length, _RELATIVE * np.abs(least + keep))
        enough = np.minimum(self.enough, np.where(seen < np.inf, least - slack, np.inf))
        # Infinite bounds are of what cannot meet, whatever happens in between.
        open_ = ((lower < enough) & (lower < np.inf)) | ~known
        done = ~open_ if not last and rows.part.size <= _MOST else np.full(open_.size, True)
        np.minimum.at(result.bound, stretch[done], np.where(known, lower, -np.inf)[done])
        sizes = np.column_stack([each.size for each in pieces])
        travel = np.max([each.travel for each in pieces], axis=0)
        np.maximum.at(result.step, stretch[done], travel[done] / 2)
        passing = np.linalg.norm(moved[:, -1] - moved[:, 0], axis=2).max(axis=1, initial=0.0)
        by_time = (travel + passing > sizes.max(axis=1)) | ~known
        piece = ~done & ~by_time
        return rows.some(~done & by_time), rows.some(piece).halved(sizes[piece].argmax(axis=1))

    def _lower(self, stretch: Counts, moved: Array, pieces: list[Pieces]) -> Array:
        """Return lower bounds of the distances (K,) [m] of pieces from bodies, or each other."""
        bodies, one = self.around.bodies, pieces[0]
        if bodies is None:
            return apart(*pieces)
        rest = moved.mean(axis=1)
        d, g = bodies.at(one.middle[:, None] - rest)
        change = np.full(d.shape, np.inf)
        for i, point in enumerate(np.swapaxes(one.hull, 0, 1)):
            offset = (point - one.middle)[:, None] - (moved[:, i // 2] - rest)
            change = np.minimum(change, bodies.change(g, offset))
        lower = d + change - one.wide[:, None]
        if self.around.uneven is not None:
            way = np.linalg.norm(moved[:, -1] - moved[:, 0], axis=2)
            lower -= self.around.uneven[stretch, None] * way
        reach = one.most_turned[:, None] >= self.around.turns
        return np.asarray(np.where(reach, lower, np.inf).min(axis=1, initial=np.inf))

    def _displacement(self, time: _Time, one: Pieces) -> Array:
        """Return how far bodies have moved (K, I, B, 3) where the parts of pieces begin and end."""
        K, instants = one.ends.shape[:2]
        if self.around.moved is None:
            return np.zeros((K, instants, self.around.turns.size, 3))
        first, last = (self.around.moved[time.stretch[one.part], i] for i in (0, 1))
        shares = np.column_stack(time[1:])[one.part, :, None, None]
        return np.asarray(first[:, None] + shares * (last - first)[:, None])

    def _saw(self, time: _Time, rows: _Rows, moved: Array, pieces: list[Pieces]) -> None:
        """Keep the least distances of the ends of pieces that are seen where parts begin or end."""
        result, bodies = self.found, self.around.bodies
        one, other = pieces[0], pieces[-1]
        if bodies is not None:
            d = bodies.at(one.ends[:, :, :, None] - moved[:, :, None])[0]
            d = np.where(one.turned[..., None] >= self.around.turns, d, np.inf)
            gaps = d - one.radii[:, :, ::2, None]
        else:
            d = np.linalg.norm(one.ends[:, :, :, None] - other.ends[:, :, None], axis=4)
            d -= one.radii[:, :, ::2, None] + other.radii[:, :, None, ::2]
            turn = other.turned[:, :, None] - one.turned[:, :, :, None]
            gaps = np.where(turn >= np.pi, d, np.inf)
        flat = gaps.reshape(len(gaps), -1)
        at = flat.argmin(axis=1)
        least = flat[np.arange(at.size), at] - self.around.keep
        instant, end, which = np.unravel_index(at, gaps.shape[1:])
        stretch = time.stretch[rows.part]
        order = np.argsort(-least, kind="stable")
        k = order[least[order] < result.seen[stretch[order]]]
        # The last that is put down is the least.
        to = stretch[k]
        result.seen[to], result.body[to] = least[k], which[k]
        result.share[to] = np.column_stack(time[1:])[rows.part[k], instant[k]]
        result.s[to, 0] = one.places[k, end[k]]
        result.s[to, 1] = other.places[k, which[k] if bodies is None else end[k]]


def apart(one: Pieces, other: Pieces) -> Array:
    """Return lower bounds of the distances (K,) [m] of pairs of pieces, infinite if none meet.

    By what parts their hulls along the direction between their middles.
    """
    way = one.middle - other.middle
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-300)
    near = np.einsum("ki,kti->kt", way, one.hull).min(axis=1)
    far = np.einsum("ki,kti->kt", way, other.hull).max(axis=1)
    return np.where(one.may_meet(other), near - far - one.wide - other.wide, np.inf)
