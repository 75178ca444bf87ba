"""How clear a settled arm is: of obstacles, of the far side of its base plane, and of itself.

The arm's surface is that of balls of its radius along its midline, so that its tip is round.
Distances are those of balls and pieces from each other, where these can meet at all:

- Behind the base plane only a part can come whose tangent has turned by a right angle from the
  base: up to there the midline leads away from the plane.
- Two parts meet only if the arm has turned by half a turn between them. With less the distance of
  their midlines is 2 / pi times the way along the arm, or more (Schur's comparison theorem): then
  they are nearer along the arm than their own thickness, or apart.

Between two points bounds are those of model.clearance.pieces; where
they leave open whether the arm comes nearer than the nearest of its nodes, pieces are halved. So
the answer is a lower bound, and close to the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from model.centreline import Centreline, Settled
from model.clearance.pieces import Pieces, segment_gaps
from model.obstacles import Obstacle, check_obstacles
from model.obstacles.bodies import Bodies
from model.paths import Array

# Pieces to begin with; how close the bound comes, over L and over the clearance; the most pieces.
_PIECES, _CLOSE, _RELATIVE, _MOST = 32, 2e-5, 1e-2, 3000
OBSTACLES, BASE, ITSELF = "obstacles", "the far side of its base plane", "itself"
KINDS = frozenset({OBSTACLES, BASE, ITSELF})


@dataclass(frozen=True)
class Clearance:
    """The least distance between the arm's surface and what it can meet.

    Attributes
    ----------
    gap : float
        A lower bound of it [m]; below 0 the arm passes through; infinite where nothing can meet.
    what : str
        The nearest: "obstacles[i]", "itself", "the far side of its base plane", or "".
    s : tuple of float
        Arc lengths of the nearest places of the arm [m], two of itself.
    """

    gap: float = np.inf
    what: str = ""
    s: tuple[float, ...] = ()

    def __str__(self) -> str:
        if not self.what:
            return "nothing near"
        at = " and ".join(f"{1e3 * s:.0f} mm" for s in self.s)
        if self.gap < 0:
            return f"it passes through {self.what} by {-1e3 * self.gap:.3g} mm (s = {at})"
        return f"it clears {self.what} by {1e3 * self.gap:.3g} mm (s = {at})"


def clearance(shape: Settled, obstacles: Sequence[Obstacle] | Obstacle = ()) -> Clearance:
    """Return how clear a settled arm is of obstacles, its base plane and itself.

    Raises InputError for what is not an obstacle.
    """
    return clearance_of(Centreline.of(shape), check_obstacles(obstacles))


def clearance_of(line: Centreline, obstacles: Sequence[Obstacle] = ()) -> Clearance:
    """Return how clear the arm of a centreline is of all that it can meet."""
    return min(clearances(line, obstacles).values(), key=lambda found: found.gap)


def clearances(
    line: Centreline,
    obstacles: Sequence[Obstacle] = (),
    of: Collection[str] = KINDS,
) -> dict[str, Clearance]:
    """Return how clear the arm of a centreline is of OBSTACLES, BASE and ITSELF, each by name."""
    kinds = _kinds(obstacles)
    looked = [name for name in of if name in kinds]
    pieces = _pieces(line) if looked else None
    return {} if pieces is None else {name: _bounded(pieces, kinds[name]) for name in looked}


def rough_gaps(
    line: Centreline,
    obstacles: Sequence[Obstacle] = (),
    of: Collection[str] = KINDS,
) -> tuple[dict[str, float], Array]:
    """Return lower bounds of distances [m] by name, and nodes (K, 3) of the midline [m].

    Sooner than `clearances` and not as close: by a millimetre or so of an arm of half a metre.
    """
    pieces, kinds, found = _pieces(line), _kinds(obstacles), {}
    for name in of:
        if name in kinds:
            nearest, bounds = kinds[name](pieces)
            found[name] = min(nearest.gap, float(bounds.min()))
    return found, pieces.nodes


def _pieces(line: Centreline) -> Pieces:
    """Return the pieces to begin with."""
    return Pieces.of(line, max(1, -(-_PIECES // (line.s.size - 1))))


def _kinds(obstacles: Sequence[Obstacle]) -> dict[str, Look]:
    """Return how what can be met is looked at."""
    kinds: dict[str, Look] = {BASE: _plane, ITSELF: _self}
    if obstacles:
        bodies = Bodies(obstacles)
        kinds[OBSTACLES] = lambda pieces: _obstacles(pieces, bodies)
    return kinds


# The nearest of the nodes, and for each piece a lower bound of its distance.
Found = tuple[Clearance, Array]
Look = Callable[[Pieces], Found]


def _bounded(pieces: Pieces, look: Look) -> Clearance:
    """Return the nearest place, with a lower bound of the distance that is close to it."""
    while True:
        nearest, bounds = look(pieces)
        slack = max(_CLOSE * pieces.line.arm.length, _RELATIVE * abs(nearest.gap))
        open_ = bounds < nearest.gap - slack
        if nearest.gap == np.inf or not open_.any() or bounds.size > _MOST:
            return replace(nearest, gap=min(nearest.gap, float(bounds.min())))
        pieces = pieces.halved(open_)


def _obstacles(pieces: Pieces, bodies: Bodies) -> Found:
    """Look at obstacles: how their distances change along half a piece is bounded."""
    nodes, n = pieces.nodes, len(pieces.nodes)
    middle, half = (nodes[1:] + nodes[:-1]) / 2, (nodes[1:] - nodes[:-1]) / 2
    found, gradient = bodies.at(np.vstack([nodes, middle])[:, None])
    ends = [bodies.change(gradient[n:], sign * half[:, None]) for sign in (1.0, -1.0)]
    bounds = (found[n:] + np.minimum(*ends)).min(axis=1) - pieces.sag - pieces.most
    gaps = found[:n] - pieces.least[:, None]
    at, which = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
    s = (float(pieces.s[at]),)
    return Clearance(float(gaps[at, which]), f"{OBSTACLES}[{which}]", s), bounds


def _plane(pieces: Pieces) -> Found:
    """Look at the far side of the base plane."""
    reaches = pieces.turned >= np.pi / 2
    if not reaches[-1]:
        return Clearance(), np.full(pieces.length.size, np.inf)
    arm = pieces.line.arm
    height = (pieces.nodes - arm.base_position) @ np.array(arm.base_frame)[:, 0]
    gaps = np.where(reaches, height - pieces.least, np.inf)
    lower = np.minimum(height[:-1], height[1:]) - pieces.sag - pieces.most
    at = int(np.argmin(gaps))
    near = Clearance(float(gaps[at]), BASE, (float(pieces.s[at]),))
    return near, np.where(reaches[1:], lower, np.inf)


def _self(pieces: Pieces) -> Found:
    """Look at the arm itself."""
    bounds = np.full(pieces.length.size, np.inf)
    turned, nodes, radius = pieces.turned, pieces.nodes, pieces.least
    i, j = np.nonzero(np.triu(turned[None, :] - turned[:, None] >= np.pi, 1))
    if not i.size:
        return Clearance(), bounds
    gaps = np.linalg.norm(nodes[i] - nodes[j], axis=1) - radius[i] - radius[j]
    k = int(np.argmin(gaps))
    near = Clearance(float(gaps[k]), ITSELF, (float(pieces.s[i[k]]), float(pieces.s[j[k]])))
    before, behind = np.nonzero(np.triu(turned[None, 1:] - turned[:-1, None] >= np.pi, 1))
    wide, middle = pieces.sag + pieces.most, (nodes[1:] + nodes[:-1]) / 2
    # No two points are nearer than the middles less half the lengths: most pairs end here.
    within = wide + pieces.length / 2
    apart = np.linalg.norm(middle[before] - middle[behind], axis=1)
    apart -= within[before] + within[behind]
    close = apart < near.gap
    a, b = before[close], behind[close]
    exact = segment_gaps(nodes[a], nodes[a + 1], nodes[b], nodes[b + 1])
    apart[close] = exact - wide[a] - wide[b]
    np.minimum.at(bounds, before, apart)
    np.minimum.at(bounds, behind, apart)
    return near, bounds
