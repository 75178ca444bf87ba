"""How clear an arm is on its way through tensions: see model.clearance.swept."""

from __future__ import annotations

import numpy as np

from model.centreline import Centreline, Counts
from model.clearance.lines import Lines
from model.clearance.swept import Around, Swept, swept
from model.obstacles import HalfSpace, numbers_of
from model.paths import Array
from planner.avoidance.asked import Surroundings


def between(lines: Lines, tensions: Array, asked: Surroundings) -> Swept:
    """Return how clear an arm stays from each of tensions (N + 1, n_tendons) [N] to the next."""

    def settled(stretch: Counts, share: Array) -> list[Centreline | None]:
        way = tensions[stretch + 1] - tensions[stretch]
        return lines.many(tensions[stretch] + share[:, None] * way)

    return swept(settled, len(tensions) - 1, _around(lines, asked, len(tensions) - 1))


def _around(lines: Lines, asked: Surroundings, count: int) -> Around:
    """Return what is to be kept clear of on so many stretches; the base plane comes last."""
    arm, bodies = lines.arm, list(asked.obstacles)
    turns = np.zeros(len(bodies) + asked.of_itself)
    if asked.of_itself:
        normal = tuple(np.array(arm.base_frame)[:, 0].tolist())
        bodies.append(HalfSpace(arm.base_position, normal))
        turns[-1] = np.pi / 2
    still = np.zeros((count, 2, len(bodies), 3))
    return Around(numbers_of(bodies), still, turns, asked.of_itself, asked.clearance)
