"""How clear an arm stays on its way: bounds that are halved until they verify it, or refute it.

The way comes in stretches along which tensions change steadily; an arm at rest is one that takes no
time. Each stretch is cut into parts short enough to know how far strains are from straight lines,
and the arm into pieces. Distances of convex bodies are nowhere below tangent planes, others fall no
faster than a point goes, and two hulls are apart by what parts them along some direction: where
such a bound is not good enough, the part or the piece is halved, whichever is longer.

Behind the base plane only pieces can come whose tangent has turned by a right angle from the base.
Two pieces meet only if the arm has turned by half a turn between them: with less the distance of
their midlines is 2 / pi times the way along the arm, or more (Schur's comparison theorem), so that
they are nearer along the arm than their own thickness, or apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol

import numpy as np

from octoplan.model.centreline import Centreline, Counts
from octoplan.model.extensions.clearance.pieces import Parts, Pieces, Spread
from octoplan.model.extensions.obstacles import Obstacle
from octoplan.model.extensions.obstacles.base import distances_from
from octoplan.model.paths import Array, Mask
from octoplan.model.support.progress import check_time

# How close bounds come, over L and over the gap; how often parts and pieces are halved, and how
# many rows there are at most.
_CLOSE, _RELATIVE, _LEVELS, _MOST = 2e-5, 1e-2, 30, 40_000


class Way(Protocol):
    """The way of an arm whose tensions change steadily on each of its stretches."""

    def lines(self, stretch: Counts, share: Array) -> list[Centreline | None]:
        """Return the arms at shares (K,) of stretches (K,); None where one has no equilibrium."""

    def spread(self, stretch: Counts, start: Array, end: Array) -> Spread:
        """Return how far strains are from straight lines from shares (P,) to others."""


@dataclass(frozen=True, eq=False)
class Around:
    """What an arm is to keep clear of.

    Attributes
    ----------
    bodies : sequence of Obstacle
        None where the arm is to keep clear of itself.
    keep : float
        The least distance [m].
    turns : (B,)
        How far the arm has to have turned to come near [rad]: a right angle for the base plane.
    moved : (S, 2, B, 3)
        How far each body has moved where a stretch begins and where it ends [m], steadily in
        between; or (1, 2, B, 3) for all stretches.
    uneven : (S,)
        How far the share of a stretch's tensions is at the most from the share of its time; or
        (1,) for all stretches.
    """

    bodies: Sequence[Obstacle] | None
    keep: float
    turns: Array
    moved: Array
    uneven: Array = field(default_factory=lambda: np.zeros(1))


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


class _Rows(NamedTuple):
    """Pieces, or pairs of them, during parts of stretches, from shares of these to others.

    Stretches and shares are (K,); elements, and shares of them, (K, 1 or 2).
    """

    stretch: Counts
    start: Array
    end: Array
    element: Counts
    low: Array
    high: Array

    def some(self, which: Mask | Counts) -> _Rows:
        """Return some of the rows."""
        return _Rows._make(each[which] for each in self)


def closest(way: Centreline | Way, count: int, around: Around, enough: float = 0.0) -> Found:
    """Return how clear an arm stays on so many stretches; on one at rest.

    Bounds are refined until they are `enough` [m] beyond what is to be kept, or close to the truth.
    """
    far, none, pair = np.full(count, np.inf), np.zeros(count), np.zeros((count, 2))
    result = Found(far.copy(), far, none.copy(), none.astype(int), pair, none.copy())
    search = _Search(way, around, enough, result)
    pieces = np.zeros((count, 1 + (around.bodies is None)))
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
    """The search for the least distances; `found` is what it knows so far."""

    way: Centreline | Way
    around: Around
    enough: float
    found: Found

    def parts(self, rows: _Rows) -> tuple[_Rows, Counts, Parts | None]:
        """Return rows, which part of a stretch each is in, and these; of each arm once.

        Without rows of stretches of which some arm has no equilibrium; None where none are left.
        """
        rows = rows.some(~np.isneginf(self.found.bound[rows.stretch]))
        if not rows.stretch.size:
            return rows, rows.stretch, None
        if isinstance(self.way, Centreline):
            return rows, 0 * rows.stretch, Parts.of(self.way, np.zeros((1, 1), dtype=int), None)
        time, part = np.unique(np.column_stack(rows[:3]), axis=0, return_inverse=True)
        stretch, start, end = time[:, 0].astype(int), time[:, 1], time[:, 2]
        keys = np.column_stack([stretch.repeat(2), time[:, 1:].ravel()])
        arms, at = np.unique(keys, axis=0, return_inverse=True)
        which = arms[:, 0].astype(int)
        lines = self.way.lines(which, arms[:, 1])
        there = [line for line in lines if line is not None]
        if len(there) < len(lines):
            gone = np.array([line is None for line in lines])
            self.found.bound[which[gone]], self.found.share[which[gone]] = -np.inf, arms[gone, 1]
            return self.parts(rows)
        spread = self.way.spread(stretch, start, end)
        return rows, part.ravel(), Parts.of(Centreline.joined(there), at.reshape(-1, 2), spread)

    def whole(self, rows: _Rows, parts: Parts) -> _Rows:
        """Return the elements of arms in each part, or the pairs of them that may meet."""
        N = parts.turned.shape[2] - 1
        if self.around.bodies is not None:
            part, element = np.divmod(np.arange(len(parts.rows) * N), N)
            return rows.some(part)._replace(element=element[:, None])
        turn = parts.turned[:, :, None, 1:] - parts.turned[:, :, :-1, None]
        reach = turn.max(axis=1) + parts.turns_off[:, None] >= np.pi
        part, *pair = np.nonzero(np.triu(reach | ~parts.known[:, None, None], 1))
        return rows.some(part)._replace(element=np.column_stack(pair))

    def step(self, rows: _Rows, part: Counts, parts: Parts, is_last: bool) -> _Rows:
        """Return the rows to look at next: halves of parts in time, or of pieces."""
        columns = zip(rows.element.T, rows.low.T, rows.high.T, strict=True)
        pieces = [parts.pieces(part, *column) for column in columns]
        result, stretch, keep = self.found, rows.stretch, self.around.keep
        # How far bodies have moved (K, I, B, 3) where the parts of pieces begin and end.
        shares = np.column_stack([rows.start, rows.end])[:, : parts.rows.shape[1], None, None]
        first, last = np.swapaxes(self.around.moved[stretch % len(self.around.moved)], 0, 1)
        moved, known = first[:, None] + shares * (last - first)[:, None], parts.known[part]
        lower = self._lower_bounds(stretch, moved, pieces) - keep
        near = (lower < np.minimum(self.enough, result.seen[stretch])) | ~known
        if near.any():
            self._record_ends(rows.some(near), moved[near], [each.some(near) for each in pieces])
        seen = result.seen[stretch]
        least = np.where(seen < np.inf, seen, 0.0)
        slack = np.maximum(_CLOSE * parts.lines.arm.length, _RELATIVE * np.abs(least + keep))
        enough = np.minimum(self.enough, np.where(seen < np.inf, least - slack, np.inf))
        # Infinite bounds are of what cannot meet, whatever happens in between.
        open_ = ((lower < enough) & (lower < np.inf)) | ~known
        done = ~open_ | is_last | (stretch.size > _MOST)
        np.minimum.at(result.bound, stretch[done], np.where(known, lower, -np.inf)[done])
        sizes = np.column_stack([each.size for each in pieces])
        travel = np.max([each.travel for each in pieces], axis=0)
        np.maximum.at(result.step, stretch[done], travel[done] / 2)
        passing = np.linalg.norm(moved[:, -1] - moved[:, 0], axis=2).max(axis=1, initial=0.0)
        by_time = (travel + passing > sizes.max(axis=1)) | ~known
        late, cut = rows.some(~done & by_time), rows.some(~done & ~by_time)
        longest = np.eye(sizes.shape[1], dtype=bool)[sizes[~done & ~by_time].argmax(axis=1)]
        half, middle = (cut.low + cut.high) / 2, (late.start + late.end) / 2
        halves = (
            cut._replace(high=np.where(longest, half, cut.high)),
            cut._replace(low=np.where(longest, half, cut.low)),
            late._replace(end=middle),
            late._replace(start=middle),
        )
        return _Rows._make(map(np.concatenate, zip(*halves, strict=True)))

    def _lower_bounds(self, stretch: Counts, moved: Array, pieces: list[Pieces]) -> Array:
        """Return lower bounds of the distances (K,) [m] of pieces from bodies, or each other."""
        bodies, one = self.around.bodies, pieces[0]
        if bodies is None:
            return apart(*pieces)
        rest, middle = moved.mean(axis=1), one.hull.mean(axis=1)[:, None]
        d, g = distances_from(bodies, middle - rest)
        convex = np.array([body.is_convex for body in bodies], dtype=bool)
        change = np.full(d.shape, np.inf)
        for i, point in enumerate(np.swapaxes(one.hull, 0, 1)):
            offset = point[:, None] - middle - (moved[:, i // 2] - rest)
            # That of other bodies falls no faster than a point goes.
            along = np.einsum("kbi,kbi->kb", g, offset)
            off = np.where(convex, along, -np.linalg.norm(offset, axis=2))
            change = np.minimum(change, off)
        way = np.linalg.norm(moved[:, -1] - moved[:, 0], axis=2)
        uneven = self.around.uneven[stretch % len(self.around.uneven), None] * way
        turned = one.turned[:, :, 1].max(axis=1) + one.turns_off
        reach = turned[:, None] >= self.around.turns
        lower = np.where(reach, d + change - one.wide[:, None] - uneven, np.inf)
        return np.asarray(lower.min(axis=1, initial=np.inf))

    def _record_ends(self, rows: _Rows, moved: Array, pieces: list[Pieces]) -> None:
        """Keep the least distances of the ends of pieces that are seen where parts begin or end."""
        result, bodies = self.found, self.around.bodies
        one, other = pieces[0], pieces[-1]
        if bodies is not None:
            d = distances_from(bodies, one.ends[:, :, :, None] - moved[:, :, None])[0]
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
        order = np.argsort(-least, kind="stable")
        k = order[least[order] < result.seen[rows.stretch[order]]]
        # The last that is put down is the least.
        to = rows.stretch[k]
        result.seen[to], result.body[to] = least[k], which[k]
        result.share[to] = np.column_stack([rows.start, rows.end])[k, instant[k]]
        result.s[to, 0] = one.s[k, end[k]]
        result.s[to, 1] = other.s[k, which[k] if bodies is None else end[k]]


def apart(one: Pieces, other: Pieces) -> Array:
    """Return lower bounds of the distances (K,) [m] of pairs of pieces, infinite if none meet.

    By what parts their hulls along the direction between their middles. They meet only if the arm
    may turn by half a turn from one to the other.
    """
    way = one.hull.mean(axis=1) - other.hull.mean(axis=1)
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-300)
    near = np.einsum("ki,kti->kt", way, one.hull).min(axis=1)
    far = np.einsum("ki,kti->kt", way, other.hull).max(axis=1)
    turn = (other.turned[:, :, 1] - one.turned[:, :, 0]).max(axis=1) + other.turns_off
    return np.where(turn >= np.pi, near - far - one.wide - other.wide, np.inf)
