"""Arms that would press on what they are to hold, drawn at random: where to begin with holds."""

from __future__ import annotations

import numpy as np

from model.paths import Array
from planner.initial_guess.bend_coordinates import bend_coordinates
from planner.initial_guess.many_places import many_places
from planner.solve.task import Task
from planner.targets.hold import Hold

# Arms that are drawn, and those that are given.
_DRAWN, _GIVEN = 3000, 12
# How deep arms may reach into what is held, over their length; which directions are alike.
_DEEP, _ALIKE = 0.2, 0.95


def likely_pressing(task: Task, hold: Hold) -> list[Array]:
    """Return tensions (n_tendons,) of arms that, free, would reach into what is held.

    First those that would be pressed apart from it along what balances the wrench, or within the
    cone of friction about it; of these the least tensions first, none that are alike. Of the arm
    without loads, on the coarsest mesh.
    """
    arm, body = task.arm, hold.obstacle
    tendons = frozenset(j for j in range(arm.n_tendons) if task.allowed.upper[j] > 0)
    bends = bend_coordinates(arm, tendons, task.allowed)
    tensions = bends.tensions(bends.draw(_DRAWN))
    points, radius = many_places(arm, task.simple.scene, tensions, task.machine_code)
    gap = body.distance(points.reshape(-1, 3)).reshape(points.shape[:2]) - radius
    gap[np.isnan(gap)] = np.inf
    deepest = gap.argmin(axis=1)
    depth = -gap[np.arange(_DRAWN), deepest]
    own = np.flatnonzero((depth > 0) & (depth < _DEEP * arm.length))
    if not own.size:
        return []
    normals = body.gradient(points[own, deepest[own]])
    force = np.array(hold.wrench[:3])
    size = float(np.linalg.norm(force))
    against = normals @ force / size if size else np.ones(own.size)
    within = 1 / np.hypot(1.0, hold.friction)
    effort = np.linalg.norm(tensions[own], axis=1)
    found, seen = list[Array](), list[Array]()
    for i in np.lexsort((effort, -np.minimum(against, within).round(1))):
        T = tensions[own[i]] / max(effort[i], 1e-300)
        if all(float(T @ other) < _ALIKE for other in seen):
            seen.append(T)
            found.append(tensions[own[i]])
        if len(found) == _GIVEN:
            break
    return found
