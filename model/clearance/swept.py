"""How clear an arm stays on its way: bounds that are refined until they verify it, or refute it.

The way comes in stretches along which tensions change smoothly. These are cut into parts, each
known at five instants, and the arm into pieces; where a lower bound of the distance is not good
enough, parts or pieces are halved, whichever are longer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from model.centreline import Centreline, Counts
from model.clearance.meetings import Surrounding, apart, pairs, seen_apart
from model.clearance.parts import Parts
from model.clearance.smooth import SHARES
from model.clearance.worklist import Worklist
from model.obstacles.bodies import Bodies
from model.paths import Array
from model.time_limit import check_time

# How close bounds come, over L and over the gap; how often parts and pieces are halved, and how
# many rows there are at most.
_CLOSE, _RELATIVE, _LEVELS, _MOST = 2e-5, 1e-2, 30, 40_000

# Which stretches (K,) and shares of them (K,) -> the arms there, None where one does not settle.
Settled = Callable[[Counts, Array], Sequence[Centreline | None]]


@dataclass(frozen=True, eq=False)
class Swept:
    """How clear an arm stays on each of S stretches of its way.

    Attributes
    ----------
    bound : (S,)
        A lower bound of the distance less what is to be kept [m], refined until it is 0 or more or
        close to the least that is seen; -infinite where an arm does not settle, or moves by jumps.
    seen : (S,)
        The least that is seen [m], infinite where nothing comes so near that it is looked for.
    share : (S,)
        Where that is, as a share of the stretch.
    """

    bound: Array
    seen: Array
    share: Array


@dataclass(frozen=True, eq=False)
class Around:
    """What a moving arm is to keep clear of.

    Attributes
    ----------
    bodies : Bodies
    moved : (S, 2, B, 3)
        How far each has moved where a stretch begins and where it ends [m], steadily in between.
    turns : (B,)
        How far the arm has to have turned to come near [rad]; see model.clearance.meetings.
    itself : bool
    keep : float
        The least distance from all of these [m].
    """

    bodies: Bodies
    moved: Array
    turns: Array
    itself: bool
    keep: float

    def during(self, left: Worklist) -> Surrounding:
        """Return the bodies during parts of stretches."""
        first, last = self.moved[left.stretch, 0], self.moved[left.stretch, 1]
        shares = np.stack([left.start, left.end], axis=1)[:, :, None, None]
        moved = first[:, None] + shares * (last - first)[:, None]
        return Surrounding(self.bodies, moved, self.turns)


def swept(settled: Settled, count: int, around: Around) -> Swept:
    """Return how clear an arm stays on so many stretches."""
    found = Swept(np.full(count, np.inf), np.full(count, np.inf), np.zeros(count))
    look = _Look(settled, around, found)
    if len(around.bodies):
        look.run(_every, count)
    if around.itself:
        look.run(pairs, count)
    return Swept(np.minimum(found.bound, found.seen), found.seen, found.share)


def _every(parts: Parts) -> tuple[Counts, Counts]:
    """Return the parts (K,) and elements (K, 1) of all pieces."""
    part, element = np.divmod(np.arange(len(parts.rows) * parts.elements), parts.elements)
    return part, element[:, None]


class _Look:
    """The search for the least distances; `found` is what it knows so far."""

    def __init__(self, settled: Settled, around: Around, found: Swept) -> None:
        self.settled, self.around, self.found = settled, around, found
        self.lines: dict[tuple[int, float], Centreline | None] = {}

    def run(self, rows: Callable[[Parts], tuple[Counts, Counts]], count: int) -> None:
        """Look at elements, or pairs of them, until none is open."""
        nothing = np.zeros(0, dtype=int)
        left = self._settled(Worklist.whole(count, nothing, nothing[:, None]))
        if not left.stretch.size:
            return
        part, element = rows(self._parts(left))
        none = np.zeros(element.shape)
        left = replace(left, part=part, element=element, low=none, high=none + 1)
        for level in range(_LEVELS):
            if not left.part.size:
                break
            check_time()
            last = level == _LEVELS - 1 or left.part.size > _MOST
            left = self._settled(self._step(left, last))

    def _settled(self, left: Worklist) -> Worklist:
        """Return what is left without stretches where some arm does not settle, which are told."""
        instants = left.instants
        keys = list(dict.fromkeys(_keys(left.stretch, instants)))
        new = [key for key in keys if key not in self.lines]
        if new:
            found = self.settled(np.array([i for i, _ in new]), np.array([u for _, u in new]))
            self.lines.update(zip(new, found, strict=True))
        for stretch, share in keys:
            if self.lines[stretch, share] is None:
                self.found.bound[stretch], self.found.share[stretch] = -np.inf, share
        return left.without(np.isneginf(self.found.bound))

    def _parts(self, left: Worklist) -> Parts:
        keys = _keys(left.stretch, left.instants)
        index = {key: i for i, key in enumerate(dict.fromkeys(keys))}
        lines = [self.lines[key] for key in index]
        rows = np.array([index[key] for key in keys]).reshape(-1, SHARES.size)
        return Parts.of([line for line in lines if line is not None], rows)

    def _step(self, left: Worklist, last: bool) -> Worklist:
        """Return what is still open after a look; with `last` bounds are taken as they are."""
        parts, around, found = self._parts(left), self.around, self.found
        pieces, stretch = left.pieces(parts), left.stretch[left.part]
        bodies = around.during(left) if len(pieces) == 1 else None
        lower = bodies.lower(*pieces) if bodies else apart(*pieces)
        lower -= around.keep
        known = pieces[0].known
        rows = np.flatnonzero((lower < 0) | ~known)
        if rows.size:
            some = [own[rows] for own in pieces]
            self._saw(left, rows, bodies.seen(*some) if bodies else seen_apart(*some))
        enough = found.seen[stretch] * np.where(found.seen[stretch] < 0, 1 + _RELATIVE, 1)
        enough = np.minimum(0.0, enough - _CLOSE * parts.lines.arm.length)
        open_ = (lower < enough) | ~known
        # Infinite bounds are of what cannot meet, whatever happens in between.
        open_ &= (lower < np.inf) & (found.bound[stretch] > -np.inf)
        done = ~open_ | last
        np.minimum.at(found.bound, stretch[done], np.where(known, lower, -np.inf)[done])
        rows = np.flatnonzero(~done)
        sizes = np.column_stack([own.size for own in pieces])
        travel = np.max([own.travel for own in pieces], axis=0)
        if bodies:
            travel += bodies.travel[left.part]
        by_time = (travel > sizes.max(axis=1)) | ~known
        late, piece = rows[by_time[rows]], rows[~by_time[rows]]
        return left.halved(late, piece, sizes[piece].argmax(axis=1))

    def _saw(self, left: Worklist, rows: Counts, gaps: Array) -> None:
        """Keep the least of the distances (K, 5) [m] of rows (K,) that are seen at instants."""
        found, part = self.found, left.part[rows]
        gaps, instants = gaps - self.around.keep, left.instants[part]
        at = gaps.argmin(axis=1)
        least, stretch = gaps[np.arange(at.size), at], left.stretch[part]
        order = np.argsort(-least, kind="stable")
        better = order[least[order] < found.seen[stretch[order]]]
        # The last that is put down is the least.
        found.seen[stretch[better]] = least[better]
        found.share[stretch[better]] = instants[better, at[better]]


def _keys(stretch: Counts, shares: Array) -> list[tuple[int, float]]:
    """Return stretches (P,) and shares of them (P, 5), pair by pair."""
    return list(zip(stretch.repeat(SHARES.size).tolist(), shares.ravel().tolist(), strict=True))
