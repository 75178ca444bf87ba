"""Initial guesses of tensions and base joints: draws over the limits, fitted to the targets.

Tensions are drawn as for a fixed base (octoplan.planner.solve.guesses), joint values uniformly
within their limits. Without loads, the joints move the arm as a rigid body. The draws nearest to
the targets are fitted by least squares with a small weight on tensions and joints.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from octoplan.model.effects.sections import Extension
from octoplan.model.loads import is_coupled
from octoplan.model.paths import Array
from octoplan.planner.extensions.base_joints.block import HALF_TURN
from octoplan.planner.extensions.base_joints.placement import JointPlacement, moved_poses
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.program_instance import tension_scales
from octoplan.planner.solve.guesses import (
    POINT,
    BendCoordinates,
    distinct,
    least_squares,
    residuals_of,
)

# Number of draws, and of the draws that are fitted: the nearest ones.
_DRAWN = 2000
_FITTED = 40
# Weight of the largest unit of tension, and of a unit of the joints, beside residuals [-]. With
# this weight fits have little effort and nearly meet the targets.
_EFFORT = 0.2
# Initial roots of the squeezes of sections [-]. The derivative with respect to a zero root is zero.
_SQUEEZED = 0.1
# Smallest difference between guesses, over the units of tensions and joints [-].
_APART = 0.3
# Factor of the tensions of a guess without loads for the guess of an arm under loads [-].
_STRONGER = 3.0
# Distance beyond a limit of the rotation up to which a guess a turn away counts as near [rad];
# under loads it is a quarter of a turn.
_NEAR_END = 0.5
# Number of guesses after which stronger ones follow under loads.
_FIRST = 3


def guesses(problem: PlanningProblem, base: JointPlacement, missed: bool) -> Iterator[Array]:
    """Yield tensions and joint values (n_tendons + 2,), the best fits first.

    Fits have no regard to effort if targets are `missed` or have soft residuals.
    """
    limits = problem.allowed
    n = problem.arm.n_tendons
    straight = np.clip(5e-3 * tension_scales(problem.arm, limits), limits.lower, limits.upper)
    at_rest = np.append(straight, base.values)
    if problem.target_set.conditions < POINT:
        yield at_rest
    loaded = is_coupled(problem.arm, problem.scene)
    for k, controls in enumerate(_fitted(problem, base, missed)):
        yield controls
        yield from _turned(controls, base, np.pi / 2 if loaded else _NEAR_END)
        if k == _FIRST and problem.target_set.conditions >= POINT:
            yield at_rest
        if k >= _FIRST and loaded:
            stronger = np.clip(_STRONGER * controls[:n], limits.lower, limits.upper)
            yield np.append(stronger, controls[n:])


def _turned(controls: Array, base: JointPlacement, near: float) -> Iterator[Array]:
    """Yield the controls with about the same direction of the base a turn away, within limits.

    A range of a turn ends where it begins: an optimum may be near the other end. Rotations up to
    `near` [rad] beyond the limits count.
    """
    low, high = (each.rotation for each in base.joints.limits)
    for turn in (-2 * np.pi, 2 * np.pi):
        rotation = controls[-1] + turn
        if low - near <= rotation <= high + near:
            yield np.append(controls[:-1], np.clip(rotation, low, high))


def _fitted(problem: PlanningProblem, base: JointPlacement, missed: bool) -> Iterator[Array]:
    """Yield distinct fits of tensions and joint values (n_tendons + 2,), then the nearest draws."""
    bends = BendCoordinates(problem.arm, problem.target_set.tendons, problem.allowed)
    unit, residuals = tension_scales(problem.arm, problem.allowed).max(), residuals_of(problem)
    weight = 0.0 if missed or problem.target_set.terms.names[1] else _EFFORT
    low, high = (np.array(each) for each in base.joints.limits)
    scales = np.array([problem.arm.length, HALF_TURN])
    cost = np.sqrt(base.joints.weight) * weight

    def controls(points: Array) -> tuple[Array, Array]:
        """Return tensions (m, n_tendons) and joint values (m, 2), within the limits."""
        return bends.tensions(points[:, 2:]), np.clip(points[:, :2] * scales, low, high)

    def gaps(points: Array) -> Array:
        T, joints = controls(points)
        change = joints - np.array(base.values)
        off = residuals(T, lambda poses: moved_poses(poses, problem.arm, change))
        return np.hstack([off, weight * T / unit, cost * joints / scales])

    drawn = bends.draw(_DRAWN)
    joints = np.random.default_rng(0).uniform(low, high, (_DRAWN, 2))
    points = np.hstack([joints / scales, drawn])
    off = np.linalg.norm(gaps(points), axis=1)
    points = points[np.argsort(off, kind="stable")[:_FITTED]]
    nearest = np.hstack(controls(points))
    if problem.scene.has(Extension):
        points = np.hstack([points, np.full((len(points), bends.width // 2), _SQUEEZED)])
    points, r = least_squares(gaps, points)
    order = np.argsort(np.linalg.norm(r, axis=1), kind="stable")
    found = np.vstack([np.hstack(controls(points[order])), nearest])
    units = np.append(np.full(problem.arm.n_tendons, unit), scales)
    yield from distinct(found, units, _APART)
