"""How clear an arm at rest is: of obstacles, of the far side of its base plane, and of itself.

The arm's surface is that of balls of its radius along its midline, so that its tip is round.
Answers are lower bounds, refined until they are close to the truth; see
octoplan.model.extensions.clearance.bisection.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.centreline import Centreline, Settled
from octoplan.model.extensions.clearance.bisection import Around, closest
from octoplan.model.extensions.obstacles import HalfSpace, Obstacle, check_obstacles
from octoplan.model.support.checks import kind

OBSTACLES, BASE, ITSELF = "obstacles", "the far side of its base plane", "itself"
KINDS = OBSTACLES, BASE, ITSELF


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

    Raises InputError for what is no shape or no obstacle.
    """
    kind("shape", shape, Settled, "a Shape, as settle returns it")
    results = clearances(shape.centreline(), check_obstacles(obstacles))
    return min(results.values(), key=lambda result: result.gap)


def clearances(
    line: Centreline,
    obstacles: Sequence[Obstacle] = (),
    of: Collection[str] = KINDS,
    enough: float = np.inf,
) -> dict[str, Clearance]:
    """Return how clear the arm of a centreline is of OBSTACLES, BASE and ITSELF, each by name.

    Distances are refined up to `enough` [m]: bounds above that may be far below the truth.
    """
    results = dict[str, Clearance]()
    for name in (each for each in of if each != OBSTACLES or obstacles):
        result = closest(line, 1, around(line.arm, name, obstacles), enough)
        seen, s = bool(result.seen[0] < np.inf), tuple(result.s[0].tolist())
        what = f"{OBSTACLES}[{result.body[0]}]" if name == OBSTACLES else name
        near = (what, s if name == ITSELF else s[:1]) if seen else ("", ())
        results[name] = Clearance(float(result.bound[0]), *near)
    return results


def from_itself(shape: Settled) -> Clearance:
    """Return between which cross-sections the gap is least, none where no parts can meet."""
    return clearances(shape.centreline(), of={ITSELF})[ITSELF]


def base_plane(arm: Arm) -> HalfSpace:
    """Return what is behind the plane of an arm's base."""
    return HalfSpace(arm.base_position, tuple(np.array(arm.base_frame)[:, 0].tolist()))


def around(arm: Arm, name: str, obstacles: Sequence[Obstacle], keep: float = 0.0) -> Around:
    """Return what an arm is to keep clear of, by the name of its kind."""
    if name == ITSELF:
        return Around(None, keep, np.zeros(0), np.zeros((1, 2, 0, 3)))
    bodies = obstacles if name == OBSTACLES else [base_plane(arm)]
    turns = np.full(len(bodies), (name == BASE) * np.pi / 2)
    return Around(bodies, keep, turns, np.zeros((1, 2, len(bodies), 3)))
