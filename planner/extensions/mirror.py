"""Mirror images: tensions of the arm that is mirrored in a plane through the base's axis.

A plane in which the tendons of each anchorage are symmetric maps tensions to those of the mirrored
tendons. If arm, loads and targets are symmetric too, the mirror image of a plan is a plan of the
same effort. The settled shapes verify this.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.errors import OctoplanError
from octoplan.model.tendons import is_taut
from octoplan.planner.limits import TendonLimits
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.targets.target_set import TargetSet, residual_function


def _planes(arm: Arm, limits: TendonLimits) -> Iterator[tuple[float, Array]]:
    """Yield the planes that map tendons to tendons of the same section, path and limits.

    Yields the angle in the base's n and b, in [0, pi) [rad], and the index of the mirror image of
    each tendon (n_tendons,). Arms with turned anchorages have no such planes.
    """
    angles = np.array([phi for _, phi in arm.tendons])
    paths = [arm.offset_paths[i] for i in arm.offset_of]
    kinds = list(zip(paths, limits.lower, limits.upper, strict=True))
    alike = np.array([[one == other for other in kinds] for one in kinds])
    alike &= all(section.turn is None for section in arm.sections)
    for double in np.unique((angles[0] + angles[alike[0]]) % (2 * np.pi)):
        apart = (double - angles[:, None] - angles + np.pi) % (2 * np.pi) - np.pi
        images = alike & np.isclose(apart, 0.0)
        if images.any(axis=1).all():
            yield float(double) / 2, images.argmax(axis=1)


def _mirrored(arm: Arm, angle: float, poses: Array) -> Array:
    """Return the mirror images of poses (K, 7), with right-handed frames.

    Frames are mirrored in the base's plane and in their own plane. A reflection is a half turn
    about the normal times -1; the two signs cancel.
    """
    own_normal = np.array([0.0, -np.sin(angle), np.cos(angle)])
    normal = np.array(arm.base_frame) @ own_normal
    heights = (poses[:, 4:] - arm.base_position) @ normal
    frames = poses[:, :4] @ _half_turns(normal, own_normal).T
    return np.hstack([frames, poses[:, 4:] - 2 * np.outer(heights, normal)])


def _half_turns(a: Array, b: Array) -> Array:
    """Return the matrix (4, 4) of q -> (0, a) q (0, b), the product of quaternions."""
    left = np.array(
        [
            [0, -a[0], -a[1], -a[2]],
            [a[0], 0, -a[2], a[1]],
            [a[1], a[2], 0, -a[0]],
            [a[2], -a[1], a[0], 0],
        ]
    )
    right = np.array(
        [
            [0, -b[0], -b[1], -b[2]],
            [b[0], 0, b[2], -b[1]],
            [b[1], -b[2], 0, b[0]],
            [b[2], b[1], -b[0], 0],
        ]
    )
    return np.asarray(left @ right)


def mirror_images(problem: PlanningProblem, shape: Shape) -> Iterator[tuple[float, Array]]:
    """Yield angles of planes [rad], and mirrored tensions (n_tendons,) that meet the targets [N].

    The residuals may exceed those of the shape by ten times the accuracy. Nothing for targets of
    stiffness, with stroke limits, without tensions, and for tensions that are symmetric.
    """
    arm = problem.arm
    targets = problem.target_set
    limits = problem.limits
    T = shape.tensions
    stations = np.array(targets.stations)
    if targets.requests or limits.strokes is not None or not is_taut(arm, T).any():
        return
    poses = shape.poses(stations)
    most = _largest_residual(targets, poses) + 10 * problem.accuracy
    for angle, images in _planes(arm, limits):
        other = T[images]
        is_symmetric = np.abs(T - other).max() <= problem.accuracy * T.max()
        if is_symmetric or _largest_residual(targets, _mirrored(arm, angle, poses)) > most:
            continue
        with suppress(OctoplanError):
            settled = settle(
                arm, other, problem.scene, problem.accuracy, compile=shape.machine_code
            )
            if _largest_residual(targets, settled.poses(stations)) <= most:
                yield angle, other


def _largest_residual(targets: TargetSet, poses: Array) -> float:
    """Return the largest residual of the targets for poses (K, 7)."""
    (gaps,) = residual_function(targets.terms)(poses.reshape(1, -1), targets.numbers[None, :])
    return float(np.abs(gaps).max(initial=0.0))
