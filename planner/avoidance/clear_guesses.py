"""Arms that touch nothing, drawn at random: where to begin on the other side of obstacles."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from model.forward import explicit_map, schemes_of
from model.many_poses import many_poses
from model.obstacles.bodies import Bodies
from model.paths import Array
from model.rotations import matrices
from planner.avoidance.asked import Surroundings
from planner.initial_guess.bend_coordinates import bend_coordinates
from planner.initial_guess.residuals import Residuals
from planner.program.limits import Limits
from planner.program.problem import Problem
from planner.targets.base import Target

# Arms that are drawn, so many looked at together, the most that are given.
_DRAWN, _TOGETHER, _MOST = 6000, 200, 40
# Where between two nodes an arm is looked at.
_SHARES = (0.25, 0.5, 0.75, 1.0)


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
        points, radius = _points(problem, tensions[some])
        found = bodies.at(points[:, :, None])[0]
        clear = (found - radius[:, None] >= asked.clearance).all(axis=(1, 2))
        for i in some[clear]:
            yield tensions[i]
            given += 1
            if given == _MOST:
                return


def _points(problem: Problem, tensions: Array) -> tuple[Array, Array]:
    """Return places (m, K, 3) of arms under tensions (m, n_tendons), and radii (K,) there [m].

    Between the nodes they are on cubics.
    """
    arm, m = problem.arm, len(tensions)
    scheme = "magnus6" if "magnus6" in schemes_of(problem.scene) else "rk4"
    forward = explicit_map(arm, problem.scene, scheme, 1, (), problem.machine_code)
    found, _ = many_poses(forward, range(forward.mesh.steps + 1))(tensions.T)
    poses = found.transpose(2, 0, 1)
    u, t = poses[:, :, 4:], matrices(poses[:, :, :4].reshape(-1, 4))[:, :, 0].reshape(m, -1, 3)
    h = np.diff(forward.mesh.s)
    parts, places = [], []
    for x in _SHARES:
        rise, size = x * x * (3 - 2 * x), np.linalg.norm(np.diff(u, axis=1), axis=2)[..., None]
        ends = (1 - rise) * u[:, :-1] + rise * u[:, 1:]
        slopes = x * (1 - x) ** 2 * t[:, :-1] - x * x * (1 - x) * t[:, 1:]
        parts.append(ends + size * slopes)
        places.append(forward.mesh.s[:-1] + x * h)
    radius = arm.radius.evaluate(np.concatenate(places), arm.length)[0]
    return np.concatenate(parts, axis=1), radius
