"""Arms that touch nothing, drawn at random: where to begin on the other side of obstacles."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from model.obstacles.bodies import Bodies
from model.paths import Array
from planner.avoidance.asked import Surroundings
from planner.initial_guess.bend_coordinates import bend_coordinates
from planner.initial_guess.many_places import many_places
from planner.initial_guess.residuals import Residuals
from planner.program.limits import Limits
from planner.program.problem import Problem
from planner.targets.base import Target

# Arms that are drawn, so many looked at together, the most that are given.
_DRAWN, _TOGETHER, _MOST = 6000, 200, 40


def likely_clear(
    problem: Problem, targets: tuple[Target, ...], limits: Limits, asked: Surroundings
) -> Iterator[Array]:
    """Yield tensions of arms that touch no obstacle, the nearest to the targets first.

    Looked at on the coarsest mesh, for a scene without loads, so that some may touch after all.
    """
    tendons = frozenset.intersection(*(target.tendons(problem.arm) for target in targets))
    bends = bend_coordinates(problem.arm, tendons, limits)
    tensions = bends.tensions(bends.draw(_DRAWN))
    gaps, crushed = Residuals(problem, targets)(tensions)
    order = np.argsort(np.linalg.norm(gaps, axis=1) + 10 * crushed, kind="stable")
    bodies, given = Bodies(asked.obstacles), 0
    for some in np.split(order, np.arange(_TOGETHER, _DRAWN, _TOGETHER)):
        points, radius = many_places(
            problem.arm, problem.scene, tensions[some], problem.machine_code
        )
        found = bodies.at(points[:, :, None])[0]
        clear = (found - radius[:, None] >= asked.clearance).all(axis=(1, 2))
        for i in some[clear]:
            yield tensions[i]
            given += 1
            if given == _MOST:
                return
