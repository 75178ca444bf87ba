"""Clearance of an arm at rest: from obstacles, the base plane, and other parts of the arm.

The arm's surface is the envelope of balls of the arm's radius along the midline, so that the
tip is round. Results are lower bounds, refined close to the exact value; see
octoplan.model.extensions.clearance.bisection.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.centreline import Centreline, Settled
from octoplan.model.extensions.clearance.bisection import ClearanceQuery, closest
from octoplan.model.extensions.obstacles import HalfSpace
from octoplan.model.extensions.obstacles.base import Obstacle, check_obstacles
from octoplan.model.support.checks import kind

OBSTACLES = "obstacles"
BASE = "the far side of its base plane"
ITSELF = "itself"
KINDS = OBSTACLES, BASE, ITSELF


@dataclass(frozen=True)
class Clearance:
    """Smallest distance of the arm's surface from obstacles, the base plane or the arm.

    Attributes
    ----------
    gap : float
        Lower bound of the distance [m]; negative for penetration, inf if nothing can meet.
    what : str
        The nearest body: "obstacles[i]", "itself", "the far side of its base plane", or "".
    s : tuple of float
        Arc length of the nearest point of the arm [m]; two for "itself".
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
    """Return the clearance of a settled arm from obstacles, the base plane and other parts.

    Raises InputError if the arguments are not a shape and obstacles.
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
    """Return the clearances of a midline from OBSTACLES, BASE and ITSELF, by name.

    Distances are refined up to `enough` [m]: larger bounds may be far below the exact value.
    """
    results = dict[str, Clearance]()
    for name in (each for each in of if each != OBSTACLES or obstacles):
        result = closest(line, 1, clearance_query(line.arm, name, obstacles), enough)
        is_near = bool(result.seen[0] < np.inf)
        s = tuple(result.s[0].tolist())
        what = f"{OBSTACLES}[{result.body[0]}]" if name == OBSTACLES else name
        near = (what, s if name == ITSELF else s[:1]) if is_near else ("", ())
        results[name] = Clearance(float(result.bound[0]), *near)
    return results


def from_itself(shape: Settled) -> Clearance:
    """Return the clearance of a settled arm from itself."""
    return clearances(shape.centreline(), of={ITSELF})[ITSELF]


def base_plane(arm: Arm) -> HalfSpace:
    """Return the half-space behind the plane of an arm's base."""
    return HalfSpace(arm.base_position, tuple(np.array(arm.base_frame)[:, 0].tolist()))


def clearance_query(
    arm: Arm, name: str, obstacles: Sequence[Obstacle], keep: float = 0.0
) -> ClearanceQuery:
    """Return the query of an arm's clearance from OBSTACLES, BASE or ITSELF."""
    if name == ITSELF:
        return ClearanceQuery(
            bodies=None, keep=keep, turns=np.zeros(0), moved=np.zeros((1, 2, 0, 3))
        )
    bodies = obstacles if name == OBSTACLES else [base_plane(arm)]
    return ClearanceQuery(
        bodies=bodies,
        keep=keep,
        turns=np.full(len(bodies), (name == BASE) * np.pi / 2),
        moved=np.zeros((1, 2, len(bodies), 3)),
    )
